"""Where the samples of a C3D file are: what reading and patching it need to know."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import ClipError, FormatError
from priorfill.formats.c3d.encoding import Processor, decode_floats, decode_integers
from priorfill.formats.c3d.parameters import (
    BLOCK,
    C3DHeader,
    C3DParameters,
    FileBytes,
    parse_header,
    parse_parameters,
)

__all__ = ["WORDS_PER_POINT", "C3DLayout", "parse_layout", "read_points"]

WORDS_PER_POINT = 4
"""X, Y, Z, and the word that holds residual and camera mask."""

_T = TypeVar("_T")

_AT_ONCE = 1000
"""Frames decoded at once: the numbers of more, in several forms, would take more memory than the
result."""

_SAME_RATE = 0.01
"""Relative difference up to which two rates are one, rounded: 59.94 and 60 Hz."""

_SATURATED = 65535
"""Largest count that 16 bits hold; written in place of any larger one."""


@dataclass(frozen=True)
class C3DLayout:
    """Geometry of a file's data section, checked against the file's size.

    Attributes
    ----------
    processor : Processor
        Number format of the file.
    points : int
        Points in a frame.
    analog_words : int
        Analog numbers in a frame, after the points.
    frames : int
        Frames in the file.
    first_frame : int
        The file's own number of its first frame.
    rate : float
        Frames per second as the file says, 0 if it does not.
    is_float : bool
        Whether a number is a 32 bit float or a 16 bit integer.
    scale : float
        File units in one step of an integer coordinate; positive.
    data_start : int
        Byte at which the first frame begins.
    labels : tuple of str
        A label for each point, empty where the file has none.
    parameters : C3DParameters
        All the parameters.
    contradictions : tuple of str
        Where the file contradicts itself and what was believed, a sentence each.
    """

    processor: Processor
    points: int
    analog_words: int
    frames: int
    first_frame: int
    rate: float
    is_float: bool
    scale: float
    data_start: int
    labels: tuple[str, ...]
    parameters: C3DParameters
    contradictions: tuple[str, ...] = ()

    @property
    def word_bytes(self) -> int:
        """Bytes of one number."""
        return 4 if self.is_float else 2

    @property
    def record_bytes(self) -> int:
        """Bytes of one point in one frame."""
        return WORDS_PER_POINT * self.word_bytes

    @property
    def frame_bytes(self) -> int:
        """Bytes of one frame."""
        return (WORDS_PER_POINT * self.points + self.analog_words) * self.word_bytes

    def record_offsets(
        self, frames: NDArray[np.intp], points: NDArray[np.intp]
    ) -> NDArray[np.intp]:
        """Return the byte at which each (frame, point) record begins."""
        offsets: NDArray[np.intp] = (
            self.data_start + frames * self.frame_bytes + points * self.record_bytes
        )
        return offsets


@dataclass(frozen=True)
class _DataSection:
    """One reading of the data section: what parameters or header say of it."""

    data_start: int
    analog_words: int
    is_float: bool
    points: int
    frames: int
    size: int

    @property
    def end(self) -> int:
        """Byte after the last frame."""
        return self.data_start + self.frames * _frame_bytes(
            self.points, self.analog_words, self.is_float
        )

    @property
    def fits(self) -> bool:
        """Whether the file ends where its data end, but for filling up a block.

        A full block too many is common: some programs fill up a block that is full.
        """
        return 0 <= self.size - self.end <= BLOCK


def parse_layout(data: FileBytes, name: str) -> C3DLayout:
    """Find the data section of a C3D file.

    C3DParameters and header often say the same thing twice. C3DParameters are believed, as the
    format's guide has it, unless only what the header says fits the file's size.

    C3DParameters
    ----------
    data : FileBytes
        The whole file.
    name : str
        What to call the file in messages.

    Returns
    -------
    C3DLayout
        Where its samples are.

    Raises
    ------
    FormatError
        If the file is not C3D, damaged or cut short.
    ClipError
        If it has no points or no frames.
    """
    header, processor = parse_header(data, name)
    parameters = parse_parameters(data, header, processor, name)
    points = _given(parameters.count("POINT", "USED"), header.points)
    if points <= 0:
        raise ClipError(f"{name}: has no points; there is nothing to fill")
    geometry, contradictions = _geometry(data, header, parameters, points, name)
    frame_bytes = _frame_bytes(points, geometry.analog_words, geometry.is_float)
    capacity = max(0, len(data) - geometry.data_start) // frame_bytes
    if geometry.frames > capacity:
        raise FormatError(
            f"{name}: is cut short: it holds {capacity} of its {geometry.frames} frames; "
            "copy or export the recording again"
        )
    labels = [*parameters.texts("POINT", "LABELS"), *[""] * points][:points]
    scale = _given(parameters.number("POINT", "SCALE"), header.scale)
    if not geometry.is_float and not (math.isfinite(scale) and scale != 0):
        raise FormatError(
            f"{name}: POINT:SCALE is {scale:g}, so coordinates are unknown; export it again"
        )
    rate, doubt = _rate(header, parameters)
    return C3DLayout(
        processor=processor,
        points=points,
        analog_words=geometry.analog_words,
        frames=geometry.frames,
        first_frame=_first_frame(header, parameters),
        rate=rate,
        is_float=geometry.is_float,
        scale=abs(scale),
        data_start=geometry.data_start,
        labels=tuple(labels),
        parameters=parameters,
        contradictions=(*contradictions, *doubt),
    )


def read_points(data: bytes, layout: C3DLayout) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Read the points of a file.

    C3DParameters
    ----------
    data : bytes
        The whole file.
    layout : C3DLayout
        Where its samples are.

    Returns
    -------
    positions : ndarray [shape=(frames, points, 3), file units]
        Coordinates as stored, those of missing samples included.
    residual : ndarray [shape=(frames, points)]
        The fourth word: negative where the sample is missing.
    """
    positions = np.empty((layout.frames, layout.points, 3))
    residual = np.empty((layout.frames, layout.points))
    for start in range(0, layout.frames, _AT_ONCE):
        some = slice(start, min(start + _AT_ONCE, layout.frames))
        first, last = (layout.data_start + t * layout.frame_bytes for t in (some.start, some.stop))
        section = memoryview(data)[first:last]
        if layout.is_float:
            words = decode_floats(section, layout.processor)
        else:
            words = decode_integers(section, layout.processor).astype(np.float64)
        words = words.reshape(some.stop - some.start, -1)[:, : WORDS_PER_POINT * layout.points]
        records = words.reshape(-1, layout.points, WORDS_PER_POINT)
        positions[some], residual[some] = records[:, :, :3], records[:, :, 3]
    if not layout.is_float:
        positions *= layout.scale
    return positions, residual


def _geometry(
    data: FileBytes, header: C3DHeader, parameters: C3DParameters, points: int, name: str
) -> tuple[_DataSection, list[str]]:
    """Return the reading of the data section that fits the file, and what it overruled."""
    starts = [
        (block - 1) * BLOCK
        for block in (parameters.count("POINT", "DATA_START"), header.data_block)
        if block is not None and block > 1
    ]
    if not starts:
        raise FormatError(f"{name}: does not say where its data begin; export it again")
    analogs = [_analog_words(header, parameters), header.analog_words]
    scale = parameters.number("POINT", "SCALE")
    floats = [value < 0 for value in (scale, header.scale) if value is not None]

    counts = _frame_counts(header, parameters)
    readings = []
    for start, analog, is_float in product(_unique(starts), _unique(analogs), _unique(floats)):
        frame_bytes = _frame_bytes(points, analog, is_float)
        room = _room(data, start, frame_bytes)
        readings += [
            _DataSection(start, analog, is_float, points, count or room, len(data))
            for count in counts
            if count or room
        ]
    if not readings:
        raise ClipError(f"{name}: has no frames; there is nothing to fill")
    best = next((reading for reading in readings if reading.fits), readings[0])

    # a count cut to 16 bits does not contradict the full one
    stated = [n for n in counts if n and n != best.frames % 65536]
    contradictions = []
    for what, values, chosen in (
        ("where its data begin", starts, best.data_start),
        ("how many analog numbers a frame has", analogs, best.analog_words),
        ("whether coordinates are integers", floats, best.is_float),
        ("how many frames it has", stated, best.frames),
    ):
        if any(value != chosen for value in values):
            contradictions.append(
                f"The file contradicts itself on {what}; believed is {_said(what, chosen)}, "
                + ("which fits its size." if best.fits else "which its parameters say.")
            )
    return best, contradictions


def _said(what: str, chosen: object) -> str:
    """Return the value believed, as a reader of a note would say it."""
    if isinstance(chosen, bool):
        return "floats" if chosen else "integers"
    return f"byte {chosen}" if what.startswith("where") else str(chosen)


def _frame_counts(header: C3DHeader, parameters: C3DParameters) -> list[int]:
    """Return the frame counts that a file states, most trusted first.

    A 0 stands for as many as the file has room for: where the count is one of 16 bits and
    has their largest value, which is written for all larger counts too.
    """
    counts = []
    begin = parameters.numbers("TRIAL", "ACTUAL_START_FIELD")
    end = parameters.numbers("TRIAL", "ACTUAL_END_FIELD")
    if begin.size and end.size:
        counts.append(_long(end) - _long(begin) + 1)
    counts.append(int(_given(parameters.number("POINT", "LONG_FRAMES"), 0)))
    counts.append(_given(parameters.count("POINT", "FRAMES"), 0))
    if header.last != _SATURATED:
        counts.append(header.last - header.first + 1 if header.last else 0)
    elif counts[-1] <= 0:
        counts.append(_SATURATED)
    counts = [count for count in counts if count > 0]
    return _unique([0 if count == _SATURATED else count for count in counts])


def _room(data: FileBytes, start: int, frame_bytes: int) -> int:
    """Return the frames that a file has room for, without the zeros that fill its last block."""
    tail = data[max(start, len(data) - BLOCK) :]
    used = len(data) - (len(tail) - len(tail.rstrip(b"\0"))) - start
    return max(0, min(-(-used // frame_bytes), (len(data) - start) // frame_bytes))


def _rate(header: C3DHeader, parameters: C3DParameters) -> tuple[float, list[str]]:
    """Return the frames per second, 0 if nothing says them, and a contradiction if there is one."""
    stated = [
        rate
        for rate in (parameters.number("POINT", "RATE"), header.rate)
        if rate is not None and math.isfinite(rate) and rate > 0
    ]
    if not stated:
        return 0.0, []
    rate = stated[0]
    if math.isclose(rate, stated[-1], rel_tol=_SAME_RATE):
        return rate, []
    return rate, [
        f"The file contradicts itself on its rate; believed is {rate:g} Hz, which its parameters "
        f"say, not {stated[-1]:g} Hz of its header (--rate says another)."
    ]


def _first_frame(header: C3DHeader, parameters: C3DParameters) -> int:
    """Return the number of the first frame, in full where 16 bits have cut it."""
    begin = parameters.numbers("TRIAL", "ACTUAL_START_FIELD")
    if begin.size and _long(begin) % 65536 == header.first:
        return _long(begin)
    return header.first


def _long(words: NDArray[np.float64]) -> int:
    """Return the number that TRIAL keeps in two 16 bit words, the lower one first."""
    low, high = (int(word) & 0xFFFF for word in (*words[:2], 0)[:2])
    return low + (high << 16)


def _analog_words(header: C3DHeader, parameters: C3DParameters) -> int:
    """Return the analog numbers in a frame as the parameters have it."""
    channels = parameters.count("ANALOG", "USED")
    if channels is None:
        return header.analog_words
    point_rate = parameters.number("POINT", "RATE")
    analog_rate = parameters.number("ANALOG", "RATE")
    if not (point_rate and analog_rate):
        return channels * header.analog_samples
    samples = analog_rate / point_rate
    # beyond 16 bits it is damage, and may be infinite
    return channels * max(1, round(min(samples, _SATURATED)))


def _frame_bytes(points: int, analog_words: int, is_float: bool) -> int:
    """Return the bytes of one frame."""
    return (WORDS_PER_POINT * points + analog_words) * (4 if is_float else 2)


def _given(value: _T | None, otherwise: _T) -> _T:
    """Return `value` unless there is none."""
    return otherwise if value is None else value


def _unique(values: list[_T]) -> list[_T]:
    """Return the values in order, each once."""
    return list(dict.fromkeys(values))
