"""Predict a limb from windows of the database that are as long as the gap.

Poses alone do not tell where a limb is that moves while the rest of the body stands still. Windows
of other recordings whose visible markers move as in the gap, and whose missing markers are at its
edges where the gap's are, do: the limb's path between the edges is regressed on them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.linalg import power_weights
from priorfill.methods.gpr.gap_segments import MIN_VISIBLE, GapSegment
from priorfill.methods.gpr.pose_search import PoseSearch
from priorfill.methods.gpr.sources.gap_layout import GapLayout, lay_out_gap
from priorfill.methods.gpr.sources.options import GapWindowOptions
from priorfill.methods.gpr.sources.similar_windows import (
    LocalWindows,
    WindowFinder,
    WindowFrame,
)
from priorfill.methods.gpr.sources.source import MIN_ERROR, SourcePrediction
from priorfill.methods.gpr.sources.window_regression import WindowRegression, regress_windows
from priorfill.methods.task import Task, take_names
from priorfill.signal.cubic_spline import cubic_spline

__all__ = ["GapWindows"]

MIN_GROUPS = 3
"""Takes or subjects of windows: with fewer, held-out errors tell little."""

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
        frames = self._frames(finder)
        begin = finder.find(frames[0])
        windows = finder.read(begin)
        usable = ~np.isnan(windows[..., 0]).any(axis=(1, 2))
        take = finder.bank.take(begin[usable])
        own_subject = self._of_own_subject(take)
        subject = self._search.subjects[take]
        groups = take if own_subject or len(np.unique(subject)) < 2 else subject
        if len(take) < options.min_windows or len(np.unique(groups)) < MIN_GROUPS:
            return None
        both = np.concatenate([finder.gap(), windows[usable]])
        predictions = []
        for frame in frames:
            local = frame.local(both)
            found = _regress(local, frame, layout, groups, options)
            predictions.append(_in_segment(segment, layout, local, frame, finder, found))
        positions, expected_rms = _mean(predictions, options.weight_power)
        return SourcePrediction(
            positions,
            expected_rms,
            options.own_penalty if own_subject else options.stranger_penalty,
            take_names(self._task.takes, take),
        )

    def _frames(self, finder: WindowFinder) -> list[WindowFrame]:
        """Return the frames of reference."""
        geometry = self._task.geometry
        pairs = np.ix_(finder.missing, finder.visible)
        distance, spread = (x[pairs].min(axis=0) for x in (geometry.distance, geometry.spread))
        return [finder.frame(one, distance, spread) for one in self._options.alignments]

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
        return WindowFinder(
            task.positions,
            search,
            bank,
            root,
            visible,
            segment.markers,
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


def _regress(
    windows: LocalWindows,
    frame: WindowFrame,
    layout: GapLayout,
    groups: _Ints,
    options: GapWindowOptions,
) -> WindowRegression:
    """Predict the gap, which is the first window: its residual to the line at the nodes."""
    features = frame.features(windows, layout, options)
    inside = windows.missing[1:, 2 * len(layout.edges) :]
    targets = inside - _line(windows, layout, layout.nodes)[1:]
    return regress_windows(
        features[1:], targets.reshape(len(targets), -1), features[0], groups, options
    )


def _in_segment(
    segment: GapSegment,
    layout: GapLayout,
    windows: LocalWindows,
    frame: WindowFrame,
    finder: WindowFinder,
    found: WindowRegression,
) -> tuple[_Floats, _Floats]:
    """Return positions and expected errors in all frames of a segment, as of `SourcePrediction`."""
    shape = (len(layout.nodes), len(segment.markers), 3)
    residual = found.mean.reshape(shape)
    rms = np.sqrt(found.expected_square().reshape(shape).sum(axis=-1))
    edges = np.array([edge[0] for edge in layout.edges])
    knots = np.concatenate([layout.nodes, edges])
    order = np.argsort(knots)
    knots = knots[order]
    zeros = np.zeros((len(edges), *shape[1:]))
    values = np.concatenate([residual, zeros])[order]
    frames = np.arange(segment.start, segment.stop)
    # beyond the last node of a gap with one edge the residual stays
    inside = np.clip(frames, knots[0], knots[-1])
    local = cubic_spline(knots, values, inside) + _line(windows, layout, frames)[0]
    errors = np.concatenate([rms, zeros[..., 0]])[order]
    expected = np.stack([np.interp(inside, knots, column) for column in errors.T], axis=1)
    poses = finder.positions[np.ix_(frames, finder.visible)]
    return frame.of(poses).to_world(local), expected


def _mean(predictions: Sequence[tuple[_Floats, _Floats]], power: float) -> tuple[_Floats, _Floats]:
    """Return the mean of predictions, weighted by their expected errors, and its expected errors.

    All come from the same windows, so their errors are correlated.
    """
    positions, errors = (np.stack(parts) for parts in zip(*predictions, strict=True))
    weight = power_weights(np.maximum(errors, MIN_ERROR), power)
    mean = np.einsum("kfm,kfmi->fmi", weight, positions)
    return mean, np.sqrt((weight * errors**2).sum(axis=0))
