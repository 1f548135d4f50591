"""Rewrite a clip's source file through ezc3d, for filled samples that a copy cannot hold.

The integers of a file end at 32767 steps; filled samples beyond do not fit into a copy. The new
file has float coordinates. Everything else is as ezc3d writes it; it is compared with the source,
and the differences are reported.
"""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import OutputError, PriorfillError
from priorfill.formats.c3d.encoding import Processor, decode_floats, decode_integers
from priorfill.formats.c3d.ezc3d_path import ezc3d_path
from priorfill.formats.c3d.layout import (
    WORDS_PER_POINT,
    C3DLayout,
    parse_layout,
    read_points,
)
from priorfill.formats.c3d.parameters import ParameterValue
from priorfill.formats.c3d.patch import PatchPlan, plan_patch
from priorfill.formats.c3d.read import read_c3d_bytes
from priorfill.formats.file_bytes import check_unchanged
from priorfill.formats.write_report import WriteReport
from priorfill.runtime.atomic_file import replace_file

__all__ = ["rewrite_c3d"]

_MAX_EZC3D_FRAMES = 65535
"""Maximum number of frames that ezc3d reads and writes."""

_FLOAT_STEP = 2 * float(np.finfo(np.float32).eps)
"""Relative error up to which coordinates stored in 32 bits count as equal."""

_MAX_ENTRIES = 255
"""Maximum entries of one parameter; longer lists continue in LABELS2, LABELS3, ..."""

_ANALOG_ERROR = 1e-5
"""Relative error up to which analog values count as equal; ezc3d scales them twice."""

_EVENT_KEY = 0x3039
_EVENT_WORDS = slice(149, 151)
_EVENT_TIMES = 304
"""Events in the header: their key (12345), the words with key and number of events, and the byte
offset of their times."""

_MAX_EVENTS = 18
"""Maximum number of events in a header."""

_ADDRESSES = frozenset({("POINT", "DATA_START")})
"""Parameters with positions in the file, which differ between any two files."""

_WORD_RANGE = (-(1 << 15), (1 << 16) - 1)
"""Range of the fourth word of a sample, signed or unsigned."""

_MAX_CAMERA_MASK = 0x7F
_RESIDUAL_BITS = 8
"""The fourth word of a sample: seven camera bits above eight bits of residual."""


def rewrite_c3d(
    path: Path | str, clip: Clip, filled: NDArray[np.bool_], *, overwrite: bool = False
) -> WriteReport:
    """Write the contents of the clip's source with the filled samples and float coordinates.

    Parameters
    ----------
    path : Path or str
        The file to write; never the source.
    clip : Clip
        The clip, read from a C3D file, with positions for the filled samples.
    filled : ndarray [shape=(frames, markers), bool]
        Which samples to write.
    overwrite : bool
        Replace an existing file.

    Returns
    -------
    WriteReport
        The number of samples written, the rounding error, and other differences to the source.

    Raises
    ------
    OutputError
        As for `write_c3d`, and if ezc3d cannot read the source or write it back.
    FormatError
        If the source no longer exists or cannot be read.

    See Also
    --------
    priorfill.formats.write_c3d : Write a byte-exact copy, which is preferable where it is possible.
    """
    import ezc3d  # slow; imported late to keep `--help` fast

    plan = plan_patch(path, clip, filled, overwrite=overwrite)
    assert clip.source is not None  # checked by plan_patch
    _check_suits_ezc3d(plan.layout, clip.source.path.name)
    with replace_file(path, overwrite=overwrite) as temporary:
        try:
            with ezc3d_path(clip.source.path) as plain:
                content = ezc3d.c3d(plain)
            data = content["data"]
            _exchange(data, *plan.source.exchanged())
            data["points"][:3, plan.points, plan.frames] = plan.in_units.T
            data["meta_points"]["residuals"][0, plan.points, plan.frames] = 0
            data["meta_points"]["camera_masks"][:, plan.points, plan.frames] = False
            _fit_labels(content, "POINT", data["points"].shape[1])
            _fit_labels(content, "ANALOG", data["analogs"].shape[1])
            with ezc3d_path(temporary, write=True) as plain:
                content.write(plain)
        except Exception as error:  # its C++ part raises errors of any type
            reason = " ".join(str(error).split())
            raise OutputError(
                f"{clip.source.path.name}: ezc3d cannot rewrite this file ({reason}); "
                "write a copy (without `rewrite`) and leave what does not fit unfilled"
            ) from error
        written = temporary.read_bytes()
        worst, changes = _compare(plan, written, clip.source.path.name)
    return WriteReport(
        samples=len(plan.frames),
        rounding_mm=worst * plan.mm_per_unit,
        changes=tuple(changes),
    )


def _exchange(
    data: Any,
    frames: NDArray[np.intp],
    points: NDArray[np.intp],
    taken_from: NDArray[np.intp],
) -> None:
    """Exchange samples in ezc3d's content, with their residuals and cameras.

    ezc3d takes the upper byte of the fourth word for the residual and the lower one for the
    cameras; both are exchanged, so that nothing depends on it.
    """
    for values in (
        data["points"],
        data["meta_points"]["residuals"],
        data["meta_points"]["camera_masks"],
    ):
        values[:, points, frames] = values[:, taken_from, frames]


def _check_suits_ezc3d(layout: C3DLayout, name: str) -> None:
    """Raise OutputError if ezc3d would misread a file, hang or crash.

    ezc3d does not support MIPS; it prefers the header where the parameters are right; it reads at
    most 65535 frames; it hangs for minutes if a description's length is wrong; and it crashes
    (segmentation fault in ezc3d 1.7.2) if analog channels have no scale or offset, which the format
    allows.
    """
    parameters = layout.parameters
    channels = parameters.count("ANALOG", "USED") or 0
    described = min(parameters.numbers("ANALOG", what).size for what in ("SCALE", "OFFSET"))
    for is_so, reason in (
        (layout.processor is Processor.MIPS, "has the number format of MIPS"),
        (bool(layout.contradictions), "contradicts itself"),
        (not parameters.regular, "has descriptions of a wrong length"),
        (layout.frames > _MAX_EZC3D_FRAMES, f"has more than {_MAX_EZC3D_FRAMES} frames"),
        (
            layout.analog_words > 0 and not 0 < channels <= described,
            "has analog channels without scale or offset",
        ),
    ):
        if is_so:
            raise OutputError(
                f"{name}: {reason}, so ezc3d cannot rewrite it; "
                "write a copy (without `rewrite`) and leave what does not fit unfilled"
            )


def _fit_labels(content: Any, group: str, count: int) -> None:
    """Adjust the number of labels in ezc3d's content to that of points or channels.

    A different number is legal and common, but ezc3d does not write it.
    """
    parameters = content["parameters"][group]
    parts = ["LABELS"]
    while f"LABELS{len(parts) + 1}" in parameters:
        parts.append(f"LABELS{len(parts) + 1}")
    labels = [label for part in parts for label in parameters[part]["value"]]
    if len(labels) == count:
        return
    labels = [*labels, *[""] * count][:count]
    for number in range(max(len(parts), -(-count // _MAX_ENTRIES))):
        part = f"LABELS{number + 1}" if number else "LABELS"
        some = labels[number * _MAX_ENTRIES : (number + 1) * _MAX_ENTRIES]
        if part in parameters:
            parameters[part]["value"] = some
        else:
            content.add_parameter(group, part, some)


def _compare(plan: PatchPlan, written: bytes, name: str) -> tuple[float, list[str]]:
    """Return the largest error of a filled coordinate (file units), and other differences.

    Raises
    ------
    OutputError
        If a sample has moved, or the source has changed in the meantime.
    """
    before = plan.layout
    original = read_c3d_bytes(plan.source.path)
    source = plan.source
    check_unchanged(source.path, hashlib.sha256(original).hexdigest(), source.sha256)
    expected, residual = read_points(original, before)
    expected[residual < 0] = np.nan
    expected[np.isnan(expected).any(axis=2)] = np.nan
    frames, points, taken_from = source.exchanged()
    expected[frames, points] = expected[frames, taken_from]
    expected[plan.frames, plan.points] = plan.in_units
    failed = OutputError(
        f"{name}: ezc3d changes samples of this file when writing it; "
        "write a copy (without `rewrite`) and leave what does not fit unfilled"
    )
    try:
        after = parse_layout(written, name)
    except PriorfillError:
        raise failed from None
    positions, residual = read_points(written, after)
    positions[residual < 0] = np.nan
    if positions.shape != expected.shape or not np.allclose(
        positions, expected, rtol=_FLOAT_STEP, atol=0, equal_nan=True
    ):
        raise failed
    error = np.abs(positions[plan.frames, plan.points] - plan.in_units)
    untouched = np.asarray(~np.isnan(expected).any(axis=2))
    untouched[plan.frames, plan.points] = False
    untouched[frames, points] = False
    return float(error.max(initial=0.0)), list(
        _changes(original, before, written, after, untouched)
    )


def _changes(
    original: bytes,
    before: C3DLayout,
    written: bytes,
    after: C3DLayout,
    untouched: NDArray[np.bool_],
) -> Iterator[str]:
    """Yield the differences between two files outside the filled samples."""
    if before.is_float != after.is_float:
        yield "coordinates are floats instead of integers"
    if before.processor is not after.processor:
        yield f"number format {after.processor.name} instead of {before.processor.name}"
    if before.first_frame != after.first_frame:
        yield f"the first frame is {after.first_frame} instead of {before.first_frame}"
    events = len(_events(original, before))
    if not np.array_equal(_events(original, before), _events(written, after)):
        yield f"the header's events differ ({events} in the source)"
    other = [
        int((one != two)[untouched].sum())
        for one, two in zip(_quality(original, before), _quality(written, after), strict=True)
    ]
    for what, samples in zip(("cameras", "residuals"), other, strict=True):
        if samples:
            yield f"{what} of {samples} measured samples differ"
    if not _same_analog(original, before, written, after):
        yield "analog values differ"
    yield from _parameter_changes(before, after)


def _events(data: bytes, layout: C3DLayout) -> NDArray[np.float64]:
    """Return the times (s) of the events in a file's header [shape=(events,)]."""
    key, count = decode_integers(data[:512], layout.processor)[_EVENT_WORDS]
    if key != _EVENT_KEY or not 0 < count <= _MAX_EVENTS:
        return np.empty(0)
    return decode_floats(data[_EVENT_TIMES : _EVENT_TIMES + 4 * int(count)], layout.processor)


def _quality(data: bytes, layout: C3DLayout) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return cameras, and residuals in thousandths of a file unit [shape=(frames, points)]."""
    # a float may have any value; one beyond 16 bits holds neither cameras nor residual
    words = np.nan_to_num(read_points(data, layout)[1]).clip(*_WORD_RANGE).astype(np.int64)
    cameras = (words >> _RESIDUAL_BITS) & _MAX_CAMERA_MASK
    steps = words & ((1 << _RESIDUAL_BITS) - 1)
    with np.errstate(over="ignore", invalid="ignore"):  # a damaged scale
        return cameras, np.nan_to_num(np.rint(1000 * layout.scale * steps))


def _same_analog(original: bytes, before: C3DLayout, written: bytes, after: C3DLayout) -> bool:
    """Check whether two files have the same scaled analog values."""
    one, two = _analog(original, before), _analog(written, after)
    if one.shape != two.shape:
        return False
    known = np.isfinite(one)
    if not np.array_equal(known, np.isfinite(two)):
        return False
    one, two = one[known], two[known]
    largest = float(np.abs(one).max(initial=0.0))
    return bool(np.allclose(one, two, rtol=_ANALOG_ERROR, atol=_ANALOG_ERROR * largest))


def _analog(data: bytes, layout: C3DLayout) -> NDArray[np.float64]:
    """Return a file's scaled analog values [shape=(frames, samples, channels)]."""
    channels = layout.parameters.count("ANALOG", "USED") or 0
    if layout.analog_words == 0 or channels == 0:
        return np.empty((layout.frames, 0, 0))
    stop = layout.data_start + layout.frames * layout.frame_bytes
    section = memoryview(data)[layout.data_start : stop]
    if layout.is_float:
        words = decode_floats(section, layout.processor)
    else:
        words = decode_integers(section, layout.processor).astype(np.float64)
        if "UNSIGNED" in layout.parameters.texts("ANALOG", "FORMAT"):
            words %= 1 << 16
    values = words.reshape(layout.frames, -1)[:, WORDS_PER_POINT * layout.points :]
    values = values.reshape(layout.frames, -1, channels)
    offset = layout.parameters.numbers("ANALOG", "OFFSET")[:channels]
    scale = layout.parameters.numbers("ANALOG", "SCALE")[:channels]
    common = layout.parameters.number("ANALOG", "GEN_SCALE")
    with np.errstate(over="ignore", invalid="ignore"):  # a damaged scale, or values
        scaled: NDArray[np.float64] = (
            (values - offset) * scale * (1.0 if common is None else common)
        )
    return scaled


def _parameter_changes(before: C3DLayout, after: C3DLayout) -> Iterator[str]:
    """Yield one description for each group whose parameters differ."""
    old, new = dict(before.parameters.items()), dict(after.parameters.items())
    groups: dict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    for key in dict.fromkeys((*old, *new)):
        if key in _ADDRESSES:
            continue
        group, name = key
        if key not in new:
            groups[group]["lost"].append(name)
        elif key not in old:
            groups[group]["added"].append(name)
        elif not _same(old[key], new[key]):
            groups[group]["changed"].append(name)
    for group, found in groups.items():
        parts = [f"{what} {', '.join(names)}" for what, names in found.items()]
        yield f"parameters of {group}: {'; '.join(parts)}"


def _same(one: ParameterValue, two: ParameterValue) -> bool:
    """Check whether two parameters have the same contents."""
    if isinstance(one, list) or isinstance(two, list):
        return one == two
    return np.array_equal(one.astype(np.float32), two.astype(np.float32), equal_nan=True)
