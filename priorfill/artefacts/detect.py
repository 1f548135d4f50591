"""Find all artefacts of a clip: each detector sees the clip without the artefacts found so far."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from priorfill.artefacts.artefact import (
    JUMP,
    LABEL_SWAP,
    MISLABELLED,
    SPIKE,
    STUCK,
    Artefact,
)
from priorfill.artefacts.artefact_options import DEFAULT_ARTEFACT_OPTIONS, ArtefactOptions
from priorfill.artefacts.discontinuities import PathBreaks, find_breaks
from priorfill.artefacts.distance_outliers import distance_outliers
from priorfill.artefacts.inconsistent_labels import find_inconsistent_labels, thin_frames
from priorfill.artefacts.label_swaps import find_label_swaps, swap_labels
from priorfill.artefacts.marker_path import MarkerPath
from priorfill.artefacts.mislabelled import find_mislabelled
from priorfill.artefacts.outlier_runs import OutlierRun, outlier_runs
from priorfill.artefacts.reference_markers import ReferenceMarkers, choose_reference_markers
from priorfill.artefacts.stuck import find_stuck
from priorfill.clip import Clip
from priorfill.geometry.neighbourhoods import MAX_DENSE_MARKERS, neighbourhoods
from priorfill.runtime.argument_types import check_type
from priorfill.runtime.threads import map_in_threads

__all__ = ["artefact_samples", "find_artefacts", "without_artefacts"]


def find_artefacts(
    clip: Clip, *, options: ArtefactOptions = DEFAULT_ARTEFACT_OPTIONS
) -> tuple[Artefact, ...]:
    """Find measured samples that cannot belong to the marker they are labelled as.

    Parameters
    ----------
    clip : Clip
        Any clip; its up axis makes no difference.
    options : ArtefactOptions
        Thresholds of the detectors.

    Returns
    -------
    tuple of Artefact
        In order of time.

    See Also
    --------
    artefact_samples : The samples concerned, as a mask.
    without_artefacts : The clip with these samples missing.
    fill : Fills them too, with ``reject_artefacts=True``.

    Examples
    --------
    >>> time = np.arange(120)[:, None, None] / 120.0
    >>> positions = np.array([[0, 0, 0], [80, 0, 0], [0, 60, 0.0]]) + 300.0 * np.sin(3.0 * time)
    >>> positions[50:53, 0, 2] += 90.0
    >>> [spike] = find_artefacts(Clip(positions, ("A", "B", "C"), rate=120.0))
    >>> spike.kind, spike.markers, spike.start, spike.stop
    ('spike', ('A',), 50, 53)
    """
    check_type("clip", clip, Clip, "a Clip; read a file with priorfill.read")
    if len(clip.labels) > MAX_DENSE_MARKERS:
        return _find_in_parts(clip, options)
    references = choose_reference_markers(clip.positions, options.reference_markers)

    def breaks_of(positions: NDArray[np.float64]) -> PathBreaks:
        return find_breaks(positions, references, clip.rate, options.breaks)

    positions, stuck = _remove_stuck(clip, references, options)
    breaks = breaks_of(positions)
    positions, swaps = _undo_swaps(clip, positions, references, breaks, options)
    if swaps:
        breaks = breaks_of(positions)
    positions, mislabelled = _remove_mislabelled(clip, positions, references, breaks, options)
    if mislabelled:
        breaks = breaks_of(positions)
    elsewhere = _find_outlier_runs(clip, positions, references, breaks, options)
    wrong = artefact_samples(elsewhere, clip.labels, clip.frames)
    inconsistent = _find_inconsistent(clip, positions, wrong, options)
    return _in_order([*stuck, *swaps, *mislabelled, *inconsistent, *elsewhere])


def _in_order(artefacts: Iterable[Artefact]) -> tuple[Artefact, ...]:
    """Return artefacts in order of time."""
    return tuple(sorted(artefacts, key=lambda found: (found.start, found.stop, found.markers)))


def _find_in_parts(clip: Clip, options: ArtefactOptions) -> tuple[Artefact, ...]:
    """Find the artefacts of very many markers neighbourhood by neighbourhood."""
    found: list[Artefact] = []
    for group in neighbourhoods(clip.positions):
        labels = tuple(clip.labels[marker] for marker in group)
        part = replace(clip, labels=labels, positions=clip.positions[:, group])
        found += find_artefacts(part, options=options)
    return _in_order(found)


def artefact_samples(
    artefacts: Iterable[Artefact], labels: Sequence[str], frames: int
) -> NDArray[np.bool_]:
    """Return which samples belong to artefacts.

    Parameters
    ----------
    artefacts : iterable of Artefact
        As returned by `find_artefacts`.
    labels : sequence of str
        The clip's labels.
    frames : int
        The clip's length.

    Returns
    -------
    ndarray of bool [shape=(frames, markers)]

    Examples
    --------
    >>> artefact_samples([Artefact("spike", ("B",), 1, 2, 50.0)], ("A", "B"), 3).tolist()
    [[False, False], [False, True], [False, False]]
    """
    column = {label: marker for marker, label in enumerate(labels)}
    samples = np.zeros((frames, len(labels)), dtype=bool)
    for artefact in artefacts:
        for label in artefact.markers:
            samples[artefact.start : artefact.stop, column[label]] = True
    return samples


def without_artefacts(
    clip: Clip, *, options: ArtefactOptions = DEFAULT_ARTEFACT_OPTIONS
) -> tuple[Clip, tuple[Artefact, ...]]:
    """Return the clip with the samples of artefacts missing, and the artefacts.

    Parameters and artefacts as for `find_artefacts`.
    """
    artefacts = find_artefacts(clip, options=options)
    if not artefacts:
        return clip, artefacts
    samples = artefact_samples(artefacts, clip.labels, clip.frames)
    return clip.with_positions(np.where(samples[..., None], np.nan, clip.positions)), artefacts


def _remove_stuck(
    clip: Clip, references: ReferenceMarkers, options: ArtefactOptions
) -> tuple[NDArray[np.float64], list[Artefact]]:
    """Return the positions without stuck samples, and these artefacts."""
    stuck = find_stuck(clip.positions, references, options.stuck)
    positions = clip.positions.copy() if stuck else clip.positions
    artefacts = []
    for run in stuck:
        positions[run.start : run.stop, run.marker] = np.nan
        marker, reference = clip.labels[run.marker], clip.labels[run.reference]
        artefacts.append(Artefact(STUCK, (marker,), run.start, run.stop, run.shift, reference))
    return positions, artefacts


def _undo_swaps(
    clip: Clip,
    positions: NDArray[np.float64],
    references: ReferenceMarkers,
    breaks: PathBreaks,
    options: ArtefactOptions,
) -> tuple[NDArray[np.float64], list[Artefact]]:
    """Return the positions with swapped labels exchanged, and these artefacts."""
    swaps = find_label_swaps(positions, breaks.broken, references, options.max_miss_ratio)
    artefacts = []
    for swap in swaps:
        pair = clip.labels[swap.first], clip.labels[swap.second]
        artefacts.append(Artefact(LABEL_SWAP, pair, swap.start, swap.stop, swap.distance))
    return swap_labels(positions, swaps) if swaps else positions, artefacts


def _remove_mislabelled(
    clip: Clip,
    positions: NDArray[np.float64],
    references: ReferenceMarkers,
    breaks: PathBreaks,
    options: ArtefactOptions,
) -> tuple[NDArray[np.float64], list[Artefact]]:
    """Return the positions without labels that moved to another marker, and these artefacts."""
    large = breaks.size >= options.outlier_runs.min_long_break
    found = find_mislabelled(positions, large, references, options.max_miss_ratio)
    if not found:
        return positions, []
    positions = positions.copy()
    artefacts = []
    for run in found:
        positions[run.start : run.stop, run.marker] = np.nan
        marker, actual = clip.labels[run.marker], clip.labels[run.actual]
        artefacts.append(Artefact(MISLABELLED, (marker,), run.start, run.stop, run.jump, actual))
    return positions, artefacts


def _find_outlier_runs(
    clip: Clip,
    positions: NDArray[np.float64],
    references: ReferenceMarkers,
    breaks: PathBreaks,
    options: ArtefactOptions,
) -> list[Artefact]:
    """Return spikes, jumps and mislabelled ends of paths."""
    far = distance_outliers(positions, references, options.distance_outliers)
    missing = np.isnan(positions[:, :, 0])
    cut = np.flatnonzero(breaks.broken.any(axis=0) | missing.any(axis=0)).tolist()

    def of_marker(marker: int) -> list[Artefact]:
        path = MarkerPath(positions, marker, references.of(marker), clip.rate, options.outlier_runs)
        seen = np.flatnonzero(~missing[:, marker])
        found = outlier_runs(path, breaks.size[:, marker], far.get(marker))
        return [_from_outlier_run(run, clip.labels, seen) for run in found]

    with map_in_threads(positions.size) as mapped:
        return [one for found in mapped(of_marker, sorted({*cut, *far})) for one in found]


def _find_inconsistent(
    clip: Clip,
    positions: NDArray[np.float64],
    wrong: NDArray[np.bool_],
    options: ArtefactOptions,
) -> list[Artefact]:
    """Return the wrong labels next to blackouts that the other detectors leave.

    ``wrong`` are the samples that these found [shape=(frames, markers)].
    """
    seen = ~(np.isnan(positions[:, :, 0]) | wrong)
    if not thin_frames(seen, clip.rate, options.inconsistent_labels).any():
        return []
    if wrong.any():
        positions = np.where(wrong[..., None], np.nan, positions)
    return [
        Artefact(
            MISLABELLED,
            (clip.labels[run.marker],),
            run.start,
            run.stop,
            0.0,
            clip.labels[run.reference],
            run.distance,
            run.typical_distance,
            run.spread,
        )
        for run in find_inconsistent_labels(positions, clip.rate, options.inconsistent_labels)
    ]


def _from_outlier_run(run: OutlierRun, labels: Sequence[str], seen: NDArray[np.intp]) -> Artefact:
    """Classify an outlier run; ``seen`` are the frames in which the marker is measured."""
    kind = SPIKE if run.spike else JUMP
    if not run.spike and (run.start == seen[0] or run.stop == seen[-1] + 1):
        kind = MISLABELLED
    return Artefact(
        kind,
        (labels[run.marker],),
        run.start,
        run.stop,
        run.size,
        labels[run.reference] if run.reference != run.marker else "",
        run.distance,
        run.typical_distance,
        run.spread,
    )
