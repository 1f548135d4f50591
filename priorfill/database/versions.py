"""Which of two versions of one recording a database keeps.

A recording may be added as it was captured, with gaps, and again with its gaps filled. A database
keeps one version: the one with more samples, provided that no measured sample is replaced by a
filled one. A version in which all of them are measured replaces a filled one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from priorfill.database.record import ClipRecord

__all__ = ["is_same_fill", "reason_to_keep"]

SAME_PLACE = 0.01
"""mm. Maximum change of a filled sample that was written to a file and read again; a measured one
is rarely so near a fill."""


def reason_to_keep(
    old: ClipRecord, new: ClipRecord, *, accepted: bool, is_same_fill: Callable[[], bool]
) -> str:
    """Return why a database keeps the version it has; empty if the new one replaces it.

    Parameters
    ----------
    old, new : ClipRecord
        Versions of one recording.
    accepted : bool
        Whether the user accepts the new version's filled samples.
    is_same_fill : callable
        Returns whether samples that are filled in the old version have the same values in the new
        one, which then was written without saying which are filled.

    Returns
    -------
    str
        The end of a sentence about the new version.
    """
    as_name = f"(as {old.name})"
    if old.content == new.content:
        if accepted and new.measured != old.measured:
            return ""  # the mask of filled samples is new
        return f"is in the database already {as_name}; nothing to do"
    if not new.has_filled:
        if old.has_filled:
            if _measures_all(old, new) and not is_same_fill():
                return ""
            return f"is in the database already, filled {as_name}; nothing to do"
        if sum(new.present) > sum(old.present):
            return (
                f"is in the database already with more gaps {as_name}; if they were filled since, "
                "accept it (priorfill db accept), otherwise remove the other first"
            )
        return f"is in the database already {as_name}, with as many samples or more; nothing to do"
    if any(o > n for o, n in zip(old.measured, new.measured, strict=False)):
        return (
            f"is in the database already {as_name}, with samples measured that are filled here; "
            "nothing to do"
        )
    if old.has_filled and not accepted:
        return (
            f"is in the database already, filled {as_name}; "
            "to put this one in its place, accept it (priorfill db accept)"
        )
    return ""


def _measures_all(old: ClipRecord, new: ClipRecord) -> bool:
    """Return whether a version has measured every sample that another one has."""
    measured = dict(zip(new.labels, new.measured, strict=True))
    return old.original_frames == new.original_frames and all(
        measured.get(label, -1) >= number
        for label, number in zip(old.labels, old.present, strict=True)
    )


def is_same_fill(
    old: NDArray[np.float32],
    filled: NDArray[np.bool_],
    new: NDArray[np.float32],
    order: Sequence[int],
) -> bool:
    """Return whether most of the filled samples of a version have the same place in another one.

    Parameters
    ----------
    old, new : ndarray [shape=(frames, markers, 3), mm]
        The versions.
    filled : ndarray of bool [shape=(frames, markers)]
        The filled samples of the old one.
    order : sequence of int
        For each marker of the old version, its number in the new one.
    """
    frames = min(len(old), len(new))
    with np.errstate(invalid="ignore"):
        moved = np.abs(old[:frames] - new[:frames, list(order)]).max(axis=2)[filled[:frames]]
    return bool((moved < SAME_PLACE).mean() >= 0.5) if moved.size else True
