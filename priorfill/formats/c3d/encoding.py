"""Number formats of C3D files: those of Intel, DEC and MIPS processors."""

from __future__ import annotations

from enum import Enum

import numpy as np
from numpy.typing import NDArray

__all__ = ["Processor", "decode_floats", "decode_integers", "encode_floats", "encode_integers"]

_DEC_FACTOR = 4.0
"""The exponent bias of a DEC float is two above IEEE's, so the same bits are a quarter as large."""


class Processor(Enum):
    """Processor whose number formats a file uses; the values are those stored in the file."""

    INTEL = 84
    DEC = 85
    MIPS = 86

    @property
    def order(self) -> str:
        """Byte order of integers in NumPy's notation."""
        return ">" if self is Processor.MIPS else "<"


def decode_integers(raw: bytes | memoryview, processor: Processor) -> NDArray[np.int16]:
    """Return signed 16 bit integers [shape=(len(raw) / 2,)]."""
    return np.frombuffer(raw, dtype=processor.order + "i2").astype(np.int16)


def encode_integers(values: NDArray[np.int16], processor: Processor) -> NDArray[np.uint8]:
    """Return the bytes of signed 16 bit integers [shape=(..., n) -> (..., 2 n)]."""
    words = np.ascontiguousarray(values, dtype=processor.order + "i2")
    return words.view(np.uint8)


def decode_floats(raw: bytes | memoryview, processor: Processor) -> NDArray[np.float64]:
    """Return 32 bit floats as float64 [shape=(len(raw) / 4,)]."""
    if processor is Processor.DEC:
        bits = np.frombuffer(raw, dtype="<u2").reshape(-1, 2)
        # the word with the sign bit comes first
        words = np.ascontiguousarray(bits[:, ::-1]).view("<f4")[:, 0]
    else:
        words = np.frombuffer(raw, dtype=processor.order + "f4")
    with np.errstate(invalid="ignore"):  # signalling NaN
        values = words.astype(np.float64)
        return values / _DEC_FACTOR if processor is Processor.DEC else values


def encode_floats(values: NDArray[np.float64], processor: Processor) -> NDArray[np.uint8]:
    """Return the bytes of values as 32 bit floats [shape=(..., n) -> (..., 4 n)]."""
    if processor is not Processor.DEC:
        words = np.ascontiguousarray(values, dtype=processor.order + "f4")
        return words.view(np.uint8)
    words = np.ascontiguousarray(values * _DEC_FACTOR, dtype="<f4")
    halves = words.view("<u2").reshape(*words.shape, 2)[..., ::-1]
    shape = (*words.shape[:-1], 4 * words.shape[-1])
    return np.ascontiguousarray(halves).view(np.uint8).reshape(shape)
