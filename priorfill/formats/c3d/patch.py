"""Write filled samples into a copy of the C3D file that they were missing from.

Everything else in the copy, byte for byte, is as in the source: analog channels, events, every
parameter, the header, the measured samples. What was written is read back and compared
before it gets its name.
"""

from __future__ import annotations

import hashlib
import mmap
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip, Source
from priorfill.errors import OutputError
from priorfill.formats.c3d.encoding import (
    decode_floats,
    decode_integers,
    encode_floats,
    encode_integers,
)
from priorfill.formats.c3d.layout import WORDS_PER_POINT, C3DLayout, parse_layout
from priorfill.formats.c3d.parameters import FileBytes
from priorfill.formats.file_bytes import check_unchanged, os_errors_explained
from priorfill.formats.write_report import WriteReport, check_filled
from priorfill.runtime.atomic_file import check_target, replace_file

__all__ = ["PatchPlan", "plan_patch", "write_c3d"]

_INTEGERS = np.iinfo(np.int16)

_FLOAT_STEP = float(np.finfo(np.float32).eps)
"""Largest relative error of a number stored in 32 bits, twice over: float64 rounds too."""

_FRAMES_AT_ONCE = 1000
"""Frames copied, and read back, at once."""

_OFF_ORIGIN = 1e-6
"""File units by which a sample at the very origin is moved: there it would read as missing."""


@dataclass(frozen=True)
class PatchPlan:
    """A source file, and the samples that are to be written into a copy.

    Attributes
    ----------
    source : Source
        The source: it is gone through part by part, as it may be large.
    size : int
        Its bytes.
    layout : C3DLayout
        Where its samples are.
    frames, markers, points : ndarray [shape=(samples,)]
        Frame, marker of the clip and point of the file of each sample.
    in_units : ndarray [shape=(samples, 3), file units]
        Their positions.
    mm_per_unit : float
        Millimetres in a file unit.
    """

    source: Source
    size: int
    layout: C3DLayout
    frames: NDArray[np.intp]
    markers: NDArray[np.intp]
    points: NDArray[np.intp]
    in_units: NDArray[np.float64]
    mm_per_unit: float


def write_c3d(
    path: Path | str, clip: Clip, filled: NDArray[np.bool_], *, overwrite: bool = False
) -> WriteReport:
    """Write a copy of the clip's source file in which the filled samples are present.

    A filled sample gets residual 0 and no cameras, the format's sign for "interpolated".

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
        How many samples were written, and how well the file holds them.

    Raises
    ------
    OutputError
        If `path` is the source, exists already, or its folder does not; the source has
        changed since it was read; or a filled sample is missing or does not fit the
        file's integers.
    FormatError
        If the source is gone or cannot be read.
    """
    plan = plan_patch(path, clip, filled, overwrite=overwrite)
    _check_range(plan, clip)
    with replace_file(path, overwrite=overwrite) as temporary:
        _write(temporary, plan)
        worst = _verify(temporary, plan)
    return WriteReport(samples=len(plan.frames), worst_error_mm=worst * plan.mm_per_unit)


def plan_patch(
    path: Path | str, clip: Clip, filled: NDArray[np.bool_], *, overwrite: bool = False
) -> PatchPlan:
    """Check that filled samples can be written into a copy of the clip's source.

    C3DParameters
    ----------
    path, clip, filled, overwrite
        As `write_c3d` takes them.

    Returns
    -------
    PatchPlan
        The source and the samples to write.

    Raises
    ------
    OutputError, FormatError
        As `write_c3d` does, but for the range of an integer file.
    """
    source = clip.source
    if source is None:
        raise OutputError(f"{clip.name}: comes from no file to copy; write it as a new file")
    filled = check_filled(clip, filled)
    check_target(path, overwrite=overwrite, source=source.path)
    frames, markers = np.nonzero(filled)
    values = clip.positions[frames, markers]
    layout, size = _layout(source)
    return PatchPlan(
        source=source,
        size=size,
        layout=layout,
        frames=frames.astype(np.intp),
        markers=markers.astype(np.intp),
        points=np.asarray(source.points, dtype=np.intp)[markers],
        in_units=values / source.mm_per_unit,
        mm_per_unit=source.mm_per_unit,
    )


def _layout(source: Source) -> tuple[C3DLayout, int]:
    """Return where the source's samples are, and its bytes; it is as it was read."""
    with os_errors_explained(source.path), source.path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        check_unchanged(source.path, digest, source.sha256)
        file.seek(0)
        contents: FileBytes
        try:
            contents = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except (OSError, ValueError):  # not on every file system; a file just emptied
            contents = file.read()
        return parse_layout(contents, source.path.name), len(contents)


def _check_range(plan: PatchPlan, clip: Clip) -> None:
    """Raise OutputError at the first coordinate that the file's numbers cannot hold."""
    if plan.layout.is_float:
        return
    steps = np.rint(plan.in_units / plan.layout.scale)
    beyond = ((steps < _INTEGERS.min) | (steps > _INTEGERS.max)).any(axis=1)
    if beyond.any():
        first = int(np.argmax(beyond))
        limit = plan.layout.scale * _INTEGERS.max
        raise OutputError(
            f"{clip.name}: the filled position of {clip.labels[plan.markers[first]]} in frame "
            f"{clip.first_frame + int(plan.frames[first])} is "
            f"{np.abs(plan.in_units[first]).max():.4g} file units from the origin; this file's "
            f"integers end at {limit:.4g}: write a file with float coordinates (--rewrite)"
        )


def _encode(in_units: NDArray[np.float64], layout: C3DLayout) -> NDArray[np.uint8]:
    """Return the bytes of the records: position, then residual 0 and no cameras."""
    words = np.zeros((len(in_units), WORDS_PER_POINT))
    words[:, :3] = in_units if layout.is_float else np.rint(in_units / layout.scale)
    at_origin = (words == 0).all(axis=1)
    words[at_origin, 2] = _OFF_ORIGIN if layout.is_float else 1
    if layout.is_float:
        return encode_floats(words, layout.processor)
    return encode_integers(words.astype(np.int16), layout.processor)


def _parts(plan: PatchPlan) -> Iterator[tuple[NDArray[np.uint8], slice, NDArray[np.intp]]]:
    """Go through the source, from end to end: it may be too large to have it in memory.

    Yields
    ------
    original : ndarray of uint8
        The next bytes of it.
    samples : slice
        The samples in them, which are in order of frames.
    places : ndarray of int [shape=(samples, bytes of a record)]
        Where in these bytes the samples' records are.
    """
    layout, path = plan.layout, plan.source.path
    cuts = range(0, layout.frames, _FRAMES_AT_ONCE)
    edges = [0, *(layout.data_start + frame * layout.frame_bytes for frame in cuts)]
    # no sample is before the first frame
    starts = [0, *np.searchsorted(plan.frames, cuts).tolist()]
    digest = hashlib.sha256()
    with os_errors_explained(path):
        file = path.open("rb")
    with file:
        for (first, last), (start, stop) in zip(
            pairwise([*edges, plan.size]), pairwise([*starts, len(plan.frames)]), strict=True
        ):
            with os_errors_explained(path):
                part = file.read(last - first)
            digest.update(part)
            if len(part) != last - first:
                break
            some = slice(start, stop)
            offsets = layout.record_offsets(plan.frames[some], plan.points[some]) - first
            original = np.frombuffer(part, np.uint8)
            yield original, some, offsets[:, None] + np.arange(layout.record_bytes)
    check_unchanged(path, digest.hexdigest(), plan.source.sha256)  # meanwhile


def _write(temporary: Path, plan: PatchPlan) -> None:
    """Write the source with the filled samples in it."""
    with temporary.open("wb") as file:
        for original, some, places in _parts(plan):
            part = original.copy()
            part[places] = _encode(plan.in_units[some], plan.layout)
            file.write(part.data)


def _verify(temporary: Path, plan: PatchPlan) -> float:
    """Read the written file back and return the largest error of a coordinate (file units).

    Raises
    ------
    OutputError
        If a byte beside the filled samples has changed, or a filled sample is not as it
        should be: neither has a cause that we know; a full disk and a faulty program have.
        Or if the source has changed meanwhile.
    """
    layout = plan.layout
    as_intended = temporary.stat().st_size == plan.size
    worst = 0.0
    with temporary.open("rb") as file:
        for original, some, places in _parts(plan):  # to its end, which tells if it has changed
            written = np.frombuffer(file.read(len(original)), np.uint8)
            if not as_intended or len(written) != len(original):
                as_intended = False
                continue
            differs = written != original
            differs[places] = False
            words = _decode(written[places], layout)
            expected = plan.in_units[some]
            error = np.abs(words[:, :3] - expected)
            allowed = np.abs(expected) * _FLOAT_STEP + _OFF_ORIGIN
            if not layout.is_float:
                allowed = np.full_like(error, layout.scale)
            near = bool((error <= allowed).all())  # of NaN it is not
            as_intended = near and not differs.any() and not words[:, 3].any()
            worst = max(worst, float(error.max(initial=0.0)))
    if not as_intended:
        raise OutputError(
            f"{temporary.parent}: the file written there does not read back as intended and was "
            "removed; check the disk and report this as a fault"
        )
    return worst


def _decode(records: NDArray[np.uint8], layout: C3DLayout) -> NDArray[np.float64]:
    """Return the words of records: position (file units), then the fourth [shape=(n, 4)]."""
    raw = records.tobytes()
    if layout.is_float:
        return decode_floats(raw, layout.processor).reshape(-1, WORDS_PER_POINT)
    words = decode_integers(raw, layout.processor).astype(np.float64)
    words = words.reshape(-1, WORDS_PER_POINT)
    words[:, :3] *= layout.scale
    return words
