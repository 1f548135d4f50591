"""Fill marker after marker: references, models, their average, the skeleton constraint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.gaps import Gap, runs
from priorfill.methods.task import Progress, no_progress
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
from priorfill.methods.tits2018.tits2018_options import (
    Tits2018Options,
    spread_evenly,
    thinned,
)

__all__ = ["MODELS", "Recovery", "centroid", "often_visible", "recover"]

Array = NDArray[np.float64]

MODELS = ("li", "lpr", "lgrnn", "glr", "wpca")
"""The models, in the order of the published program."""


def centroid(positions: Array) -> Array | None:
    """Return the mean of the markers that are never missing [shape=(frames, 3), mm].

    None where there are none.
    """
    never_missing = ~np.isnan(positions[..., 0]).any(axis=0)
    return positions[:, never_missing].mean(axis=1) if never_missing.any() else None


def often_visible(positions: Array, options: Tits2018Options) -> NDArray[np.bool_]:
    """Return which markers are visible often enough to be filled and used [shape=(markers,)]."""
    seen = (~np.isnan(positions[..., 0])).sum(axis=0)
    often: NDArray[np.bool_] = seen >= max(options.min_presence * len(positions), 1)
    return often


@dataclass(frozen=True, eq=False)
class Recovery:
    """The filled positions of a clip.

    Attributes
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        Measured samples are unchanged; NaN where a sample was not filled.
    failed : ndarray of bool [shape=(frames, markers)]
        Samples with references, but without a prediction by any model.
    """

    positions: Array
    failed: NDArray[np.bool_]


def recover(
    positions: Array,
    rate: float,
    models: Sequence[str],
    options: Tits2018Options,
    progress: Progress = no_progress,
) -> Recovery:
    """Fill the gaps of the markers that are visible often enough.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    rate : float
        Hz.
    models : sequence of str
        Names in `MODELS`; several models are averaged.
    options : Tits2018Options
        All constants.
    progress : callable
        Called with the number of samples done since the last call.

    Returns
    -------
    Recovery
        Positions, and where the models failed.

    See Also
    --------
    priorfill.methods.tits2018.pma : The same on a task.
    """
    out, failed = positions.copy(), np.zeros(positions.shape[:2], dtype=bool)
    kept = np.flatnonzero(often_visible(positions, options))
    if not len(kept):
        return Recovery(out, failed)
    middle = centroid(positions[:, kept])
    origin = np.zeros((len(positions), 3)) if middle is None else middle
    state = _RecoveryState(positions[:, kept] - origin[:, None], rate, models, options)
    missing = np.isnan(positions[:, kept, 0])
    # markers with few missing frames first: they help the others
    for marker in np.argsort(missing.sum(axis=0), kind="stable"):
        if missing[:, marker].any():
            failed[:, kept[marker]] = state.fill(int(marker))
            progress(int(missing[:, marker].sum()))
    window = frames_in(options.window, rate)
    for place in np.flatnonzero(missing.any(axis=0)):
        smoothed = smooth(state.filled[:, place] + origin, window)
        out[missing[:, place], kept[place]] = smoothed[missing[:, place]]
    return Recovery(out, failed)


@dataclass(frozen=True, eq=False)
class _TriadData:
    """A marker relative to its triad in all frames: the data of the local models.

    Attributes
    ----------
    shape : ndarray [shape=(frames, 3), mm]
        Shape of the smoothed triad.
    local : ndarray [shape=(frames, 3), mm]
        The marker in the frame of the triad; NaN where missing.
    rows : ndarray of int [shape=(rows,)]
        Training frames.
    distances : ndarray [shape=(frames, 3), mm]
        Measured distances of the marker from the triad's markers, both smoothed.
    """

    shape: Array
    local: Array
    rows: NDArray[np.intp]
    distances: Array


class _RecoveryState:
    """Positions relative to their centroid while one marker after another is filled.

    Attributes
    ----------
    filled : ndarray [shape=(frames, markers, 3), mm]
        The positions with everything filled so far.
    """

    def __init__(
        self, positions: Array, rate: float, models: Sequence[str], options: Tits2018Options
    ) -> None:
        self.filled = positions.copy()
        # positions that may predict other markers: filled samples only once a marker is complete
        self._predictors = positions.copy()
        self._models = models
        self._options = options
        self._window = frames_in(options.window, rate)
        self._deviations = deviations(positions, options)
        self._pca = global_pca.predict(positions, options) if "wpca" in models else None
        self._smoothed: dict[int, Array] = {}

    def fill(self, marker: int) -> NDArray[np.bool_]:
        """Fill a marker's gaps where they have references; return where the models failed."""
        measured = self._predictors[:, marker].copy()
        missing = np.isnan(measured[:, 0])
        gaps = [Gap(start, stop, marker) for start, stop in runs(missing)]
        global_curves = self._global_curves(marker, gaps)
        failed = np.zeros(len(missing), dtype=bool)
        while True:
            missing = np.isnan(self.filled[:, marker, 0])
            left = [
                Gap(start, stop, marker)
                for start, stop in runs(missing)
                if not failed[start:stop].all()
            ]
            seen = ~np.isnan(self._predictors[..., 0])
            references = choose(seen, marker, left, self._deviations[marker]) if left else None
            if references is None:
                break
            data = self._triad_data(marker, references)
            known = self.filled[:, marker].copy()
            for gap in references.gaps:
                curve = self._curve(gap, known, references, data, global_curves)
                self.filled[gap.start : gap.stop, marker] = curve
                if np.isnan(curve[:, 0]).all():
                    failed[gap.start : gap.stop] = True
        if not np.isnan(self.filled[:, marker, 0]).any():
            self._predictors[:, marker] = self.filled[:, marker]
            self._smoothed.pop(marker, None)
        return failed

    def _global_curves(self, marker: int, gaps: list[Gap]) -> dict[str, Array]:
        """Predict a marker by the models that need no references."""
        curves = {}
        if "glr" in self._models:
            curves["glr"] = global_regression.predict(
                self._predictors, marker, gaps, self._deviations[marker], self._options
            )
        if self._pca is not None:
            curves["wpca"] = _joined(self._pca[:, marker], self._predictors[:, marker], gaps)
        return curves

    def _smooth(self, marker: int) -> Array:
        """Return a smoothed marker, so that the noise of references is not passed on."""
        if marker not in self._smoothed:
            self._smoothed[marker] = smooth(self._predictors[:, marker], self._window)
        return self._smoothed[marker]

    def _triad_data(self, marker: int, references: Triad) -> _TriadData:
        smoothed = np.stack([self._smooth(one) for one in references.markers], axis=1)
        frame = triad_frame.axes(smoothed)
        shape = triad_frame.shape_of(smoothed, frame)
        local = triad_frame.into(self.filled[:, marker], smoothed, frame)
        rows = np.flatnonzero(~np.isnan(local[:, 0]) & ~np.isnan(shape[:, 0]))
        rows = rows[thinned(len(rows), self._options.local_rows)]
        distances = np.linalg.norm(smoothed - self._smooth(marker)[:, None], axis=2)
        return _TriadData(shape, local, rows, distances)

    def _curve(
        self,
        gap: Gap,
        known: Array,
        references: Triad,
        data: _TriadData,
        global_curves: dict[str, Array],
    ) -> Array:
        """Predict a gap [shape=(frames of the gap, 3), mm].

        ``known`` is the marker with everything filled so far [shape=(frames, 3), mm].
        """
        options = self._options
        first, stop = max(gap.start - 1, 0), min(gap.stop + 1, len(known))
        adjacent = known[first:stop]
        positions = self._predictors[first:stop][:, references.markers]
        frame = triad_frame.axes(positions)
        curves = []
        for model in self._models:
            if model in global_curves:
                curve = global_curves[model][first:stop].copy()
                measured = ~np.isnan(adjacent[:, 0])
                curve[measured] = adjacent[measured]
                if np.isnan(curve[gap.start - first : gap.stop - first, 0]).all():
                    continue
            elif model == "li":
                local = local_interpolation.interpolate(
                    triad_frame.into(adjacent, positions, frame)
                )
                curve = triad_frame.out_of(local, positions, frame)
            else:
                local = self._local(model, data, first, stop, gap)
                curve = triad_frame.out_of(local, positions, frame)
            curves.append(curve)
        if not curves:
            return np.full((gap.frames, 3), np.nan)
        curve = curves[0]
        if len(curves) > 1:
            samples = [column[~np.isnan(column)] for column in data.distances.T]
            samples = [one[spread_evenly(len(one), options.density_rows)] for one in samples]
            curve = model_averaging.average(np.stack(curves), positions, samples, self._window)
        shortest, longest = distance_bounds.bounds(
            data.distances, options.low_quantile, options.high_quantile
        )
        curve = distance_bounds.constrain(curve, positions, shortest, longest, options.rounds)
        return curve[gap.start - first : gap.stop - first]

    def _local(self, model: str, data: _TriadData, first: int, stop: int, gap: Gap) -> Array:
        """Predict a gap and its adjacent frames in the frame of the triad."""
        query = data.shape[first:stop]
        known = data.shape[~np.isnan(data.shape[:, 0])]
        if not len(data.rows):
            return np.full(query.shape, np.nan)
        rows, targets = data.shape[data.rows], data.local[data.rows]
        if model == "lpr":
            local = local_polynomial.predict(rows, targets, query, known)
        else:
            local = local_grnn.predict(
                rows, targets, query, known, self._options.half_weight_distance
            )
        before = local[0] - data.local[first] if gap.start > 0 else None
        after = local[-1] - data.local[stop - 1] if gap.stop < len(data.local) else None
        return local - ramp(len(local), before, after)


def _joined(predicted: Array, measured: Array, gaps: list[Gap]) -> Array:
    """Remove the steps between the predictions of gaps and the adjacent measured samples."""
    out = predicted.copy()
    for gap in gaps:
        part = predicted[gap.start : gap.stop]
        before = part[0] - measured[gap.start - 1] if gap.start > 0 else None
        after = part[-1] - measured[gap.stop] if gap.stop < len(measured) else None
        inside = slice(1 - (gap.start == 0), None)
        steps = ramp(gap.frames + (before is not None) + (after is not None), before, after)
        out[gap.start : gap.stop] = part - steps[inside][: gap.frames]
    return out
