"""Other recordings of the clip's subject: which of them a fill may learn from, and notes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from priorfill.clip import Clip
from priorfill.database.sketch import is_version, sketch
from priorfill.errors import OptionError
from priorfill.markers.body_measures import MAX_DIFFERENCE, compare_bodies
from priorfill.markers.marker_set import MarkerSet
from priorfill.search.takes import Take, same_subject_take

__all__ = ["same_subject_takes"]


def same_subject_takes(
    clip: Clip, others: Sequence[Clip], definition: MarkerSet | None
) -> tuple[tuple[Take, ...], tuple[str, ...]]:
    """Return the takes of other recordings of the clip's subject, and notes on those left out.

    Parameters
    ----------
    clip : Clip
        The clip to be filled.
    others : sequence of Clip
        Recordings said to be of its subject.
    definition : MarkerSet or None
        The marker set.

    Returns
    -------
    takes : tuple of Take
        Without recordings of another subject or another placement of the markers, recognised by
        the body measures, and without versions of the clip's own recording.
    notes : tuple of str
        Why a recording was left out, or could not be compared.

    Raises
    ------
    OptionError
        If a recording is the clip itself.
    ClipError
        If a recording has no marker in common with the clip.
    """
    takes, notes = [], []
    for other in others:
        if other is clip or (
            other.labels == clip.labels
            and np.array_equal(other.positions, clip.positions, equal_nan=True)
        ):
            raise OptionError(
                f"{other.name}: is the clip to be filled; give another recording of the same "
                "subject"
            )
        take = same_subject_take(other, clip.labels, definition, clip.subject)
        if _is_version(clip, other):
            notes.append(f"{other.name}: is of the same recording as the clip; not learnt from")
            continue
        bodies = compare_bodies(
            (clip.positions, clip.labels), (other.positions, other.labels), definition
        )
        if bodies.differs:
            notes.append(
                f"{other.name}: shows another subject or other marker positions than the clip "
                f"({bodies.measures} distances within the body differ by "
                f"{bodies.difference:.0f} mm in the median; of one subject, with markers attached "
                f"anew, by up to {MAX_DIFFERENCE:.0f} mm); not learnt from"
            )
            continue
        if math.isnan(bodies.difference):
            notes.append(
                f"{other.name}: has too few body measures in common with the clip to check that "
                "it shows the same subject"
            )
        takes.append(take)
    return tuple(takes), tuple(notes)


def _is_version(clip: Clip, other: Clip) -> bool:
    """Return whether two clips hold the same measured samples."""
    one, two = sketch(clip.positions), sketch(other.positions)
    shared = len(np.intersect1d(one, two, assume_unique=True))
    return is_version(shared, len(one), len(two), same_length=clip.frames == other.frames)
