"""What decode.js does, in NumPy: the numbers of the arrays of a page."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np


def unpacked(text: str, planes: int) -> np.ndarray:
    """The numbers whose planes of bytes were deflated."""
    content = np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8)
    rows = content.reshape(planes, -1).astype(np.uint32)
    return sum(row << np.uint32(8 * plane) for plane, row in enumerate(rows))


def decoded(coded: dict[str, Any]) -> np.ndarray:
    """Positions in steps of 0.1 mm [shape=(frames, markers, 3)], one number after the other."""
    frames, markers = coded["frames"], coded["markers"]
    blocks = []
    for number, text in enumerate(coded["data"]):
        count = min(coded["block"], frames - number * coded["block"])
        stored = unpacked(text, 4).reshape(markers, 3, count)
        signed = (stored >> 1) ^ (-(stored & 1).astype(np.int32)).view(np.uint32)
        values = signed.copy()
        for frame in range(1, count):
            before = values[..., frame - 2] if frame > 1 else values[..., 0]
            step = values[..., frame - 1] - before
            values[..., frame] = values[..., frame - 1] + step + signed[..., frame]
        blocks.append(values.view(np.int32).transpose(2, 0, 1))
    return np.concatenate(blocks)


def expand(runs: dict[str, Any]) -> np.ndarray:
    """States [shape=(frames, markers)]."""
    return np.array([np.repeat(row[::2], row[1::2]) for row in runs["values"]]).T
