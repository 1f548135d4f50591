"""Find out which samples of a filled clip were filled, by comparison with the clip with gaps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import OptionError

if TYPE_CHECKING:
    from priorfill.clip import Clip
    from priorfill.database.prior_database import PriorDatabase
    from priorfill.database.record import ClipRecord

__all__ = ["mask_by_database", "mask_by_original"]

POSITION_TOLERANCE = 0.05
"""mm. Maximum difference of a coordinate that was not filled: a program that writes the filled file
in integer steps of 0.1 mm rounds by this much."""

RATE_TOLERANCE = 1e-6
"""Maximum relative difference of two equal rates due to rounding."""

TIME_TOLERANCE = 1e-6
"""Maximum difference of two equal times, as a fraction of a frame."""


def mask_by_original(clip: Clip, original: Clip) -> NDArray[np.bool_]:
    """Return which samples a filled clip has that are missing in the clip it was filled from.

    Parameters
    ----------
    clip : Clip
        The filled clip.
    original : Clip
        The clip with gaps; its markers may be in another order.

    Returns
    -------
    ndarray of bool [shape=(frames, markers)]
        In the order of the filled clip.

    Raises
    ------
    OptionError
        If the clip cannot have been filled from this original: its length, rate or markers differ,
        or a measured sample was moved or removed.
    """

    def mismatch(what: str) -> OptionError:
        return OptionError(
            f"{clip.name}: was not filled from {original.name} (`original`): {what}; "
            "give the file that it was filled from"
        )

    for one, two, has, than in (
        (clip, original, "has", "which is not in"),
        (original, clip, "has not", "which is in"),
    ):
        extra = [label for label in one.labels if label not in two.labels]
        if extra:
            raise mismatch(f"it {has} marker {extra[0]}, {than} {original.name}")
    if clip.frames != original.frames:
        raise mismatch(f"it has {clip.frames} frames, not {original.frames}")
    if abs(clip.rate - original.rate) > RATE_TOLERANCE * original.rate:
        raise mismatch(f"it has {clip.rate:g} Hz, not {original.rate:g} Hz")
    order = [original.labels.index(label) for label in clip.labels]
    before, was_missing = original.positions[:, order], original.missing[:, order]
    lost: NDArray[np.bool_] = clip.missing & ~was_missing
    if lost.any():
        raise mismatch(f"it lacks {_describe_first(clip, lost)}")
    with np.errstate(invalid="ignore"):
        moved = np.abs(clip.positions - before).max(axis=2) > POSITION_TOLERANCE
    if moved.any():
        raise mismatch(f"it has another position of {_describe_first(clip, moved)}")
    filled: NDArray[np.bool_] = was_missing & ~clip.missing
    return filled


def mask_by_database(clip: Clip, database: PriorDatabase) -> NDArray[np.bool_] | None:
    """Return which samples of a filled clip are not measured in a database's version of it.

    Parameters
    ----------
    clip : Clip
        The filled clip.
    database : PriorDatabase
        A database that may have the version with gaps.

    Returns
    -------
    ndarray of bool [shape=(frames, markers)] or None
        None if the database has no version of the complete recording with these markers. Level 0
        has fewer frames than most clips: samples between two that are not measured count as not
        measured.

    Raises
    ------
    DatabaseCorruptError
        If that version is damaged.
    """
    for record in database.versions(clip):
        if _is_complete(clip, record):
            database.check(record)
            order = [record.labels.index(label) for label in clip.labels]
            not_measured = np.isnan(database.positions(record)[:, :, 0])
            filled = database.filled(record)
            if filled is not None:
                not_measured = not_measured | filled
            return _at_clip_frames(not_measured[:, order], clip, record.rate) & ~clip.missing
    return None


def _is_complete(clip: Clip, record: ClipRecord) -> bool:
    """Return whether a version has all frames and markers of a clip, not only a part."""
    return (
        abs(record.original_rate - clip.rate) <= RATE_TOLERANCE * clip.rate
        and record.original_frames == clip.frames
        and sorted(record.labels) == sorted(clip.labels)
    )


def _at_clip_frames(mask: NDArray[np.bool_], clip: Clip, rate: float) -> NDArray[np.bool_]:
    """Convert a mask at another rate to a clip's frames.

    True are the samples that surround the time of a true one, because adding the clip to a database
    then gives the same mask, and those between two true ones.
    """
    last = len(mask) - 1
    times = np.arange(clip.frames) * rate / clip.rate
    below = np.minimum(np.floor(times + TIME_TOLERANCE).astype(np.intp), last)
    above = np.minimum(np.ceil(times - TIME_TOLERANCE).astype(np.intp), last)
    result: NDArray[np.bool_] = mask[below] & mask[above]
    times = np.arange(len(mask)) * clip.rate / rate
    for adjacent in (np.floor(times + TIME_TOLERANCE), np.ceil(times - TIME_TOLERANCE)):
        frames = np.minimum(adjacent.astype(np.intp), clip.frames - 1)
        # two frames of the coarser rate may be adjacent to the same sample
        np.logical_or.at(result, frames, mask)
    return result


def _describe_first(clip: Clip, where: NDArray[np.bool_]) -> str:
    frame, marker = np.argwhere(where)[0]
    return f"{clip.labels[marker]} in frame {clip.first_frame + int(frame)}"
