"""Valid and invalid C3D files, assembled byte by byte.

Written from the format's definition instead of the package's own code, so that an error in one is
not hidden by the other.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np

BLOCK = 512
INTEL, DEC, MIPS = 84, 85, 86


def number_float(value: float, processor: int) -> bytes:
    if processor == INTEL:
        return struct.pack("<f", value)
    if processor == MIPS:
        return struct.pack(">f", value)
    if value == 0:
        return bytes(4)
    # DEC: value = (-1)^s * 0.1mmm * 2^(e - 128); the 16 bit word with the sign comes first
    mantissa, exponent = math.frexp(abs(value))
    fraction = round(mantissa * 2**24)
    if fraction == 2**24:
        fraction, exponent = 2**23, exponent + 1
    bits = (int(value < 0) << 31) | ((exponent + 128) << 23) | (fraction & 0x7FFFFF)
    return struct.pack("<HH", bits >> 16, bits & 0xFFFF)


def number_short(value: int, processor: int) -> bytes:
    return struct.pack(">H" if processor == MIPS else "<H", int(value) & 0xFFFF)


def read_float(raw: bytes, processor: int) -> float:
    if processor == INTEL:
        return struct.unpack("<f", raw)[0]
    if processor == MIPS:
        return struct.unpack(">f", raw)[0]
    high, low = struct.unpack("<HH", raw)
    exponent, fraction = (high >> 7) & 0xFF, ((high & 0x7F) << 16) | low
    if exponent == 0:
        return 0.0
    return (-1) ** (high >> 15) * (0.5 + fraction / 2**24) * 2.0 ** (exponent - 128)


def read_short(raw: bytes, processor: int) -> int:
    return struct.unpack(">h" if processor == MIPS else "<h", raw)[0]


@dataclass
class C3DFile:
    """Contents of a file; `records` is (frames, points, 4): x, y, z as stored, and the 4th word."""

    records: np.ndarray
    labels: list[str | bytes]
    processor: int = INTEL
    is_float: bool = True
    scale: float = 0.1
    rate: float = 100.0
    first_frame: int = 1
    analog: np.ndarray | None = None  # (frames, samples, channels)
    units: str | None = "mm"
    parameters: dict[str, dict[str, Any]] = field(default_factory=dict)
    header: dict[str, int] = field(default_factory=dict)  # overrides of header words
    omit: tuple[tuple[str, str], ...] = ()  # parameters to leave out
    truncate: int = 0  # bytes cut off the end
    pad: bool = True

    def short(self, value: int) -> bytes:
        return number_short(value, self.processor)

    def float(self, value: float) -> bytes:
        return number_float(value, self.processor)

    def words(self, values: np.ndarray) -> bytes:
        if not self.is_float:
            order = ">" if self.processor == MIPS else "<"
            return values.astype(order + "i2").tobytes()
        return b"".join(map(self.float, values.ravel()))

    def parameter(self, identity: int, name: str, value: Any) -> bytes:
        if isinstance(value, (str, bytes)):
            value = [value]
        if isinstance(value, list) and all(isinstance(v, (str, bytes)) for v in value):
            raw = [v if isinstance(v, bytes) else v.encode() for v in value]
            width = max([len(v) for v in raw] + [1])
            kind, dims = -1, [width, len(raw)]
            body = b"".join(v.ljust(width) for v in raw)
        elif isinstance(value, float):
            kind, dims, body = 4, [], self.float(value)
        elif isinstance(value, int):
            kind, dims, body = 2, [], self.short(value)
        elif all(isinstance(v, float) for v in value):
            kind, dims, body = 4, [len(value)], b"".join(map(self.float, value))
        else:
            kind, dims, body = 2, [len(value)], b"".join(map(self.short, value))
        content = struct.pack("b", kind) + bytes([len(dims), *dims]) + body + b"\0"
        start = struct.pack("bb", len(name), identity) + name.encode()
        return start + self.short(len(content) + 2) + content

    def group(self, identity: int, name: str) -> bytes:
        return struct.pack("bb", len(name), -identity) + name.encode() + self.short(3) + b"\0"

    def analog_shape(self) -> tuple[int, int]:
        return (1, 0) if self.analog is None else self.analog.shape[1:]

    def parameter_section(self, data_block: int) -> bytes:
        samples, channels = self.analog_shape()
        signed = -abs(self.scale) if self.is_float else abs(self.scale)
        point: dict[str, Any] = {
            "USED": self.records.shape[1],
            "FRAMES": self.records.shape[0],
            "DATA_START": data_block,
            "SCALE": float(signed),
            "RATE": float(self.rate),
        }
        for part in range(0, max(len(self.labels), 1), 255):
            number = part // 255 + 1
            name = "LABELS" if number == 1 else f"LABELS{number}"
            point[name] = list(self.labels[part : part + 255])
        if self.units is not None:
            point["UNITS"] = [self.units]
        groups: dict[str, dict[str, Any]] = {
            "POINT": point,
            "ANALOG": {"USED": channels, "RATE": float(self.rate * samples)},
        }
        if channels:
            groups["ANALOG"] |= {
                "GEN_SCALE": 1.0,
                "SCALE": [1.0] * channels,
                "OFFSET": [0] * channels,
            }
        for group, values in self.parameters.items():
            groups.setdefault(group, {}).update(values)
        for group, name in self.omit:
            del groups[group][name]
        section = b""
        for identity, (group, values) in enumerate(groups.items(), start=1):
            section += self.group(identity, group)
            for name, value in values.items():
                section += self.parameter(identity, name, value)
        return section + b"\0\0"

    def data_start(self) -> int:
        """Byte offset of the first frame."""
        return BLOCK * (1 + -(-(4 + len(self.parameter_section(2))) // BLOCK))

    def bytes(self) -> bytes:
        frames, points, _ = self.records.shape
        samples, channels = self.analog_shape()
        data_block = self.data_start() // BLOCK + 1
        blocks = data_block - 2
        section = bytes([1, 0x50, blocks & 0xFF, self.processor])
        section += self.parameter_section(data_block)
        section = section.ljust(blocks * BLOCK, b"\0")
        words = {
            "points": points,
            "analog": samples * channels,
            "first": self.first_frame,
            "last": self.first_frame + frames - 1,
            "data_block": data_block,
            "samples": samples,
            **self.header,
        }
        head = bytes([2, 0x50])
        for name in ("points", "analog", "first", "last"):
            head += self.short(words[name])
        head += self.short(10)
        head += self.float(-abs(self.scale) if self.is_float else abs(self.scale))
        head += self.short(words["data_block"]) + self.short(words["samples"])
        head += self.float(self.rate)
        body = bytearray()
        for frame in range(frames):
            body += self.words(self.records[frame])
            if self.analog is not None:
                body += self.words(self.analog[frame])
        if self.pad:
            body = body.ljust(-(-len(body) // BLOCK) * BLOCK, b"\0")
        whole = head.ljust(BLOCK, b"\0") + section + body
        return whole[: len(whole) - self.truncate]

    def offset(self, frame: int, point: int) -> int:
        """Byte offset of the record of a sample."""
        size = 4 if self.is_float else 2
        samples, channels = self.analog_shape()
        frame_words = 4 * self.records.shape[1] + samples * channels
        return self.data_start() + (frame * frame_words + 4 * point) * size


LABELS = ["LFHD", "RFHD", "C7", "LASI", "RASI", "LKNE", "RKNE", "LANK", "RANK", "LTOE"]

HEIGHTS = [1700, 1700, 1450, 950, 950, 480, 480, 90, 90, 30]


def standing(frames: int = 12, *, seed: int = 0, step: float | None = None) -> np.ndarray:
    """Records (mm) of a swaying body upright along +Z; as integers of `step` mm if given."""
    rng = np.random.default_rng(seed)
    records = np.zeros((frames, len(LABELS), 4))
    records[:, :, 0] = np.linspace(0, 300, frames)[:, None] + rng.normal(0, 20, len(LABELS))
    records[:, :, 1] = [-150 if label.startswith("L") else 150 for label in LABELS]
    records[:, :, 2] = HEIGHTS
    records[:, :, :3] += rng.normal(0, 2, (frames, len(LABELS), 3))
    if step is None:
        records = records.astype(np.float32).astype(np.float64)
        records[:, :, 3] = 0.0
    else:
        records[:, :, :3] = np.rint(records[:, :, :3] / step)
        records[:, :, 3] = 0
    return records
