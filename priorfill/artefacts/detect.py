"""All trouble of a clip: each detector looks at what those before it have left."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from priorfill.artefacts.artefact import (
    FROZEN,
    JUMP,
    RELABELLED,
    SPIKE,
    SWAPPED,
    Artefact,
)
from priorfill.artefacts.discontinuities import find_breaks
from priorfill.artefacts.distance_outliers import distance_outliers
from priorfill.artefacts.frozen import frozen_runs
from priorfill.artefacts.label_swaps import exchange, find_swaps
from priorfill.artefacts.label_takeovers import find_takeovers
from priorfill.artefacts.outlier_runs import LEAST_LONG, OutlierRun, outlier_runs
from priorfill.artefacts.reference_markers import choose_reference_markers
from priorfill.clip import Clip

__all__ = ["artefact_samples", "find_artefacts", "without_artefacts"]


def find_artefacts(clip: Clip) -> tuple[Artefact, ...]:
    """Find measured samples that cannot be what they are labelled as.

    Parameters
    ----------
    clip : Clip
        Any clip; which way is up makes no difference.

    Returns
    -------
    tuple of Trouble
        In order of time.
    """
    positions = clip.positions
    partners = choose_reference_markers(positions)
    found = []
    frozen = frozen_runs(positions, partners)
    if frozen:
        positions = positions.copy()
        for run in frozen:
            positions[run.start : run.stop, run.marker] = np.nan
            found.append(
                Artefact(
                    FROZEN,
                    (clip.labels[run.marker],),
                    run.start,
                    run.stop,
                    run.moved,
                    clip.labels[run.partner],
                )
            )
    breaks = find_breaks(positions, partners, clip.rate)
    swaps = find_swaps(positions, breaks.broken)
    if swaps:
        positions = exchange(positions, swaps)
        breaks = find_breaks(positions, partners, clip.rate)
        found += [
            Artefact(
                SWAPPED,
                (clip.labels[swap.one], clip.labels[swap.other]),
                swap.start,
                swap.stop,
                swap.apart,
            )
            for swap in swaps
        ]
    takeovers = find_takeovers(positions, breaks.size >= LEAST_LONG)
    if takeovers:
        positions = positions.copy()
        for takeover in takeovers:
            positions[takeover.start : takeover.stop, takeover.marker] = np.nan
            found.append(
                Artefact(
                    RELABELLED,
                    (clip.labels[takeover.marker],),
                    takeover.start,
                    takeover.stop,
                    takeover.apart,
                    clip.labels[takeover.other],
                )
            )
        breaks = find_breaks(positions, partners, clip.rate)
    far = distance_outliers(positions, partners)
    gone = np.isnan(positions[:, :, 0])
    worth = np.flatnonzero(breaks.broken.any(axis=0) | gone.any(axis=0)).tolist()
    for marker in sorted({*worth, *far}):
        strays = outlier_runs(
            positions,
            marker,
            partners.of(marker),
            breaks.size[:, marker],
            far.get(marker),
            clip.rate,
        )
        seen = np.flatnonzero(~gone[:, marker])
        found += [_of_stray(stray, clip.labels, seen) for stray in strays]
    return tuple(
        sorted(found, key=lambda artefacts: (artefacts.start, artefacts.stop, artefacts.markers))
    )


def artefact_samples(
    artefacts: Iterable[Artefact], labels: Sequence[str], frames: int
) -> NDArray[np.bool_]:
    """Return which samples trouble is about [shape=(frames, markers)].

    Parameters
    ----------
    trouble : iterable of Trouble
        As from `find_artefacts`.
    labels : sequence of str
        The clip's.
    frames : int
        The clip's.
    """
    column = {label: marker for marker, label in enumerate(labels)}
    samples = np.zeros((frames, len(labels)), dtype=bool)
    for one in artefacts:
        for label in one.markers:
            samples[one.start : one.stop, column[label]] = True
    return samples


def without_artefacts(clip: Clip) -> tuple[Clip, tuple[Artefact, ...]]:
    """Return a clip in which the samples in trouble are missing, and the trouble."""
    artefacts = find_artefacts(clip)
    if not artefacts:
        return clip, artefacts
    samples = artefact_samples(artefacts, clip.labels, clip.frames)
    return clip.with_positions(np.where(samples[..., None], np.nan, clip.positions)), artefacts


def _of_stray(stray: OutlierRun, labels: Sequence[str], seen: NDArray[np.intp]) -> Artefact:
    """Say of a stray piece what kind of trouble it is."""
    kind = SPIKE if stray.short else JUMP
    if not stray.short and (stray.start == seen[0] or stray.stop == seen[-1] + 1):
        kind = RELABELLED
    return Artefact(
        kind,
        (labels[stray.marker],),
        stray.start,
        stray.stop,
        stray.size,
        labels[stray.judge] if stray.judge != stray.marker else "",
        stray.distance,
        stray.usual,
        stray.spread,
    )
