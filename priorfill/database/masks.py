"""Which samples of a filled clip were filled, told by the clip with gaps."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import OptionError

if TYPE_CHECKING:
    from priorfill.clip import Clip
    from priorfill.database.record import ClipRecord
    from priorfill.database.store import PriorDatabase

__all__ = ["mask_by_database", "mask_by_original"]

SAME_MM = 0.05
"""mm by which a coordinate may differ where nothing was filled: a program that writes the filled
file with other numbers (whole steps of 0.1 mm) rounds it by so much."""

SAME_RATE = 1e-6
"""Relative difference of two rates that are the same but for rounding."""

TIME_TOLERANCE = 1e-6
"""Fraction of a frame by which two times may differ and be the same."""


def mask_by_original(clip: Clip, original: Clip) -> NDArray[np.bool_]:
    """Return which samples a filled clip has and the clip that it was filled from has not.

    Parameters
    ----------
    clip : Clip
        The filled one.
    original : Clip
        The one with gaps; its markers may be in another order.

    Returns
    -------
    ndarray of bool [shape=(frames, markers)]
        In the order of the filled clip.

    Raises
    ------
    OptionError
        Where it cannot have been filled from this one: another length, rate or marker, or a
        measured sample that is elsewhere or gone.
    """

    def other(what: str) -> OptionError:
        return OptionError(
            f"{clip.name}: was not filled from {original.name} (--original): {what}; "
            "give the file that it was filled from"
        )

    for one, two, has, than in (
        (clip, original, "has", "which is not in"),
        (original, clip, "has not", "which is in"),
    ):
        extra = [label for label in one.labels if label not in two.labels]
        if extra:
            raise other(f"it {has} marker {extra[0]}, {than} {original.name}")
    if clip.frames != original.frames:
        raise other(f"it has {clip.frames} frames, not {original.frames}")
    if abs(clip.rate - original.rate) > SAME_RATE * original.rate:
        raise other(f"it has {clip.rate:g} Hz, not {original.rate:g} Hz")
    order = [original.labels.index(label) for label in clip.labels]
    before, was_missing = original.positions[:, order], original.missing[:, order]
    lost: NDArray[np.bool_] = clip.missing & ~was_missing
    if lost.any():
        raise other(f"it misses {_sample(clip, lost)}")
    with np.errstate(invalid="ignore"):
        moved = np.abs(clip.positions - before).max(axis=2) > SAME_MM
    if moved.any():
        raise other(f"it has another position of {_sample(clip, moved)}")
    filled: NDArray[np.bool_] = was_missing & ~clip.missing
    return filled


def mask_by_database(clip: Clip, database: PriorDatabase) -> NDArray[np.bool_] | None:
    """Return which samples of a filled clip a database has not got as measured.

    Parameters
    ----------
    clip : Clip
        The filled one.
    database : PriorDatabase
        Where the version with gaps may be.

    Returns
    -------
    ndarray of bool [shape=(frames, markers)] or None
        None where the database has no version of the whole recording with these markers. Level 0
        has fewer frames than most clips: samples between two that are not measured are not either.

    Raises
    ------
    DatabaseCorruptError
        Where that version is damaged.
    """
    for record in database.versions(clip):
        if _is_whole(clip, record):
            database.check(record)
            order = [record.labels.index(label) for label in clip.labels]
            gone = np.isnan(database.positions(record)[:, :, 0])
            filled = database.filled(record)
            if filled is not None:
                gone = gone | filled
            return _at_frames(gone[:, order], clip, record.rate) & ~clip.missing
    return None


def _is_whole(clip: Clip, record: ClipRecord) -> bool:
    """Return whether a version is of every frame and marker of a clip, not of a part."""
    if abs(record.original_rate - clip.rate) > SAME_RATE * clip.rate:
        return False
    if record.original_frames:
        same_length = record.original_frames == clip.frames
    else:  # format version 1 did not keep it
        last = (clip.frames - 1) * record.rate / clip.rate
        same_length = record.frames[0] == math.floor(last + TIME_TOLERANCE) + 1
    return same_length and sorted(record.labels) == sorted(clip.labels)


def _at_frames(gone: NDArray[np.bool_], clip: Clip, rate: float) -> NDArray[np.bool_]:
    """Return at a clip's frames what is true at frames of another rate.

    It is true of the samples that surround the time of a true one, by which the database makes
    the same of it again, and of those between two true ones.
    """
    last = len(gone) - 1
    times = np.arange(clip.frames) * rate / clip.rate
    below = np.minimum(np.floor(times + TIME_TOLERANCE).astype(np.intp), last)
    above = np.minimum(np.ceil(times - TIME_TOLERANCE).astype(np.intp), last)
    result: NDArray[np.bool_] = gone[below] & gone[above]
    times = np.arange(len(gone)) * clip.rate / rate
    for beside in (np.floor(times + TIME_TOLERANCE), np.ceil(times - TIME_TOLERANCE)):
        frames = np.minimum(beside.astype(np.intp), clip.frames - 1)
        # two frames of the coarser rate may have the same sample beside them
        np.logical_or.at(result, frames, gone)
    return result


def _sample(clip: Clip, where: NDArray[np.bool_]) -> str:
    frame, marker = np.argwhere(where)[0]
    return f"{clip.labels[marker]} in frame {clip.first_frame + int(frame)}"
