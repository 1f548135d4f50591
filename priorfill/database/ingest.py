"""Prepare a clip for storage: levels, content hash, mask of filled samples, catalogue row."""

from __future__ import annotations

import zlib
from datetime import UTC, datetime
from importlib import metadata

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.database.catalogue_rows import CatalogueRow
from priorfill.database.content_hash import content_hash
from priorfill.database.record import ClipRecord
from priorfill.database.segments import DTYPE
from priorfill.database.sketch import sketch
from priorfill.errors import ClipError, OptionError
from priorfill.geometry.axes import to_upright

__all__ = ["ingest", "stored_levels", "unpack_mask"]

MIN_RATE_RATIO = 0.5
"""Minimum rate of a clip, relative to the database's: below it, resampling would invent more than
half of the samples."""

MIN_FRAMES = 2
"""Minimum number of frames at the coarsest level, needed for a velocity."""

MIN_EXTENT = 10.0
"""mm. Minimum diagonal of the box that some marker's path fills; even a person who stands still
sways more within a few seconds."""


def ingest(
    clip: Clip, rate: float, levels: int, filled: NDArray[np.bool_] | None, filled_by: str
) -> tuple[list[bytes], CatalogueRow]:
    """Return what a database stores of a clip.

    Parameters
    ----------
    clip : Clip
        The clip, at any rate and with any axis up.
    rate : float
        The database's rate (Hz).
    levels : int
        Its number of levels.
    filled : ndarray of bool [shape=(frames, markers)] or None
        The clip's filled samples.
    filled_by : str
        The method that filled them.

    Returns
    -------
    blocks : list of bytes
        The positions of each level.
    row : CatalogueRow
        Its record has the clip's own subject and source; session, licence and credit are empty,
        and it has no place in a segment.

    Raises
    ------
    ClipError
        As for `stored_levels`.
    OptionError
        If `filled` does not have the shape of the clip.
    """
    # scipy takes longer to import than a database to open, and only adding needs it
    from priorfill.markers.definitions import recognise

    if filled is not None and filled.shape != clip.missing.shape:
        raise OptionError(
            f"{clip.name}: the mask of filled samples has shape {filled.shape}; "
            f"{clip.missing.shape} is needed"
        )
    positions = stored_levels(clip, rate, levels)
    mask = None
    if filled is not None and (filled & ~clip.missing).any():
        mask = _filled_at_level_0(clip, filled, rate) & ~np.isnan(positions[0][..., 0])
        mask = mask if mask.any() else None  # the gap lies between two frames of level 0
    present, measured = _sample_counts(positions[0], mask)
    marker_set = recognise(clip.labels)
    blocks = [level.tobytes() for level in positions]
    record = ClipRecord(
        content=content_hash(clip),
        name=clip.name,
        subject=clip.subject,
        session="",
        source=clip.source.path.name if clip.source is not None else "",
        licence="",
        credit="",
        original_rate=float(clip.rate),
        original_frames=clip.frames,
        rate=rate,
        frames=tuple(len(level) for level in positions),
        labels=clip.labels,
        marker_set=marker_set.name if marker_set is not None else "",
        filled_by="" if mask is None else filled_by or "unknown",
        present=present,
        measured=measured,
        added=datetime.now(UTC).isoformat(timespec="seconds"),
        version=metadata.version("priorfill"),
        synthetic=False,
        virtual_markers=False,
        segment=0,
        offset=0,
        checksums=tuple(zlib.crc32(block) for block in blocks),
    )
    packed = None if mask is None else _pack_mask(mask)
    return blocks, CatalogueRow(record, packed, sketch(clip.positions))


def stored_levels(clip: Clip, rate: float, levels: int) -> list[NDArray[np.float32]]:
    """Return a clip's positions at every level, as they are stored.

    Parameters
    ----------
    clip : Clip
        The clip, at any rate and with any axis up.
    rate : float
        The database's rate (Hz).
    levels : int
        Its number of levels.

    Returns
    -------
    list of ndarray [shape=(frames, markers, 3), mm]
        Upright (+Z up), NaN where missing, finest level first.

    Raises
    ------
    ClipError
        If no marker is ever seen, or the clip is static, too short, or its rate too low.
    """
    from priorfill.signal.resample import pyramid, resample

    missing = clip.missing
    if missing.all():
        raise ClipError(f"{clip.name}: no marker is ever seen; there is nothing to add")
    if clip.rate < MIN_RATE_RATIO * rate:
        raise ClipError(
            f"{clip.name}: has {clip.rate:g} Hz, too few for a database of {rate:g} Hz; "
            f"add clips of {MIN_RATE_RATIO * rate:g} Hz or more"
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
    if np.linalg.norm(extent, axis=1).max() < MIN_EXTENT:
        raise ClipError(
            f"{clip.name}: is static (no marker moves by {MIN_EXTENT:g} mm); add clips with motion"
        )
    return stored


def _filled_at_level_0(clip: Clip, filled: NDArray[np.bool_], rate: float) -> NDArray[np.bool_]:
    """Return which samples of level 0 are interpolated from a filled sample."""
    from priorfill.signal.resample import resample

    marked = np.where(filled[:, :, None], np.nan, np.zeros(3))
    # resample makes a sample missing if one that surrounds its time is
    result: NDArray[np.bool_] = np.isnan(resample(marked, clip.rate, rate)[:, :, 0])
    return result


def _sample_counts(
    positions: NDArray[np.float32], filled: NDArray[np.bool_] | None
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the number of present and of measured samples of each marker at level 0."""
    present = ~np.isnan(positions[..., 0])
    measured = present if filled is None else present & ~filled
    return (
        tuple(int(n) for n in present.sum(axis=0)),
        tuple(int(n) for n in measured.sum(axis=0)),
    )


def _pack_mask(mask: NDArray[np.bool_]) -> bytes:
    """Return a compressed mask."""
    return zlib.compress(np.packbits(mask).tobytes())


def unpack_mask(packed: bytes, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Return the mask of a shape from its compressed form.

    Raises
    ------
    zlib.error, ValueError
        If the bytes are not such a mask.
    """
    bits = np.frombuffer(zlib.decompress(packed), dtype=np.uint8)
    return np.unpackbits(bits, count=shape[0] * shape[1]).reshape(shape).astype(bool)
