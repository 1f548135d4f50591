"""Predict a limb from windows of the database that are as long as the gap.

Poses alone do not tell where a limb is that moves while the rest of the body stands still. Windows
of other recordings whose visible markers move as in the gap, and whose missing markers are at its
edges where the gap's are, do: the limb's path between the edges is regressed on them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.root_frames import RootFrames
from priorfill.methods.gpr.gap_segments import MIN_VISIBLE, GapSegment
from priorfill.methods.gpr.pose_search import PoseSearch
from priorfill.methods.gpr.sources.gap_layout import GapLayout, lay_out_gap
from priorfill.methods.gpr.sources.options import GapWindowOptions
from priorfill.methods.gpr.sources.similar_windows import LocalWindows, WindowFinder
from priorfill.methods.gpr.sources.source import SourcePrediction
from priorfill.methods.gpr.sources.window_regression import WindowRegression, regress_windows
from priorfill.methods.task import Task, take_names
from priorfill.signal.cubic_spline import cubic_spline

__all__ = ["GapWindows"]

_Floats = NDArray[np.float64]
_Ints = NDArray[np.intp]


class GapWindows:
    """Predicts limbs of a task from windows of its takes.

    Parameters
    ----------
    task : Task
        The clip and the takes.
    search : PoseSearch
        Of these takes.
    options : GapWindowOptions
        Numbers of windows, and the regression.
    rate : float
        Hz. Resolution at which the takes are searched.
    """

    def __init__(
        self, task: Task, search: PoseSearch, options: GapWindowOptions, rate: float
    ) -> None:
        self._task = task
        self._search = search
        self._options = options
        self._rate = rate

    def predict(self, segment: GapSegment, visible: _Ints) -> SourcePrediction | None:
        """Predict a gap segment.

        Parameters
        ----------
        segment : GapSegment
            Of several markers.
        visible : ndarray of int
            Markers that are measured in all of its frames, the nearest to the missing ones first.

        Returns
        -------
        SourcePrediction or None
            None where the database has too few windows with the markers.
        """
        options = self._options
        if not self._task.takes or not options.max_windows:
            return None
        layout = lay_out_gap(segment, self._task.valid, self._task.rate, options)
        finder = None if layout is None else self._finder(segment, visible, layout)
        if layout is None or finder is None:
            return None
        begin = finder.find()
        windows = finder.read(begin)
        usable = ~np.isnan(windows.visible).any(axis=(1, 2, 3))
        usable &= ~np.isnan(windows.missing).any(axis=(1, 2, 3))
        take = finder.bank.take(begin[usable])
        own_subject = self._of_own_subject(take)
        subject = self._search.subjects[take]
        groups = take if own_subject or len(np.unique(subject)) < 2 else subject
        if len(take) < options.min_windows or len(np.unique(groups)) < 2:
            return None
        windows = LocalWindows(windows.visible[usable], windows.missing[usable])
        gap, _ = finder.gap()
        found = regress_windows(
            windows.features(layout, finder.weights, options),
            _from_line(windows, layout).reshape(len(take), -1),
            gap.features(layout, finder.weights, options)[0],
            groups,
            options,
        )
        positions, expected_rms = _in_segment(segment, layout, gap, finder, found)
        nodes, markers = len(layout.nodes), len(segment.markers)
        return SourcePrediction(
            positions,
            expected_rms,
            found.residuals.reshape(-1, nodes, markers, 3),
            found.similarity,
            options.own_penalty if own_subject else options.stranger_penalty,
            take_names(self._task.takes, take),
        )

    def _finder(
        self, segment: GapSegment, visible: _Ints, layout: GapLayout
    ) -> WindowFinder | None:
        """Return what finds windows, by the visible markers that takes have and all frames show."""
        task, search = self._task, self._search
        common = search.common_markers(segment.markers)[visible]
        shown = task.valid[np.ix_(layout.frames, visible)].all(axis=0)
        shown &= task.valid[segment.start : segment.stop, visible].all(axis=0)
        visible = visible[common & shown]
        root = task.root_among(visible) if len(visible) >= MIN_VISIBLE else None
        if root is None:
            return None
        searched = visible[: search.options.max_markers]
        needed = np.concatenate([segment.markers, visible])
        bank = search.bank(root, searched, needed, self._rate)
        if len(bank) < self._options.min_windows:
            return None
        geometry = task.geometry
        weights = self._options.alignment.marker_weights(
            geometry.distance[np.ix_(segment.markers, visible)].min(axis=0),
            geometry.spread[np.ix_(segment.markers, visible)].min(axis=0),
        )
        return WindowFinder(
            task.positions,
            search,
            bank,
            root,
            visible,
            segment.markers,
            weights,
            layout,
            self._options,
        )

    def _of_own_subject(self, take: _Ints) -> bool:
        """Return whether some of the takes are of the clip's subject."""
        subject = self._task.subject
        takes = [self._task.takes[i] for i in np.unique(take)]
        return any(one.same_subject or (subject != "" and one.subject == subject) for one in takes)


def _line(windows: LocalWindows, layout: GapLayout, frames: _Ints) -> _Floats:
    """Return the straight line between the edges in some frames of the gap.

    Returns
    -------
    ndarray [shape=(windows, frames, missing markers, 3), mm]
    """
    edges = len(layout.edges)
    share = layout.fraction(frames)[:, None, None]
    first, last = windows.missing[:, :1], windows.missing[:, edges - 1 : edges]
    line: _Floats = (1.0 - share) * first + share * last
    return line


def _from_line(windows: LocalWindows, layout: GapLayout) -> _Floats:
    """Return the missing markers' residuals to that line at the nodes."""
    inside = windows.missing[:, 2 * len(layout.edges) :]
    return inside - _line(windows, layout, layout.nodes)


def _in_segment(
    segment: GapSegment,
    layout: GapLayout,
    gap: LocalWindows,
    finder: WindowFinder,
    found: WindowRegression,
) -> tuple[_Floats, _Floats]:
    """Return positions and expected errors in all frames of a segment, as of `SourcePrediction`."""
    shape = (len(layout.nodes), len(segment.markers), 3)
    residual = found.mean.reshape(shape)
    rms = np.sqrt(found.expected_square().reshape(shape).sum(axis=-1))
    nodes = layout.nodes
    edges = np.array([edge[0] for edge in layout.edges])
    order = np.argsort(np.concatenate([nodes, edges]))
    knots = np.concatenate([nodes, edges])[order]
    zeros = np.zeros((len(edges), *shape[1:]))
    values = np.concatenate([residual, zeros])[order]
    frames = np.arange(segment.start, segment.stop)
    # beyond the last node of a gap with one edge the residual stays
    inside = np.clip(frames, knots[0], knots[-1])
    local = cubic_spline(knots, values, inside) + _line(gap, layout, frames)[0]
    at: RootFrames = finder.frames_of_reference(frames)
    errors = np.concatenate([rms, zeros[..., 0]])[order]
    expected = np.stack([np.interp(inside, knots, column) for column in errors.T], axis=1)
    return at.to_world(local), expected
