"""Header and parameter section of a C3D file."""

from __future__ import annotations

import math
import mmap
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import FormatError
from priorfill.formats.c3d.encoding import Processor, decode_floats, decode_integers

__all__ = [
    "BLOCK",
    "C3DHeader",
    "C3DParameters",
    "FileBytes",
    "is_c3d",
    "parse_header",
    "parse_parameters",
]

BLOCK = 512
"""Bytes in a block, the unit of C3D's section addresses."""

_KEY = 0x50
"""Second byte of every C3D file."""

_CHARACTER = -1
"""Type of a text parameter; those of numbers are 1, 2 and 4, their size in bytes."""

_SIZES = {_CHARACTER: 1, 1: 1, 2: 2, 4: 4}

_SHORT = np.iinfo(np.int16)

ParameterValue = list[str] | NDArray[np.float64]
"""Contents of a parameter: texts or numbers."""

FileBytes = bytes | mmap.mmap
"""A whole file, in memory or memory-mapped."""


@dataclass(frozen=True)
class C3DHeader:
    """Contents of the first block; counts are unsigned.

    Attributes
    ----------
    parameter_start : int
        Byte at which the parameter section begins.
    points, analog_words, analog_samples : int
        Points, analog numbers, and analog samples of one channel, all per frame.
    first, last : int
        Numbers of the first and the last frame.
    scale : float
        File units per step of an integer coordinate; negative if coordinates are floats.
    data_block : int
        Block at which the data begin, counted from 1.
    rate : float
        Frame rate (Hz).
    """

    parameter_start: int
    points: int
    analog_words: int
    analog_samples: int
    first: int
    last: int
    scale: float
    data_block: int
    rate: float


class C3DParameters:
    """The parameters of a file by group and name in upper case.

    Parameters
    ----------
    values : dict of (str, str) to list of str or ndarray
        Contents of each parameter: strings without trailing blanks, or flat numbers.
    regular : bool
        Whether each record, including its description, ends where the next begins. If not, a
        reader that relies on the descriptions' lengths misreads the section.
    note : str
        What the user should know about the section; empty if nothing.
    """

    def __init__(
        self,
        values: dict[tuple[str, str], ParameterValue],
        *,
        regular: bool = True,
        note: str = "",
    ) -> None:
        self._values = values
        self.regular = regular
        self.note = note

    def items(self) -> Iterator[tuple[tuple[str, str], ParameterValue]]:
        """Yield ((group, name), contents) of each parameter in the file's order."""
        yield from self._values.items()

    def numbers(self, group: str, name: str) -> NDArray[np.float64]:
        """Return a parameter's numbers, flat; empty if it is absent or text."""
        value = self._values.get((group, name))
        return value if isinstance(value, np.ndarray) else np.empty(0)

    def number(self, group: str, name: str) -> float | None:
        """Return a parameter's first number; None if it is absent or not finite."""
        values = self.numbers(group, name)
        return float(values[0]) if values.size and math.isfinite(values[0]) else None

    def count(self, group: str, name: str) -> int | None:
        """Return a parameter's first number as an unsigned 16 bit count.

        None if it is absent or cannot be a count.
        """
        value = self.number(group, name)
        if value is None or value < _SHORT.min:
            return None
        return int(value) + 65536 if value < 0 else int(value)

    def texts(self, group: str, name: str) -> list[str]:
        """Return a parameter's strings, followed by those of NAME2, NAME3, ...

        One parameter holds at most 255 entries; longer lists continue in the next.
        """
        texts: list[str] = []
        part = 1
        while True:
            value = self._values.get((group, name if part == 1 else f"{name}{part}"))
            if not isinstance(value, list):
                return texts
            texts += value
            part += 1


def is_c3d(start: FileBytes) -> bool:
    """Check whether a file may be C3D by its first bytes."""
    return len(start) >= 2 and start[0] != 0 and start[1] == _KEY


def parse_header(data: FileBytes, name: str) -> tuple[C3DHeader, Processor]:
    """Parse the first block.

    Parameters
    ----------
    data : FileBytes
        The whole file.
    name : str
        The file's name in messages.

    Returns
    -------
    header : C3DHeader
        Its contents.
    processor : Processor
        The file's number format.

    Raises
    ------
    FormatError
        If the file is empty, too short, or not C3D.
    """
    if not data:
        raise FormatError(f"{name}: is empty; copy or export the recording again")
    if not is_c3d(data):
        raise FormatError(f"{name}: is not a C3D file (wrong first bytes); give the name of one")
    start = (data[0] - 1) * BLOCK
    if len(data) < max(BLOCK, start + 4):
        raise FormatError(
            f"{name}: ends after {len(data)} bytes, inside its header; "
            "copy or export the recording again"
        )
    try:
        processor = Processor(data[start + 3])
    except ValueError:
        raise FormatError(
            f"{name}: is not a C3D file (processor type {data[start + 3]}; 84, 85 and 86 are known)"
        ) from None
    words = decode_integers(data[:BLOCK], processor).astype(np.int64) & 0xFFFF
    scale = decode_floats(data[12:16], processor)[0]
    rate = decode_floats(data[20:24], processor)[0]
    header = C3DHeader(
        parameter_start=start,
        points=int(words[1]),
        analog_words=int(words[2]),
        first=int(words[3]),
        last=int(words[4]),
        scale=float(scale),
        data_block=int(words[8]),
        analog_samples=int(words[9]),
        rate=float(rate),
    )
    return header, processor


def parse_parameters(
    data: FileBytes, header: C3DHeader, processor: Processor, name: str
) -> C3DParameters:
    """Parse the parameter section.

    Parameters
    ----------
    data : FileBytes
        The whole file.
    header : C3DHeader
        Its first block.
    processor : Processor
        Its number format.
    name : str
        The file's name in messages.

    Returns
    -------
    C3DParameters
        All parameters.

    Raises
    ------
    FormatError
        If a record does not fit into the section.
    """
    groups: dict[int, str] = {}
    found: list[tuple[int, str, ParameterValue]] = []
    regular, note = True, ""
    for identity, label, body, ending in _records(data, header, processor, name):
        if identity < 0:
            groups.setdefault(-identity, label)
            described = 0
        else:
            value, described = _value(body, processor, f"{name}: parameter {label}")
            found.append((identity, label, value))
        # followed by the length of the description, and the description
        rest = body[described:]
        if ending is not _Ending.NEXT:  # and by the padding of the section
            used = 1 + rest[0] if rest else 1
            rest = rest[:used] + rest[used:].rstrip(b"\0")
        in_order = len(rest) > 0 and len(rest) == 1 + rest[0]
        regular = regular and in_order
        if ending is _Ending.BEYOND and not in_order:
            note = (
                f"The offset of parameter {label} points past the parameter section; "
                "parameters after it, if there are any, are not read."
            )
    values: dict[tuple[str, str], ParameterValue] = {}
    for identity, label, value in found:
        # a parameter may precede its group, so groups are resolved at the end
        values.setdefault((groups.get(identity, ""), label), value)
    return C3DParameters(values, regular=regular, note=note)


class _Ending(Enum):
    """Where the offset of a parameter record points."""

    NEXT = "to the next record"
    LAST = "nowhere: it is 0, which marks the last record"
    BEYOND = "past the section, which also occurs in the last record"


def _records(
    data: FileBytes, header: C3DHeader, processor: Processor, name: str
) -> Iterator[tuple[int, str, bytes, _Ending]]:
    """Yield identity, name and body of each record, and where its offset points.

    A record is a group (identity < 0) or a parameter. The body of the last one extends to the end
    of the section.
    """
    at = header.parameter_start + 4
    end = (header.data_block - 1) * BLOCK
    if end <= at:
        end = header.parameter_start + data[header.parameter_start + 2] * BLOCK
    end = min(end, len(data))
    damaged = FormatError(
        f"{name}: its parameter section is damaged or cut short; copy or export the recording again"
    )
    while at + 2 <= end:
        # a negative length marks a locked parameter
        length = abs(int.from_bytes(data[at : at + 1], "little", signed=True))
        identity = int.from_bytes(data[at + 1 : at + 2], "little", signed=True)
        if length == 0 or identity == 0:
            return
        offset_at = at + 2 + length
        if offset_at + 2 > end:
            raise damaged
        offset = int(decode_integers(data[offset_at : offset_at + 2], processor)[0]) & 0xFFFF
        following = offset_at + offset if offset else end  # 0: the last record
        if offset and offset < 3:
            raise damaged
        label = _text(data[at + 2 : offset_at]).upper()
        ending = _Ending.LAST if offset == 0 else _Ending.NEXT
        if following > end:
            ending, following = _Ending.BEYOND, end
        yield identity, label, data[offset_at + 2 : following], ending
        at = following


def _value(body: bytes, processor: Processor, what: str) -> tuple[ParameterValue, int]:
    """Return the contents of a parameter record, and the offset of its description."""
    damaged = FormatError(f"{what} is damaged; copy or export the recording again")
    if len(body) < 2:
        raise damaged
    kind = int.from_bytes(body[:1], "little", signed=True)
    axes = body[1]
    dimensions = list(body[2 : 2 + axes])
    if kind not in _SIZES or len(dimensions) < axes:
        raise damaged
    start = 2 + axes
    stop = start + math.prod(dimensions) * _SIZES[kind]
    if stop > len(body):
        raise damaged
    raw = body[start:stop]
    if kind == _CHARACTER:
        width = dimensions[0] if dimensions else 1
        # texts of width 0 take no bytes, so the file's size would not bound their number
        entries = math.prod(dimensions[1:]) if width else 0
        return [_text(raw[i * width : (i + 1) * width]) for i in range(entries)], stop
    if kind == 1:
        return np.frombuffer(raw, dtype=np.uint8).astype(np.float64), stop
    if kind == 2:
        return decode_integers(raw, processor).astype(np.float64), stop
    return decode_floats(raw, processor), stop


def _text(raw: bytes) -> str:
    """Return text without padding, decoded as UTF-8, or else as Latin-1.

    Control characters, which occur in damaged files only, become question marks, because names
    appear in one-line messages.
    """
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    text = text.strip(" \0\t\r\n")
    return text if text.isprintable() else "".join(c if c.isprintable() else "?" for c in text)
