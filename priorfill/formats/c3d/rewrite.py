"""Write a clip's source file anew through ezc3d, where a copy cannot hold what is filled.

A file of integers ends at 32767 steps; what is filled beyond has no place in a copy of it. The
new file has float coordinates, and is otherwise what ezc3d makes of the source: that is compared,
and what has changed is said.
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
from priorfill.formats.c3d.layout import (
    WORDS_PER_POINT,
    C3DLayout,
    parse_layout,
    read_points,
)
from priorfill.formats.c3d.parameters import Value
from priorfill.formats.c3d.patch import PatchPlan, plan_patch
from priorfill.formats.c3d.read import read_c3d_bytes
from priorfill.formats.file_bytes import check_unchanged
from priorfill.formats.write_report import WriteReport
from priorfill.runtime.atomic_file import replace_file

__all__ = ["rewrite_c3d"]

_MOST_FRAMES = 65535
"""Frames that ezc3d reads and writes at most."""

_FLOAT_STEP = 2 * float(np.finfo(np.float32).eps)
"""Largest relative error of a coordinate that goes through 32 bits, a few times over."""

_LIST = 255
"""Entries of one parameter at most; longer lists go on in LABELS2, LABELS3, ..."""

_ANALOG_ERROR = 1e-5
"""Relative error up to which analog values are the same: they are scaled there and back."""

_EVENT_KEY = 0x3039
_EVENT_WORDS = slice(149, 151)
_EVENT_TIMES = 304
"""C3DHeader: the words with the key, 12345, and the number of events; the byte of their times."""

_MOST_EVENTS = 18
"""Events that a header has room for."""

_PLACES = frozenset({("POINT", "DATA_START")})
"""C3DParameters that say where things are in the file, which differs of course."""

_WORD = (-(1 << 15), (1 << 16) - 1)
"""What the fourth word of a sample can be, signed or not."""

_LARGEST_MASK = 0x7F
_RESIDUAL_BITS = 8
"""The fourth word of a sample: seven cameras above, the residual in the lower eight bits."""


def rewrite_c3d(
    path: Path | str, clip: Clip, filled: NDArray[np.bool_], *, overwrite: bool = False
) -> WriteReport:
    """Write what the clip's source holds, with the filled samples, as a file of float numbers.

    C3DParameters
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
        How many samples were written, how well the file holds them, and what else has changed.

    Raises
    ------
    OutputError
        Where `write_c3d` does, and if ezc3d cannot read the source or write it back.
    FormatError
        If the source is gone or cannot be read.
    """
    import ezc3d  # slow to import, and `--help` should not wait for it

    plan = plan_patch(path, clip, filled, overwrite=overwrite)
    assert clip.source is not None  # plan_patch has seen to it
    _check_suits_ezc3d(plan.layout, clip.source.path.name)
    with replace_file(path, overwrite=overwrite) as temporary:
        try:
            content = ezc3d.c3d(str(clip.source.path))
            data = content["data"]
            data["points"][:3, plan.points, plan.frames] = plan.in_units.T
            data["meta_points"]["residuals"][0, plan.points, plan.frames] = 0
            data["meta_points"]["camera_masks"][:, plan.points, plan.frames] = False
            _fit_labels(content, "POINT", data["points"].shape[1])
            _fit_labels(content, "ANALOG", data["analogs"].shape[1])
            content.write(str(temporary))
        except Exception as error:  # its C++ side raises whatever it likes
            reason = " ".join(str(error).split())
            raise OutputError(
                f"{clip.source.path.name}: ezc3d cannot rewrite this file ({reason}); "
                "write a copy (without --rewrite) and leave what does not fit unfilled"
            ) from error
        written = temporary.read_bytes()
        worst, changes = _compare(plan, written, clip.source.path.name)
    return WriteReport(
        samples=len(plan.frames),
        worst_error_mm=worst * plan.mm_per_unit,
        changes=tuple(changes),
    )


def _check_suits_ezc3d(layout: C3DLayout, name: str) -> None:
    """Raise OutputError if a file has what ezc3d misreads, hangs on or crashes on.

    It does not know MIPS; it believes the header where the parameters are right; it reads no
    more than 65535 frames; it loses its way, for minutes, where a description's length is
    wrong; and it ends the whole program (segmentation fault, ezc3d 1.7.2) where analog
    channels have no scale or offset, which the format allows.
    """
    parameters = layout.parameters
    channels = parameters.count("ANALOG", "USED") or 0
    described = min(parameters.numbers("ANALOG", what).size for what in ("SCALE", "OFFSET"))
    for is_so, reason in (
        (layout.processor is Processor.MIPS, "is of a MIPS computer"),
        (bool(layout.contradictions), "contradicts itself"),
        (not parameters.regular, "has descriptions of a wrong length"),
        (layout.frames > _MOST_FRAMES, f"has more than {_MOST_FRAMES} frames"),
        (
            layout.analog_words > 0 and not 0 < channels <= described,
            "has analog channels without scale or offset",
        ),
    ):
        if is_so:
            raise OutputError(
                f"{name}: {reason}, so that ezc3d cannot rewrite it; "
                "write a copy (without --rewrite) and leave what does not fit unfilled"
            )


def _fit_labels(content: Any, group: str, count: int) -> None:
    """Make the labels of ezc3d's content as many as there are points or channels.

    More and fewer are legal and common, but ezc3d does not write them.
    """
    parameters = content["parameters"][group]
    parts = ["LABELS"]
    while f"LABELS{len(parts) + 1}" in parameters:
        parts.append(f"LABELS{len(parts) + 1}")
    labels = [label for part in parts for label in parameters[part]["value"]]
    if len(labels) == count:
        return
    labels = [*labels, *[""] * count][:count]
    for number in range(max(len(parts), -(-count // _LIST))):
        part = f"LABELS{number + 1}" if number else "LABELS"
        some = labels[number * _LIST : (number + 1) * _LIST]
        if part in parameters:
            parameters[part]["value"] = some
        else:
            content.add_parameter(group, part, some)


def _compare(plan: PatchPlan, written: bytes, name: str) -> tuple[float, list[str]]:
    """Return the largest error of a filled coordinate (file units), and what else has changed.

    Raises
    ------
    OutputError
        If a sample is not where it should be, or the source has changed meanwhile.
    """
    before = plan.layout
    original = read_c3d_bytes(plan.source.path)
    source = plan.source
    check_unchanged(source.path, hashlib.sha256(original).hexdigest(), source.sha256)  # meanwhile
    expected, residual = read_points(original, before)
    expected[residual < 0] = np.nan
    expected[np.isnan(expected).any(axis=2)] = np.nan
    expected[plan.frames, plan.points] = plan.in_units
    failed = OutputError(
        f"{name}: ezc3d does not write back all of this file's samples as they are; "
        "write a copy (without --rewrite) and leave what does not fit unfilled"
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
    """Yield what differs between two files, beside the filled samples."""
    if before.is_float != after.is_float:
        yield "coordinates are floats instead of integers"
    if before.processor is not after.processor:
        yield f"numbers are {after.processor.name}'s instead of {before.processor.name}'s"
    if before.first_frame != after.first_frame:
        yield f"the first frame is {after.first_frame} instead of {before.first_frame}"
    events = len(_events(original, before))
    if not np.array_equal(_events(original, before), _events(written, after)):
        yield f"the header's events, {events}, are not as they were"
    other = [
        int((one != two)[untouched].sum())
        for one, two in zip(_quality(original, before), _quality(written, after), strict=True)
    ]
    for what, samples in zip(("cameras", "residuals"), other, strict=True):
        if samples:
            yield f"{what} of {samples} measured samples are not as they were"
    if not _same_analog(original, before, written, after):
        yield "analog values are not as they were"
    yield from _parameter_changes(before, after)


def _events(data: bytes, layout: C3DLayout) -> NDArray[np.float64]:
    """Return the times of the events that a file's header holds."""
    key, count = decode_integers(data[:512], layout.processor)[_EVENT_WORDS]
    if key != _EVENT_KEY or not 0 < count <= _MOST_EVENTS:
        return np.empty(0)
    return decode_floats(data[_EVENT_TIMES : _EVENT_TIMES + 4 * int(count)], layout.processor)


def _quality(data: bytes, layout: C3DLayout) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return cameras, and residuals in thousandths of a file unit [shape=(frames, points)]."""
    # a float may be anything; what has more than 16 bits says nothing of cameras or residuals
    words = np.nan_to_num(read_points(data, layout)[1]).clip(*_WORD).astype(np.int64)
    cameras = (words >> _RESIDUAL_BITS) & _LARGEST_MASK
    steps = words & ((1 << _RESIDUAL_BITS) - 1)
    with np.errstate(over="ignore", invalid="ignore"):  # a damaged scale
        return cameras, np.nan_to_num(np.rint(1000 * layout.scale * steps))


def _same_analog(original: bytes, before: C3DLayout, written: bytes, after: C3DLayout) -> bool:
    """Tell if two files have the same analog values, scaled as each says."""
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
    """Return a file's analog values [shape=(frames, samples, channels), as scaled]."""
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
    whole = layout.parameters.number("ANALOG", "GEN_SCALE")
    with np.errstate(over="ignore", invalid="ignore"):  # a damaged scale, or values
        scaled: NDArray[np.float64] = (values - offset) * scale * (1.0 if whole is None else whole)
    return scaled


def _parameter_changes(before: C3DLayout, after: C3DLayout) -> Iterator[str]:
    """Yield a sentence for each group whose parameters differ."""
    old, new = dict(before.parameters.items()), dict(after.parameters.items())
    groups: dict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    for key in dict.fromkeys((*old, *new)):
        if key in _PLACES:
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


def _same(one: Value, two: Value) -> bool:
    """Tell if two parameters hold the same."""
    if isinstance(one, list) or isinstance(two, list):
        return one == two
    return np.array_equal(one.astype(np.float32), two.astype(np.float32), equal_nan=True)
