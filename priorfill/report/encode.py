"""Arrays as the page reads them: positions, states and expected errors, small enough for one file.

Whole numbers of 0.1 mm are differenced twice over time, which leaves little more than the noise of
the cameras, divided into planes of bytes, deflated and written as base64. ``page/decode.js`` reads
them.
"""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["BLOCK_FRAMES", "STEP_MM", "encode_positions", "encode_runs", "encode_sparse"]

STEP_MM = 0.1
"""mm. Unit of stored lengths: far below what a picture shows, and below the noise of cameras."""

BLOCK_FRAMES = 512
"""Frames that are coded together: the first picture needs one block only, and longer blocks are
hardly smaller."""

UNKNOWN = 65535
"""Stored in place of an error that is unknown."""

MAX_ERROR = UNKNOWN - 1
"""Largest stored error, 6.5 m; larger ones are shown as this one."""

MAX_POSITION = 2**31 - 1
"""Largest stored coordinate, 215 km; larger ones are shown there."""

_LEVEL = 9
"""Deflate slowly: a page is written once, and read often."""


def encode_positions(positions: NDArray[np.float64], block: int = BLOCK_FRAMES) -> dict[str, Any]:
    """Return positions in coding ``delta2``.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing; a missing sample is stored at the last known position, or the origin.
    block : int
        Frames that are coded together.
    """
    frames, markers = positions.shape[:2]
    last = np.zeros((markers, 3), dtype=np.int32)
    data = []
    for start in range(0, frames, block):
        held = _held(positions[start : start + block], last)
        last = held[-1]
        data.append(_deflated(_zigzag(_second_differences(held)).transpose(1, 2, 0), 4))
    return {"coding": "delta2", "frames": frames, "markers": markers, "block": block, "data": data}


def encode_runs(values: NDArray[np.integer] | NDArray[np.bool_]) -> dict[str, Any]:
    """Return small whole numbers that seldom change over time in coding ``runs``.

    Parameters
    ----------
    values : ndarray of int or bool [shape=(frames, markers)]
        At least one frame.

    Returns
    -------
    dict
        ``values`` has for each marker a list of value, length, value, length, ...
    """
    rows = []
    for marker in range(values.shape[1]):
        column = np.asarray(values[:, marker]).astype(np.int64)
        starts = np.concatenate([[0], 1 + np.flatnonzero(np.diff(column))])
        lengths = np.diff(np.append(starts, len(column)))
        rows.append(np.column_stack([column[starts], lengths]).ravel().tolist())
    return {"coding": "runs", "values": rows}


def encode_sparse(values: NDArray[np.float64], shown: NDArray[np.bool_]) -> dict[str, Any]:
    """Return lengths of some samples in coding ``sparse16``.

    Parameters
    ----------
    values : ndarray [shape=(frames, markers), mm]
        NaN where unknown.
    shown : ndarray of bool [shape=(frames, markers)]
        The samples that are stored: marker by marker, each in order of time.
    """
    chosen = values.T[shown.T]
    known = np.isfinite(chosen)
    # halves are rounded up, as the page rounds
    near = np.clip(np.where(known, chosen, 0.0), 0.0, MAX_ERROR * STEP_MM)
    stored = np.where(known, np.floor(near / STEP_MM + 0.5), UNKNOWN)
    return {"coding": "sparse16", "data": _deflated(stored.astype(np.uint32), 2)}


def _held(positions: NDArray[np.float64], last: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return positions in whole steps, missing ones as the last known ones."""
    known = ~np.isnan(positions[..., 0])
    far = MAX_POSITION * STEP_MM
    steps = np.rint(np.clip(positions, -far, far) / STEP_MM)
    whole = np.where(known[..., None], steps, 0.0).astype(np.int32)
    if known.all():
        return whole
    frame = np.where(known, np.arange(len(positions))[:, None], -1)
    frame = np.maximum.accumulate(frame, axis=0)
    held = np.take_along_axis(whole, np.maximum(frame, 0)[..., None], axis=0)
    return np.where((frame >= 0)[..., None], held, last)


def _second_differences(whole: NDArray[np.int32]) -> NDArray[np.uint32]:
    """Return the first frame, its first difference and all second differences, modulo 2^32."""
    values = whole.view(np.uint32).copy()
    for frames in (values[1:], values[2:]):
        # of the first differences from the second frame on, the first one stays
        earlier = values[len(values) - len(frames) - 1 : -1].copy()
        frames -= earlier
    return values


def _zigzag(values: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Return numbers whose leading bits are 0 for small ones of either sign."""
    negative = (values >> np.uint32(31)).astype(bool)
    return np.where(negative, ~(values << np.uint32(1)), values << np.uint32(1))


def _deflated(values: NDArray[np.uint32], planes: int) -> str:
    """Return the lower bytes of numbers, plane by plane, the lowest first."""
    flat = np.ascontiguousarray(values).astype("<u4").view(np.uint8).reshape(-1, 4)
    content = np.ascontiguousarray(flat[:, :planes].T).tobytes()
    return base64.b64encode(zlib.compress(content, _LEVEL)).decode("ascii")
