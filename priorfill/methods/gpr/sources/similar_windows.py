"""Windows of the database that are like a gap: as long, with alike poses in it and at its edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.poses import evenly_spaced
from priorfill.geometry.root_frames import RootFrames, RootGroup
from priorfill.gp.features import MarkerWeights
from priorfill.methods.gpr.pose_search import PoseSearch
from priorfill.methods.gpr.sources.gap_layout import GapLayout
from priorfill.methods.gpr.sources.options import GapWindowOptions
from priorfill.search.bank import PoseBank

__all__ = ["LocalWindows", "WindowFinder"]

CANDIDATES_PER_WINDOW = 8
"""Windows that are compared in root frames of their own, with those next to each other, for each
that is used."""

_Floats = NDArray[np.float64]
_Ints = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class LocalWindows:
    """Positions of windows in the frames of reference of their poses.

    Attributes
    ----------
    visible : ndarray [shape=(windows, frames, visible markers, 3), mm]
        Visible markers.
    missing : ndarray [shape=(windows, frames, missing markers, 3), mm]
        Those missing in the gap.
    """

    visible: _Floats
    missing: _Floats

    def features(
        self, layout: GapLayout, weights: MarkerWeights, options: GapWindowOptions
    ) -> _Floats:
        """Return features in all frames of a layout [shape=(windows, features), mm].

        Squared distances of features are mean squared distances per pose of the visible markers,
        by their weights, and of the missing ones and their velocities at the edges.
        """
        windows, frames, markers = self.missing.shape[:3]
        visible = weights.features / np.sqrt((weights.features**2).sum() * frames)
        edges = len(layout.edges)
        near, far = self.missing[:, :edges], self.missing[:, edges : 2 * edges]
        edge = options.edge_weight / np.sqrt(edges * markers)
        velocity = edge * options.velocity_seconds / layout.edge_seconds
        parts = (self.visible * visible[:, None], edge * near, velocity * (near - far))
        return np.concatenate([part.reshape(windows, -1) for part in parts], axis=1)


@dataclass(frozen=True, eq=False)
class WindowFinder:
    """Finds windows of a bank that are like a gap.

    Attributes
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        The clip, upright.
    search : PoseSearch
        Of the bank.
    bank : PoseBank
        The poses of the database.
    root : RootGroup
        Aligns the poses that are searched for.
    visible, missing : ndarray of int
        Markers of the clip; the visible ones are measured in all frames of the layout.
    weights : MarkerWeights
        Of the visible markers.
    layout : GapLayout
        Of the gap.
    options : GapWindowOptions
        Numbers of windows.
    """

    positions: _Floats
    search: PoseSearch
    bank: PoseBank
    root: RootGroup
    visible: _Ints
    missing: _Ints
    weights: MarkerWeights
    layout: GapLayout
    options: GapWindowOptions

    def gap(self) -> tuple[LocalWindows, RootFrames]:
        """Return the gap as a window, and its poses' frames of reference."""
        poses = self.positions[self.layout.frames]
        frames = self._frames(poses[:, self.visible])
        local = [frames.to_local(poses[:, some])[None] for some in (self.visible, self.missing)]
        return LocalWindows(*local), frames

    def frames_of_reference(self, frames: _Ints) -> RootFrames:
        """Return those of some frames of the clip, in which all visible markers are measured."""
        return self._frames(self.positions[np.ix_(frames, self.visible)])

    def find(self) -> _Ints:
        """Return where the windows most like the gap begin, the most alike first.

        Returns
        -------
        ndarray of int
            Rows of the bank, of the first time of the layout.
        """
        gap, options = self.gap()[0], self.options
        begin = self._candidates()
        edges = 2 * len(self.layout.edges)
        nodes = evenly_spaced(len(self.layout.nodes), options.compared_poses)
        compared = np.concatenate([np.arange(edges), edges + nodes])
        read = self.read(begin, compared)
        usable = ~np.isnan(read.missing).any(axis=(1, 2, 3))
        usable &= ~np.isnan(read.visible).any(axis=(1, 2, 3))
        begin = begin[usable]
        there = LocalWindows(read.visible[usable], read.missing[usable])
        here = LocalWindows(gap.visible[:, compared], gap.missing[:, compared])
        features = there.features(self.layout, self.weights, options)
        difference = features - here.features(self.layout, self.weights, options)
        order = np.argsort((difference**2).sum(axis=1), kind="stable")
        return self._spaced(begin[order], options.max_windows)

    def read(self, begin: _Ints, chosen: _Ints | None = None) -> LocalWindows:
        """Return the windows that begin in some rows of the bank.

        Parameters
        ----------
        begin : ndarray of int [shape=(windows,)]
            Rows at the first time of the layout.
        chosen : ndarray of int, optional
            Which frames of the layout; all by default.
        """
        seconds = self.layout.seconds if chosen is None else self.layout.seconds[chosen]
        both = np.concatenate([self.visible, self.missing])
        poses = self._interpolated(begin, seconds, both).reshape(-1, len(both), 3)
        split = len(self.visible)
        frames = self._frames(poses[:, :split])
        shape = (len(begin), len(seconds), -1, 3)
        local = frames.to_local(poses).reshape(shape)
        return LocalWindows(local[:, :, :split], local[:, :, split:])

    def _frames(self, visible: _Floats) -> RootFrames:
        """Return the frames of reference of poses [shape=(poses, visible markers, 3), mm]."""
        template = self.positions[self.layout.nodes[0], self.visible]
        return self.options.alignment.root_frames(visible, template, self.weights)

    def _candidates(self) -> _Ints:
        """Return where the windows begin that are most like the gap in their root frames.

        Compared are evenly spaced poses of the gap, and the missing markers at its edges.
        """
        bank, options = self.bank, self.options
        seconds, square = self._squared_distances()
        total = np.full(bank.poses, np.inf, dtype=np.float32)
        searched = np.full((bank.poses, square.shape[1]), np.inf, dtype=np.float32)
        searched[bank.rows] = square
        rates = bank.rates(np.arange(bank.poses))
        for rate in np.unique(rates):
            begin = np.flatnonzero(rates == rate)
            steps = np.round(seconds * rate).astype(np.intp)
            # one more pose on either side: positions between poses are interpolated by cubics
            first = int(np.floor(self.layout.seconds.min() * rate)) - 1
            last = int(np.ceil(self.layout.seconds.max() * rate)) + 2
            begin = begin[(begin + first >= 0) & (begin + last < bank.poses)]
            begin = begin[bank.take(begin + first) == bank.take(begin + last)]
            total[begin] = sum(searched[begin + step, i] for i, step in enumerate(steps))
        count = min(CANDIDATES_PER_WINDOW * options.max_windows, int(np.isfinite(total).sum()))
        if not count:
            return np.empty(0, dtype=np.intp)
        nearest = np.argpartition(total, count - 1)[:count]
        return self._spaced(nearest[np.argsort(total[nearest], kind="stable")], count)

    def _squared_distances(self) -> tuple[_Floats, NDArray[np.float32]]:
        """Return times, and the weighted squared distances of all searched poses from the gap's.

        Returns
        -------
        seconds : ndarray [shape=(poses,), s]
            Times of the poses of the gap, as of `GapLayout.seconds`.
        square : ndarray [shape=(rows, poses), mm²]
        """
        layout, options = self.layout, self.options
        edges = len(layout.edges)
        order = np.concatenate([np.arange(edges), np.arange(2 * edges, len(layout.frames))])
        order = order[np.argsort(layout.frames[order])]
        chosen = order[evenly_spaced(len(order), options.compared_poses)]
        poses = self.positions[layout.frames]
        local = self.root.frames(poses).to_local(poses)
        searched = self.visible[: self.search.options.max_markers]
        inside = self.bank.squared_distances(searched, local[np.ix_(chosen, searched)])
        inside /= len(chosen)
        edge = np.arange(edges)
        outside = self.bank.squared_distances(self.missing, local[np.ix_(edge, self.missing)])
        outside *= options.edge_weight**2 / edges
        at = np.concatenate([chosen, edge])
        return layout.seconds[at], np.concatenate([inside, outside], axis=1)

    def _spaced(self, begin: _Ints, count: int) -> _Ints:
        """Return the first windows that are not too near to a previous one of the same take."""
        take, rates = self.bank.take(begin), self.bank.rates(begin)
        length = self.layout.seconds.max() - self.layout.seconds.min()
        distance = np.maximum(1.0, self.options.spacing * length * rates)
        chosen: list[int] = []
        for index in range(len(begin)):
            if len(chosen) == count:
                break
            others = np.array(chosen, dtype=np.intp)
            same = others[take[others] == take[index]]
            if (np.abs(begin[same] - begin[index]) >= distance[index]).all():
                chosen.append(index)
        return begin[np.array(chosen, dtype=np.intp)]

    def _interpolated(self, begin: _Ints, seconds: _Floats, markers: _Ints) -> _Floats:
        """Return positions at times after rows of the bank, by cubics through four poses.

        Returns
        -------
        ndarray [shape=(rows, times, markers, 3), mm]
        """
        steps = seconds * self.bank.rates(begin)[:, None]
        whole = np.floor(steps + 1e-6).astype(np.intp)
        fraction = np.clip(steps - whole, 0.0, 1.0)[..., None, None]
        rows = begin[:, None] + whole
        between = (fraction > 1e-6)[..., 0, 0]

        def at(rows: _Ints) -> _Floats:
            return self.bank.positions(rows.ravel(), markers).reshape(*rows.shape, len(markers), 3)

        positions = at(rows)
        if between.any():
            f, some = fraction[between], rows[between]
            before, here, after, last = at(some - 1), positions[between], at(some + 1), at(some + 2)
            # the Catmull-Rom spline
            slope = 0.5 * (after - before)
            slope_after = 0.5 * (last - here)
            step = after - here
            positions[between] = (
                here
                + f * slope
                + f**2 * (3.0 * step - 2.0 * slope - slope_after)
                + f**3 * (slope + slope_after - 2.0 * step)
            )
        return positions
