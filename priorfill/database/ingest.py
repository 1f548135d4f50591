"""What is made of a clip before it is stored: levels, content hash, masks, counts."""

from __future__ import annotations

import hashlib
import json
import zlib

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.database.segments import DTYPE
from priorfill.errors import ClipError
from priorfill.geometry.axes import to_upright

__all__ = ["content_hash", "counts", "filled_at_level_0", "levels_of", "pack", "unpack"]

MIN_RATE_SHARE = 0.5
"""A clip whose rate is below this share of the database's is refused: more than half of
its samples would be invented."""

MIN_FRAMES = 2
"""Frames that a clip needs at the coarsest level: below, it has no velocity there."""

STATIC_RANGE = 10.0
"""mm. A clip in which no marker leaves a box with this diagonal shows no motion; someone who
stands still sways more within a few seconds."""


def levels_of(clip: Clip, rate: float, levels: int) -> list[NDArray[np.float32]]:
    """Return a clip's positions at every level as they are stored.

    Parameters
    ----------
    clip : Clip
        At any rate, with any axis up.
    rate, levels
        The database's.

    Returns
    -------
    list of ndarray [shape=(frames, markers, 3), mm]
        Upright, NaN where missing, finest first.

    Raises
    ------
    ClipError
        Where no marker is ever seen, or the clip is static, too short or of too low a rate.
    """
    from priorfill.signal.resample import pyramid, resample

    missing = clip.missing
    if missing.all():
        raise ClipError(f"{clip.name}: no marker is ever seen; there is nothing to add")
    if clip.rate < MIN_RATE_SHARE * rate:
        raise ClipError(
            f"{clip.name}: has {clip.rate:g} Hz, too few for a database of {rate:g} Hz; "
            f"add clips of {MIN_RATE_SHARE * rate:g} Hz or more"
        )
    seen = ~missing.all(axis=0)
    extent = np.nanmax(clip.positions[:, seen], axis=0) - np.nanmin(clip.positions[:, seen], axis=0)
    fine = resample(to_upright(clip.positions, clip.up), clip.rate, rate)
    stored = [level.positions.astype(DTYPE) for level in pyramid(fine, rate, levels)]
    if len(stored[-1]) < MIN_FRAMES:
        raise ClipError(
            f"{clip.name}: is too short ({clip.duration:.2f} s) for the database's coarsest "
            f"level of {rate / 2 ** (levels - 1):g} Hz; add a longer clip"
        )
    if np.linalg.norm(extent, axis=1).max() < STATIC_RANGE:
        raise ClipError(
            f"{clip.name}: is static (no marker moves by {STATIC_RANGE:g} mm); "
            "add clips with motion"
        )
    return stored


def content_hash(clip: Clip) -> str:
    """Return the SHA-256 of a clip's labels, rate and positions."""
    digest = hashlib.sha256()
    digest.update(json.dumps([clip.labels, clip.rate]).encode())
    # NaN has many bit patterns; all of them mean missing
    positions = np.where(np.isnan(clip.positions), np.nan, clip.positions)
    digest.update(np.ascontiguousarray(positions, dtype="<f8").tobytes())
    return digest.hexdigest()


def filled_at_level_0(clip: Clip, filled: NDArray[np.bool_], rate: float) -> NDArray[np.bool_]:
    """Return which samples of level 0 have a synthesised sample beside them.

    Parameters
    ----------
    clip : Clip
        The clip.
    filled : ndarray of bool [shape=(frames, markers)]
        Its synthesised samples.
    rate : float
        Of level 0 (Hz).
    """
    from priorfill.signal.resample import resample

    marked = np.where(filled[:, :, None], np.nan, np.zeros(3))
    # resample makes a sample missing where one that surrounds its time is: the rule wanted
    result: NDArray[np.bool_] = np.isnan(resample(marked, clip.rate, rate)[:, :, 0])
    return result


def counts(
    positions: NDArray[np.float32], filled: NDArray[np.bool_] | None
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return in how many frames each marker has a position, and a measured one.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        Level 0.
    filled : ndarray of bool [shape=(frames, markers)] or None
        Which of its samples were synthesised.
    """
    present = ~np.isnan(positions[..., 0])
    measured = present if filled is None else present & ~filled
    return (
        tuple(int(n) for n in present.sum(axis=0)),
        tuple(int(n) for n in measured.sum(axis=0)),
    )


def pack(mask: NDArray[np.bool_]) -> bytes:
    """Return a mask in few bytes."""
    return zlib.compress(np.packbits(mask).tobytes())


def unpack(packed: bytes, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Return the mask of a shape that was packed.

    Raises
    ------
    zlib.error, ValueError
        Where the bytes are no such mask.
    """
    bits = np.frombuffer(zlib.decompress(packed), dtype=np.uint8)
    return np.unpackbits(bits, count=shape[0] * shape[1]).reshape(shape).astype(bool)
