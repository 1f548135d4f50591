"""Wrong labels next to blackouts: samples at distances from most other markers that no body has.

When a body enters or leaves the volume, or most markers reappear at once, labels are assigned anew
and many are wrong together. A marker's few reference markers may then be wrong themselves, so that
more of them are asked, and the marker that contradicts most of the others is taken out first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.artefacts.marker_path import known_medians, known_quantiles, thinned_frames
from priorfill.artefacts.reference_markers import (
    ReferenceMarkerOptions,
    ReferenceMarkers,
    choose_reference_markers,
    distances,
)
from priorfill.gaps import runs
from priorfill.runtime.option_checks import check_at_least, check_between

__all__ = ["InconsistentLabelOptions", "InconsistentRun", "find_inconsistent_labels", "thin_frames"]

TIE_BREAK = 1e-3
"""Weight of the number of contradictions next to their share; small, so that it decides only where
shares are nearly equal."""


@dataclass(frozen=True)
class InconsistentLabelOptions:
    """When a label next to a blackout counts as wrong.

    Attributes
    ----------
    references : int
        Reference markers per marker.
    usual_quantile : float
        Quantile over the frames of the number of visible markers that counts as usual: up to three
        quarters of a clip may show fewer.
    blackout_share : float
        Fraction of the usually visible markers: with fewer visible, a frame belongs to a blackout.
    full_share : float
        With more visible, the blackout and its surroundings are over.
    margin_seconds : float
        s. Frames around that are examined as well.
    max_distance : float
        mm. Largest usual distance that is used: farther markers are rarely on the same segment.
    max_spread : float
        mm. Largest spread of a distance that is used (see ``spread_quantile``).
    spread_quantile : float
        Quantile of a distance's deviations from its median taken as its spread. The standard
        deviation does not show a posture that is taken for a short time.
    min_deviation : float
        mm. Least deviation of a distance that contradicts a label.
    spread_factor : float
        Least such deviation as a multiple of the spread.
    contradicted_share : float
        Least share of a marker's known distances that contradict a wrong label.
    max_bridged_seconds : float
        s. Runs of wrong samples that are this near to each other are one.
    min_usual_frames : int
        Frames with nearly all markers visible that are needed to know the usual distances.
    """

    references: int = 10
    usual_quantile: float = 0.75
    blackout_share: float = 0.5
    full_share: float = 0.9
    margin_seconds: float = 0.25
    max_distance: float = 250.0
    max_spread: float = 20.0
    spread_quantile: float = 0.95
    min_deviation: float = 30.0
    spread_factor: float = 3.0
    contradicted_share: float = 0.5
    max_bridged_seconds: float = 0.05
    min_usual_frames: int = 30

    def __post_init__(self) -> None:
        check_at_least(self, 1, "references", "min_usual_frames")
        check_between(self, 0.0, 1.0, "usual_quantile", "blackout_share", "full_share")
        check_between(self, 0.0, 1.0, "spread_quantile", "contradicted_share")
        check_at_least(self, 0.0, "margin_seconds", "max_distance", "max_spread")
        check_at_least(self, 0.0, "min_deviation", "spread_factor", "max_bridged_seconds")


@dataclass(frozen=True)
class InconsistentRun:
    """Frames ``start <= frame < stop`` in which a label contradicts most others.

    Attributes
    ----------
    marker, start, stop : int
        The marker and the frames.
    reference : int
        The reference marker with the most unusual distance.
    distance, typical_distance, spread : float
        mm. The distance from it there, usually, and how much the latter varies.
    """

    marker: int
    start: int
    stop: int
    reference: int
    distance: float
    typical_distance: float
    spread: float


def thin_frames(
    seen: NDArray[np.bool_], rate: float, options: InconsistentLabelOptions
) -> NDArray[np.bool_]:
    """Return the frames of blackouts and around them [shape=(frames,)].

    Parameters
    ----------
    seen : ndarray of bool [shape=(frames, markers)]
        Which samples are measured.
    rate : float
        Hz.
    options : InconsistentLabelOptions
    """
    visible = seen.sum(axis=1)
    usual = np.quantile(visible, options.usual_quantile) if len(visible) else 0.0
    few = visible < options.blackout_share * usual
    thin = np.zeros(len(visible), dtype=bool)
    margin = round(options.margin_seconds * rate)
    for start, stop in runs(visible < options.full_share * usual):
        if few[start:stop].any():
            thin[max(start - margin, 0) : stop + margin] = True
    return thin


def find_inconsistent_labels(
    positions: NDArray[np.float64],
    rate: float,
    options: InconsistentLabelOptions = InconsistentLabelOptions(),
) -> list[InconsistentRun]:
    """Find labels next to blackouts whose distances contradict most visible reference markers.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    rate : float
        Hz.
    options : InconsistentLabelOptions

    Returns
    -------
    list of InconsistentRun
        By marker, then by time.

    See Also
    --------
    priorfill.artefacts.find_artefacts : Calls all detectors.
    thin_frames : The frames examined.
    """
    seen: NDArray[np.bool_] = ~np.isnan(positions[:, :, 0])
    thin = thin_frames(seen, rate, options)
    visible = seen.sum(axis=1)
    usual = ~thin & (visible > 0)
    if not thin.any() or usual.sum() < options.min_usual_frames:
        return []
    references = choose_reference_markers(
        positions[usual], ReferenceMarkerOptions(count=options.references)
    )
    distance = _UsualDistances.of(positions[usual], references, options)
    # a run of wrong samples may continue past the frames around the blackout
    contradicted, known = distance.compare(positions, options)
    wrong = _least_consistent(contradicted, known, references, options.contradicted_share)
    bridged = round(options.max_bridged_seconds * rate)
    found = []
    for marker in np.flatnonzero((wrong & thin[:, None]).any(axis=0)).tolist():
        silent = seen[:, marker] & ~known[:, marker].any(axis=1)
        for start, stop in _joined(wrong[:, marker], silent, seen[:, marker], bridged):
            run = distance.describe(positions, marker, start, stop)
            deviation = abs(run.distance - run.typical_distance)
            if thin[start:stop].any() and deviation > options.min_deviation:
                found.append(run)
    return found


@dataclass(frozen=True, eq=False)
class _UsualDistances:
    """Usual distances from reference markers, and their spread [shape=(markers, references), mm].

    NaN where a distance is no evidence.
    """

    references: ReferenceMarkers
    median: NDArray[np.float64]
    spread: NDArray[np.float64]

    @classmethod
    def of(
        cls,
        positions: NDArray[np.float64],
        references: ReferenceMarkers,
        options: InconsistentLabelOptions,
    ) -> _UsualDistances:
        """Measure the distances in some frames."""
        sample = thinned_frames(positions)
        median, spread = (np.full(references.others.shape, np.nan) for _ in range(2))
        for marker in range(positions.shape[1]):
            own = distances(sample, marker, references.others[marker])
            median[marker] = known_medians(own)
            spread[marker] = known_quantiles(np.abs(own - median[marker]), options.spread_quantile)
        useful = references.known & (spread < options.max_spread) & (median < options.max_distance)
        spread[~useful] = np.nan
        return cls(references, median, spread)

    def compare(
        self, positions: NDArray[np.float64], options: InconsistentLabelOptions
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return which distances are unusual, and which are known.

        Both of shape (frames, markers, references).
        """
        shape = (*positions.shape[:2], self.median.shape[1])
        contradicted, known = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=bool)
        limit = np.maximum(options.min_deviation, options.spread_factor * self.spread)
        for column in range(shape[2]):
            difference = positions[:, self.references.others[:, column]] - positions
            deviation = np.abs(np.sqrt((difference**2).sum(axis=2)) - self.median[:, column])
            with np.errstate(invalid="ignore"):
                contradicted[..., column] = deviation > limit[:, column]
            known[..., column] = ~np.isnan(deviation - limit[:, column])
        return contradicted, known

    def describe(
        self, positions: NDArray[np.float64], marker: int, start: int, stop: int
    ) -> InconsistentRun:
        """Describe a run of wrong samples by its most unusual distance."""
        others = self.references.others[marker]
        own = known_medians(distances(positions[start:stop], marker, others))
        spread = np.maximum(self.spread[marker], 1.0)
        ratio = np.nan_to_num(np.abs(own - self.median[marker]) / spread)
        best = int(ratio.argmax())
        return InconsistentRun(
            marker,
            start,
            stop,
            int(others[best]),
            float(own[best]),
            float(self.median[marker, best]),
            float(self.spread[marker, best]),
        )


def _least_consistent(
    contradicted: NDArray[np.bool_],
    known: NDArray[np.bool_],
    references: ReferenceMarkers,
    least_share: float,
) -> NDArray[np.bool_]:
    """Return the samples that contradict a share of the others left [shape=(frames, markers)].

    In each frame, one marker after the other is taken out, the least consistent first.
    """
    removed = np.zeros(contradicted.shape[:2], dtype=bool)
    frames = np.flatnonzero(contradicted.any(axis=(1, 2)))
    while len(frames):
        gone = removed[frames]
        live = ~gone[:, references.others] & ~gone[:, :, None]
        count = (contradicted[frames] & live).sum(axis=2)
        total = (known[frames] & live).sum(axis=2)
        share = count / np.maximum(total, 1)
        score = np.where(share >= least_share, share + TIE_BREAK * count, 0.0)
        worst = score.argmax(axis=1)
        active = score[np.arange(len(frames)), worst] > 0
        frames, worst = frames[active], worst[active]
        removed[frames, worst] = True
    return removed


def _joined(
    wrong: NDArray[np.bool_], silent: NDArray[np.bool_], seen: NDArray[np.bool_], bridged: int
) -> list[tuple[int, int]]:
    """Return runs of wrong samples with short pauses and frames without evidence around them."""
    spans: list[tuple[int, int]] = []
    for first, last in runs(wrong):
        start, stop = first, last
        while start > 0 and silent[start - 1]:
            start -= 1
        while stop < len(silent) and silent[stop]:
            stop += 1
        if spans and start - spans[-1][1] <= bridged and seen[spans[-1][1] : start].all():
            start = spans.pop()[0]
        spans.append((start, stop))
    return spans
