"""Fill marker after marker: references, models, their average, the skeleton constraint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.gaps import Gap, runs
from priorfill.methods.tits2018 import (
    distance_bounds,
    global_pca,
    global_regression,
    local_grnn,
    local_interpolation,
    local_polynomial,
    model_averaging,
    triad_frame,
)
from priorfill.methods.tits2018.continuity import ramp
from priorfill.methods.tits2018.median_mean_filter import frames_in, smooth
from priorfill.methods.tits2018.reference_triads import Triad, choose, deviations
from priorfill.methods.tits2018.tits2018_options import Tits2018Options, spread_evenly, thinned

__all__ = ["MODELS", "Recovery", "centre", "often", "recover"]

Array = NDArray[np.float64]

MODELS = ("li", "lpr", "lgrnn", "glr", "wpca")
"""The models, in the order of the published program."""


def centre(positions: Array) -> Array | None:
    """Return the mean of the markers that are never missing [shape=(frames, 3), mm].

    None where there are none.
    """
    never = ~np.isnan(positions[..., 0]).any(axis=0)
    return positions[:, never].mean(axis=1) if never.any() else None


def often(positions: Array, options: Tits2018Options) -> NDArray[np.bool_]:
    """Return which markers are seen often enough to be filled and used [shape=(markers,)]."""
    seen = (~np.isnan(positions[..., 0])).sum(axis=0)
    often_enough: NDArray[np.bool_] = seen >= max(options.presence * len(positions), 1)
    return often_enough


@dataclass(frozen=True, eq=False)
class Recovery:
    """What was filled.

    Attributes
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        Measured samples are as they were; NaN where nothing could be said.
    failed : ndarray of bool [shape=(frames, markers)]
        Where there were references, but no model could say anything.
    """

    positions: Array
    failed: NDArray[np.bool_]


def recover(
    positions: Array, rate: float, models: Sequence[str], options: Tits2018Options
) -> Recovery:
    """Fill the gaps of markers that are seen often enough.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    rate : float
        Hz.
    models : sequence of str
        Names of `MODELS`; several are averaged.
    options : Tits2018Options
        All constants.

    Returns
    -------
    Recovery
        Positions, and where the models failed.
    """
    out, failed = positions.copy(), np.zeros(positions.shape[:2], dtype=bool)
    kept = np.flatnonzero(often(positions, options))
    if not len(kept):
        return Recovery(out, failed)
    middle = centre(positions[:, kept])
    origin = np.zeros((len(positions), 3)) if middle is None else middle
    state = _State(positions[:, kept] - origin[:, None], rate, models, options)
    missing = np.isnan(positions[:, kept, 0])
    # the markers that are seen most come first: they help the others
    for marker in np.argsort(missing.sum(axis=0), kind="stable"):
        if missing[:, marker].any():
            failed[:, kept[marker]] = state.fill(int(marker))
    window = frames_in(options.window, rate)
    for place in np.flatnonzero(missing.any(axis=0)):
        smoothed = smooth(state.filled[:, place] + origin, window)
        out[missing[:, place], kept[place]] = smoothed[missing[:, place]]
    return Recovery(out, failed)


@dataclass(frozen=True, eq=False)
class _Lesson:
    """What a marker's triad teaches in all frames.

    Attributes
    ----------
    shape : ndarray [shape=(frames, 3), mm]
        Shape of the smoothed triad.
    local : ndarray [shape=(frames, 3), mm]
        The marker in its frame; NaN where missing.
    rows : ndarray of int [shape=(rows,)]
        Frames to learn from.
    distances : ndarray [shape=(frames, 3), mm]
        Of the marker from the triad's markers, both smoothed, as measured.
    """

    shape: Array
    local: Array
    rows: NDArray[np.intp]
    distances: Array


class _State:
    """Positions about their centre, and what is known of them while markers are filled.

    Attributes
    ----------
    filled : ndarray [shape=(frames, markers, 3), mm]
        With all that was filled so far.
    """

    def __init__(
        self, positions: Array, rate: float, models: Sequence[str], options: Tits2018Options
    ) -> None:
        self.filled = positions.copy()
        # only markers without a gap left help others
        self._helpful = positions.copy()
        self._models = models
        self._options = options
        self._window = frames_in(options.window, rate)
        self._deviations = deviations(positions, options)
        self._rebuilt = global_pca.predict(positions, options) if "wpca" in models else None
        self._smoothed: dict[int, Array] = {}

    def fill(self, marker: int) -> NDArray[np.bool_]:
        """Fill a marker's gaps as far as there are references; return where models failed."""
        measured = self._helpful[:, marker].copy()
        missing = np.isnan(measured[:, 0])
        gaps = [Gap(start, stop, marker) for start, stop in runs(missing)]
        whole = self._global_curves(marker, gaps)
        failed = np.zeros(len(missing), dtype=bool)
        while True:
            missing = np.isnan(self.filled[:, marker, 0])
            left = [
                Gap(start, stop, marker)
                for start, stop in runs(missing)
                if not failed[start:stop].all()
            ]
            seen = ~np.isnan(self._helpful[..., 0])
            references = choose(seen, marker, left, self._deviations[marker]) if left else None
            if references is None:
                break
            lesson = self._lesson(marker, references)
            before = self.filled[:, marker].copy()
            for gap in references.gaps:
                curve = self._curve(marker, gap, before, references, lesson, whole)
                self.filled[gap.start : gap.stop, marker] = curve
                if np.isnan(curve[:, 0]).all():
                    failed[gap.start : gap.stop] = True
        if not np.isnan(self.filled[:, marker, 0]).any():
            self._helpful[:, marker] = self.filled[:, marker]
            self._smoothed.pop(marker, None)
        return failed

    def _global_curves(self, marker: int, gaps: list[Gap]) -> dict[str, Array]:
        """Predict a marker by the models that need no references."""
        curves = {}
        if "glr" in self._models:
            curves["glr"] = global_regression.predict(
                self._helpful, marker, gaps, self._deviations[marker], self._options
            )
        if self._rebuilt is not None:
            curves["wpca"] = _joined(self._rebuilt[:, marker], self._helpful[:, marker], gaps)
        return curves

    def _smooth(self, marker: int) -> Array:
        """Return a smoothed marker; references are smoothed lest they pass on their noise."""
        if marker not in self._smoothed:
            self._smoothed[marker] = smooth(self._helpful[:, marker], self._window)
        return self._smoothed[marker]

    def _lesson(self, marker: int, references: Triad) -> _Lesson:
        smoothed = np.stack([self._smooth(one) for one in references.markers], axis=1)
        frame = triad_frame.axes(smoothed)
        shape = triad_frame.shape_of(smoothed, frame)
        local = triad_frame.into(self.filled[:, marker], smoothed, frame)
        rows = np.flatnonzero(~np.isnan(local[:, 0]) & ~np.isnan(shape[:, 0]))
        rows = rows[thinned(len(rows), self._options.local_rows)]
        distances = np.linalg.norm(smoothed - self._smooth(marker)[:, None], axis=2)
        return _Lesson(shape, local, rows, distances)

    def _curve(
        self,
        marker: int,
        gap: Gap,
        known: Array,
        references: Triad,
        lesson: _Lesson,
        whole: dict[str, Array],
    ) -> Array:
        """Predict a gap [shape=(frames of the gap, 3), mm]; ``known`` is the marker as it is."""
        options = self._options
        first, stop = max(gap.start - 1, 0), min(gap.stop + 1, len(known))
        beside = known[first:stop]
        positions = self._helpful[first:stop][:, references.markers]
        frame = triad_frame.axes(positions)
        curves = []
        for model in self._models:
            if model in whole:
                curve = whole[model][first:stop].copy()
                measured = ~np.isnan(beside[:, 0])
                curve[measured] = beside[measured]
                if np.isnan(curve[gap.start - first : gap.stop - first, 0]).all():
                    continue
            elif model == "li":
                local = local_interpolation.interpolate(triad_frame.into(beside, positions, frame))
                curve = triad_frame.out_of(local, positions, frame)
            else:
                local = self._local(model, lesson, first, stop, gap)
                curve = triad_frame.out_of(local, positions, frame)
            curves.append(curve)
        if not curves:
            return np.full((gap.frames, 3), np.nan)
        curve = curves[0]
        if len(curves) > 1:
            samples = [column[~np.isnan(column)] for column in lesson.distances.T]
            samples = [one[spread_evenly(len(one), options.density_rows)] for one in samples]
            curve = model_averaging.average(np.stack(curves), positions, samples, self._window)
        shortest, longest = distance_bounds.bounds(lesson.distances, options.narrow, options.wide)
        curve = distance_bounds.constrain(curve, positions, shortest, longest, options.rounds)
        return curve[gap.start - first : gap.stop - first]

    def _local(self, model: str, lesson: _Lesson, first: int, stop: int, gap: Gap) -> Array:
        """Predict a gap in the frame of its triad, the frames beside it included."""
        asked = lesson.shape[first:stop]
        known = lesson.shape[~np.isnan(lesson.shape[:, 0])]
        if not len(lesson.rows):
            return np.full(asked.shape, np.nan)
        rows, targets = lesson.shape[lesson.rows], lesson.local[lesson.rows]
        if model == "lpr":
            local = local_polynomial.predict(rows, targets, asked, known)
        else:
            local = local_grnn.predict(rows, targets, asked, known, self._options.spread)
        before = local[0] - lesson.local[first] if gap.start > 0 else None
        after = local[-1] - lesson.local[stop - 1] if gap.stop < len(lesson.local) else None
        return local - ramp(len(local), before, after)


def _joined(predicted: Array, measured: Array, gaps: list[Gap]) -> Array:
    """Close the steps between a prediction's first and last samples and those beside them."""
    out = predicted.copy()
    for gap in gaps:
        piece = predicted[gap.start : gap.stop]
        before = piece[0] - measured[gap.start - 1] if gap.start > 0 else None
        after = piece[-1] - measured[gap.stop] if gap.stop < len(measured) else None
        inside = slice(1 - (gap.start == 0), None)
        steps = ramp(gap.frames + (before is not None) + (after is not None), before, after)
        out[gap.start : gap.stop] = piece - steps[inside][: gap.frames]
    return out
