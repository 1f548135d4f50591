"""Windows of the database that are like a gap: as long, with alike poses in it and at its edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.poses import evenly_spaced
from priorfill.geometry.root_frames import RootFrames, RootGroup
from priorfill.gp.features import Alignment, MarkerWeights
from priorfill.methods.gpr.pose_search import PoseSearch
from priorfill.methods.gpr.sources.gap_layout import GapLayout
from priorfill.methods.gpr.sources.options import GapWindowOptions
from priorfill.search.bank import PoseBank, spaced_rows

__all__ = ["LocalWindows", "WindowFinder", "WindowFrame"]

CANDIDATES_PER_WINDOW = 4
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


@dataclass(frozen=True, eq=False)
class WindowFrame:
    """A frame of reference of poses, and features of windows in it.

    Attributes
    ----------
    alignment : Alignment
        How poses are aligned.
    weights : MarkerWeights
        Of the visible markers.
    template : ndarray [shape=(visible markers, 3), mm]
        The pose that they are aligned with.
    """

    alignment: Alignment
    weights: MarkerWeights
    template: _Floats

    def of(self, visible: _Floats) -> RootFrames:
        """Return the frames of poses [shape=(poses, visible markers, 3), mm]."""
        return self.alignment.root_frames(visible, self.template, self.weights)

    def local(self, windows: _Floats) -> LocalWindows:
        """Return windows in their frames.

        Parameters
        ----------
        windows : ndarray [shape=(windows, frames, markers, 3), mm]
            Upright; the visible markers, then the missing ones.
        """
        split = len(self.template)
        poses = windows.reshape(-1, *windows.shape[2:])
        local = self.of(poses[:, :split]).to_local(poses).reshape(windows.shape)
        return LocalWindows(local[:, :, :split], local[:, :, split:])

    def features(
        self, windows: LocalWindows, layout: GapLayout, options: GapWindowOptions
    ) -> _Floats:
        """Return features of windows in the frames of a layout [shape=(windows, features), mm].

        Squared distances of features are mean squared distances per pose of the visible markers,
        by their weights, and of the missing ones and their velocities at the edges.
        """
        count, frames, markers = windows.missing.shape[:3]
        visible = self.weights.features / np.sqrt((self.weights.features**2).sum() * frames)
        edges = len(layout.edges)
        near, far = windows.missing[:, :edges], windows.missing[:, edges : 2 * edges]
        edge = options.edge_weight / np.sqrt(edges * markers)
        velocity = edge * options.velocity_seconds / layout.edge_seconds
        parts = (windows.visible * visible[:, None], edge * near, velocity * (near - far))
        return np.concatenate([part.reshape(count, -1) for part in parts], axis=1)


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
    layout: GapLayout
    options: GapWindowOptions

    def frame(self, alignment: Alignment, distance: _Floats, spread: _Floats) -> WindowFrame:
        """Return a frame of reference.

        Parameters
        ----------
        alignment : Alignment
            How poses are aligned.
        distance, spread : ndarray [shape=(visible markers,), mm]
            Rms distance of each to the nearest missing marker, and its standard deviation.
        """
        weights = alignment.marker_weights(distance, spread)
        return WindowFrame(alignment, weights, self.positions[self.layout.nodes[0], self.visible])

    def gap(self) -> _Floats:
        """Return the gap as a window [shape=(1, frames, markers, 3), mm], as of `read`."""
        markers = np.concatenate([self.visible, self.missing])
        window: _Floats = self.positions[np.ix_(self.layout.frames, markers)][None]
        return window

    def find(self, frame: WindowFrame) -> _Ints:
        """Return where the windows most like the gap begin, the most alike first.

        Parameters
        ----------
        frame : WindowFrame
            In which they are compared.

        Returns
        -------
        ndarray of int
            Rows of the bank, of the first time of the layout.
        """
        options = self.options
        begin = self._candidates()
        edges = 2 * len(self.layout.edges)
        nodes = evenly_spaced(len(self.layout.nodes), options.compared_poses)
        compared = np.concatenate([np.arange(edges), edges + nodes])
        windows = self.read(begin, compared)
        usable = ~np.isnan(windows[..., 0]).any(axis=(1, 2))
        begin = begin[usable]
        both = np.concatenate([self.gap()[:, compared], windows[usable]])
        features = frame.features(frame.local(both), self.layout, options)
        square = ((features[1:] - features[0]) ** 2).sum(axis=1)
        order = np.argsort(square, kind="stable")
        return self._spaced(begin[order], options.max_windows)

    def read(self, begin: _Ints, chosen: _Ints | None = None) -> _Floats:
        """Return the windows that begin in some rows of the bank.

        Parameters
        ----------
        begin : ndarray of int [shape=(windows,)]
            Rows at the first time of the layout.
        chosen : ndarray of int, optional
            Which frames of the layout; all by default.

        Returns
        -------
        ndarray [shape=(windows, frames, markers, 3), mm]
            As recorded; the visible markers, then the missing ones.
        """
        seconds = self.layout.seconds if chosen is None else self.layout.seconds[chosen]
        return self._interpolated(begin, seconds, np.concatenate([self.visible, self.missing]))

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
        return begin[spaced_rows(begin, take, distance, count)]

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
