"""Layout of a C3D file's data section, needed to read and to patch it."""

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
from priorfill.runtime.threads import map_in_threads

__all__ = ["WORDS_PER_POINT", "C3DLayout", "parse_layout", "read_points"]

WORDS_PER_POINT = 4
"""X, Y, Z, and the word with residual and camera mask."""

_T = TypeVar("_T")

_BATCH_FRAMES = 1000
"""Frames decoded at once. The temporary arrays of a whole file would take more memory than the
result."""

_RATE_TOLERANCE = 0.01
"""Relative difference up to which two rates count as equal, such as 59.94 and 60 Hz."""

_SCALE_TOLERANCE = 1e-3
"""Relative difference up to which two scales count as equal: bodies differ by 2 mm at most."""

_MAX_COUNT = 65535
"""Largest 16 bit count; written in place of any larger one."""


@dataclass(frozen=True)
class C3DLayout:
    """Layout of a file's data section, checked against the file's size.

    Attributes
    ----------
    processor : Processor
        Number format of the file.
    points : int
        Points per frame.
    analog_words : int
        Analog numbers per frame, stored after the points.
    frames : int
        Number of frames.
    first_frame : int
        The file's number of its first frame.
    rate : float
        Frame rate (Hz); 0 if the file states none.
    is_float : bool
        Whether numbers are 32 bit floats; otherwise 16 bit integers.
    scale : float
        File units per step of an integer coordinate; positive.
    data_start : int
        Byte offset of the first frame.
    labels : tuple of str
        Label of each point; empty if the file has none.
    parameters : C3DParameters
        All the parameters.
    contradictions : tuple of str
        Contradictions in the file and how they were resolved, one sentence each.
    notes : tuple of str
        What else the user should know about the file, one sentence each.
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
    notes: tuple[str, ...] = ()

    @property
    def word_bytes(self) -> int:
        """Bytes per number."""
        return 4 if self.is_float else 2

    @property
    def record_bytes(self) -> int:
        """Bytes per point and frame."""
        return WORDS_PER_POINT * self.word_bytes

    @property
    def frame_bytes(self) -> int:
        """Bytes per frame."""
        return (WORDS_PER_POINT * self.points + self.analog_words) * self.word_bytes

    def record_offsets(
        self, frames: NDArray[np.intp], points: NDArray[np.intp]
    ) -> NDArray[np.intp]:
        """Return the byte offset of each (frame, point) record [shape=(samples,)]."""
        offsets: NDArray[np.intp] = (
            self.data_start + frames * self.frame_bytes + points * self.record_bytes
        )
        return offsets


@dataclass(frozen=True)
class _DataSection:
    """A candidate layout of the data section, from parameters or header."""

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
        """Whether the file ends with its data, up to the padding of the last block.

        An extra block is common: some programs pad a block that is already full.
        """
        return 0 <= self.size - self.end <= BLOCK


def parse_layout(data: FileBytes, name: str) -> C3DLayout:
    """Find the data section of a C3D file.

    Parameters and header often state the same quantity. The parameters take precedence, as the
    format's user guide recommends, unless only the header's value fits the file's size.

    Parameters
    ----------
    data : FileBytes
        The whole file.
    name : str
        The file's name in messages.

    Returns
    -------
    C3DLayout
        The layout.

    Raises
    ------
    FormatError
        If the file is not C3D, damaged or truncated.
    ClipError
        If it has no points or no frames.
    """
    header, processor = parse_header(data, name)
    parameters = parse_parameters(data, header, processor, name)
    section, contradictions = _data_section(data, header, parameters, name)
    points = section.points
    frame_bytes = _frame_bytes(points, section.analog_words, section.is_float)
    capacity = max(0, len(data) - section.data_start) // frame_bytes
    if section.frames > capacity:
        raise FormatError(
            f"{name}: is cut short: it holds {capacity} of its {section.frames} frames; "
            "copy or export the recording again"
        )
    labels = [*parameters.texts("POINT", "LABELS"), *[""] * points][:points]
    scale = _given(parameters.number("POINT", "SCALE"), header.scale)
    if not section.is_float and not (math.isfinite(scale) and scale != 0):
        raise FormatError(
            f"{name}: POINT:SCALE is {scale:g}, so coordinates cannot be decoded; export it again"
        )
    scale_contradiction = [] if section.is_float else _scale_contradiction(abs(scale), header)
    rate, rate_contradiction = _rate(header, parameters)
    return C3DLayout(
        processor=processor,
        points=points,
        analog_words=section.analog_words,
        frames=section.frames,
        first_frame=_first_frame(header, parameters),
        rate=rate,
        is_float=section.is_float,
        scale=abs(scale),
        data_start=section.data_start,
        labels=tuple(labels),
        parameters=parameters,
        contradictions=(*contradictions, *scale_contradiction, *rate_contradiction),
        notes=(parameters.note,) if parameters.note else (),
    )


def read_points(data: bytes, layout: C3DLayout) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Read the points of a file.

    Parameters
    ----------
    data : bytes
        The whole file.
    layout : C3DLayout
        Its layout.

    Returns
    -------
    positions : ndarray [shape=(frames, points, 3), file units]
        Coordinates as stored, including those of missing samples.
    residual : ndarray [shape=(frames, points)]
        The fourth word, negative if the sample is missing.
    """
    positions = np.empty((layout.frames, layout.points, 3))
    residual = np.empty((layout.frames, layout.points))

    def read(start: int) -> None:
        some = slice(start, min(start + _BATCH_FRAMES, layout.frames))
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
            positions[some] *= layout.scale

    with map_in_threads(positions.size) as mapped:
        for _ in mapped(read, range(0, layout.frames, _BATCH_FRAMES)):
            pass
    return positions, residual


def _data_section(
    data: FileBytes, header: C3DHeader, parameters: C3DParameters, name: str
) -> tuple[_DataSection, list[str]]:
    """Return the candidate layout that fits the file, and the contradictions it resolves."""
    points = [_given(parameters.count("POINT", "USED"), header.points), header.points]
    if points[0] <= 0:
        raise ClipError(f"{name}: has no points; there is nothing to fill")
    points = [count for count in points if count > 0]
    starts = [
        (block - 1) * BLOCK
        for block in (parameters.count("POINT", "DATA_START"), header.data_block)
        if block is not None and block > 1
    ]
    if not starts:
        raise FormatError(f"{name}: does not state where its data begin; export it again")
    analogs = [_analog_words(header, parameters), header.analog_words]
    scale = parameters.number("POINT", "SCALE")
    floats = [value < 0 for value in (scale, header.scale) if value is not None]

    counts = _frame_counts(header, parameters)
    candidates = []
    for point_count, start, analog, is_float in product(
        _unique(points), _unique(starts), _unique(analogs), _unique(floats)
    ):
        frame_bytes = _frame_bytes(point_count, analog, is_float)
        room = _room(data, start, frame_bytes)
        candidates += [
            _DataSection(start, analog, is_float, point_count, count or room, len(data))
            for count in counts
            if count or room
        ]
    if not candidates:
        raise ClipError(f"{name}: has no frames; there is nothing to fill")
    best = next((one for one in candidates if one.fits), candidates[0])
    _check_points(points, candidates, name)

    # a count truncated to 16 bits does not contradict the full one
    stated = [n for n in counts if n and n != best.frames % 65536]
    contradictions = []
    for what, values, chosen in (
        ("the number of points", points, best.points),
        ("where its data begin", starts, best.data_start),
        ("the analog numbers per frame", analogs, best.analog_words),
        ("whether coordinates are integers", floats, best.is_float),
        ("the number of frames", stated, best.frames),
    ):
        if any(value != chosen for value in values):
            contradictions.append(
                f"The file contradicts itself on {what}; {_shown(what, chosen)} is used, which "
                + ("fits its size." if best.fits else "its parameters state.")
            )
    return best, contradictions


def _check_points(points: list[int], candidates: list[_DataSection], name: str) -> None:
    """Raise FormatError if it is unclear how many points a frame has: all others would be wrong."""
    if len(set(points)) > 1 and len({one.points for one in candidates if one.fits}) != 1:
        raise FormatError(
            f"{name}: has {points[0]} points according to POINT:USED and {points[1]} according to "
            "its header, and its size does not show which; export it again"
        )


def _shown(what: str, chosen: object) -> str:
    """Return the value used, for a note."""
    if isinstance(chosen, bool):
        return "floats" if chosen else "integers"
    return f"byte {chosen}" if what.startswith("where") else str(chosen)


def _frame_counts(header: C3DHeader, parameters: C3DParameters) -> list[int]:
    """Return the frame counts that a file states, the most reliable first.

    A 0 means as many frames as the file has room for. It replaces a 16 bit count of 65535, which is
    also written for larger counts.
    """
    counts = []
    begin = parameters.numbers("TRIAL", "ACTUAL_START_FIELD")
    end = parameters.numbers("TRIAL", "ACTUAL_END_FIELD")
    if begin.size and end.size:
        counts.append(_long(end) - _long(begin) + 1)
    counts.append(int(_given(parameters.number("POINT", "LONG_FRAMES"), 0)))
    counts.append(_given(parameters.count("POINT", "FRAMES"), 0))
    if header.last != _MAX_COUNT:
        counts.append(header.last - header.first + 1 if header.last else 0)
    elif counts[-1] <= 0:
        counts.append(_MAX_COUNT)
    counts = [count for count in counts if count > 0]
    return _unique([0 if count == _MAX_COUNT else count for count in counts])


def _room(data: FileBytes, start: int, frame_bytes: int) -> int:
    """Return the frames that a file has room for, without the zeros that pad its last block."""
    tail = data[max(start, len(data) - BLOCK) :]
    used = len(data) - (len(tail) - len(tail.rstrip(b"\0"))) - start
    return max(0, min(-(-used // frame_bytes), (len(data) - start) // frame_bytes))


def _scale_contradiction(scale: float, header: C3DHeader) -> list[str]:
    """Return a note if the header of an integer file has another scale than the one used.

    All coordinates are proportional to it.
    """
    other = abs(header.scale)
    if not (math.isfinite(other) and other > 0):
        return []
    if math.isclose(scale, other, rel_tol=_SCALE_TOLERANCE):
        return []
    return [
        f"The file contradicts itself on its scale; {scale:g} of its parameters is used, not "
        f"{other:g} of its header; check the size of the body."
    ]


def _rate(header: C3DHeader, parameters: C3DParameters) -> tuple[float, list[str]]:
    """Return the frame rate (Hz), 0 if none is stated, and a note if two are."""
    stated = [
        rate
        for rate in (parameters.number("POINT", "RATE"), header.rate)
        if rate is not None and math.isfinite(rate) and rate > 0
    ]
    if not stated:
        return 0.0, []
    rate = stated[0]
    if math.isclose(rate, stated[-1], rel_tol=_RATE_TOLERANCE):
        return rate, []
    return rate, [
        f"The file contradicts itself on its rate; {rate:g} Hz of its parameters is used, not "
        f"{stated[-1]:g} Hz of its header (`rate` replaces both)."
    ]


def _first_frame(header: C3DHeader, parameters: C3DParameters) -> int:
    """Return the number of the first frame, in full if the header truncates it to 16 bits."""
    begin = parameters.numbers("TRIAL", "ACTUAL_START_FIELD")
    if begin.size and _long(begin) % 65536 == header.first:
        return _long(begin)
    return header.first


def _long(words: NDArray[np.float64]) -> int:
    """Return the number that TRIAL stores in two 16 bit words, the lower one first."""
    low, high = (int(word) & 0xFFFF for word in (*words[:2], 0)[:2])
    return low + (high << 16)


def _analog_words(header: C3DHeader, parameters: C3DParameters) -> int:
    """Return the analog numbers per frame according to the parameters."""
    channels = parameters.count("ANALOG", "USED")
    if channels is None:
        return header.analog_words
    point_rate = parameters.number("POINT", "RATE")
    analog_rate = parameters.number("ANALOG", "RATE")
    if not (point_rate and analog_rate):
        return channels * header.analog_samples
    samples = analog_rate / point_rate
    # larger than 16 bits means damage, and may be infinite
    return channels * max(1, round(min(samples, _MAX_COUNT)))


def _frame_bytes(points: int, analog_words: int, is_float: bool) -> int:
    """Return the bytes per frame."""
    return (WORDS_PER_POINT * points + analog_words) * (4 if is_float else 2)


def _given(value: _T | None, otherwise: _T) -> _T:
    """Return `value`, or `otherwise` if it is None."""
    return otherwise if value is None else value


def _unique(values: list[_T]) -> list[_T]:
    """Return the distinct values in order."""
    return list(dict.fromkeys(values))
