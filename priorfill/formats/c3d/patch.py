"""Write filled samples into a copy of their source C3D file.

Every other byte of the copy equals the source's: analog channels, events, parameters, header and
measured samples.
Where a user has exchanged markers, the bytes of their samples are exchanged. The copy is written
under a temporary name, read back, compared, and then renamed.
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
from priorfill.formats.file_bytes import check_unchanged, source_errors_explained
from priorfill.formats.write_report import WriteReport, check_filled
from priorfill.runtime.atomic_file import check_target, replace_file
from priorfill.runtime.threads import map_in_threads

__all__ = ["PatchPlan", "beyond_range", "plan_patch", "write_c3d"]

_INTEGERS = np.iinfo(np.int16)

_FLOAT_STEP = float(np.finfo(np.float32).eps)
"""Largest relative error of a coordinate stored in 32 bits, doubled because float64 rounds, too."""

_BATCH_FRAMES = 1000
"""Frames copied or read back at once."""

_ORIGIN_SHIFT = 1e-6
"""File units by which a filled sample at (0, 0, 0) is moved, because it would read as missing."""


@dataclass(frozen=True)
class PatchPlan:
    """A source file, and the samples to write into a copy of it.

    Attributes
    ----------
    source : Source
        The source. It is read in batches, because it may be large.
    size : int
        Size of the source (bytes).
    layout : C3DLayout
        Its layout.
    frames, markers, points : ndarray [shape=(samples,)]
        Frame, marker of the clip, and point of the file of each sample.
    in_units : ndarray [shape=(samples, 3), file units]
        Positions of the samples.
    mm_per_unit : float
        Millimetres per file unit.
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
    """Write a copy of the clip's source file with the filled samples.

    A filled sample gets residual 0 and no cameras, which marks it as interpolated.

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
        The number of samples written, and the rounding error.

    Raises
    ------
    OutputError
        If `path` is the source or exists already; its folder does not exist; the source has
        changed since it was read; or a filled sample has no position or exceeds the range of the
        file's integers.
    FormatError
        If the source no longer exists or cannot be read.

    See Also
    --------
    priorfill.formats.rewrite_c3d : Write floats where integers do not suffice.
    priorfill.formats.create_c3d : Write a clip without a source.
    """
    plan = plan_patch(path, clip, filled, overwrite=overwrite)
    _check_range(plan, clip)
    with replace_file(path, overwrite=overwrite) as temporary:
        _write(temporary, plan)
        worst = _verify(temporary, plan)
    return WriteReport(samples=len(plan.frames), rounding_mm=worst * plan.mm_per_unit)


def plan_patch(
    path: Path | str, clip: Clip, filled: NDArray[np.bool_], *, overwrite: bool = False
) -> PatchPlan:
    """Check that filled samples can be written into a copy of the clip's source.

    Parameters
    ----------
    path, clip, filled, overwrite
        As for `write_c3d`.

    Returns
    -------
    PatchPlan
        The source, and the samples to write.

    Raises
    ------
    OutputError, FormatError
        As for `write_c3d`, except that the range of integers is not checked.
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
    """Return the layout and size (bytes) of the source, which must not have changed."""
    with source_errors_explained(source.path), source.path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        check_unchanged(source.path, digest, source.sha256)
        file.seek(0)
        contents: FileBytes
        try:
            contents = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except (OSError, ValueError):  # unsupported file system; an empty file
            contents = file.read()
        layout, size = parse_layout(contents, source.path.name), len(contents)
        if not isinstance(contents, bytes):
            contents.close()  # Windows replaces no mapped file
        return layout, size


def beyond_range(clip: Clip, filled: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the filled samples that a copy of the clip's source cannot hold.

    Parameters
    ----------
    clip : Clip
        The clip, read from a C3D file, with positions for the filled samples.
    filled : ndarray [shape=(frames, markers), bool]
        Which samples were filled.

    Returns
    -------
    ndarray of bool [shape=(frames, markers)]
        Samples with a coordinate beyond the range of the file's integers; none if it holds floats.

    Raises
    ------
    OutputError, FormatError
        If the source has changed, or cannot be read.
    """
    assert clip.source is not None  # it is to be copied
    layout, _ = _layout(clip.source)
    beyond = np.zeros_like(filled)
    if not layout.is_float:
        in_units = clip.positions[filled] / clip.source.mm_per_unit
        beyond[filled] = _beyond_integers(in_units, layout)
    return beyond


def _beyond_integers(in_units: NDArray[np.float64], layout: C3DLayout) -> NDArray[np.bool_]:
    """Return which positions [shape=(samples, 3), file units] exceed the range of integers."""
    steps = np.rint(in_units / layout.scale)
    return np.asarray(((steps < _INTEGERS.min) | (steps > _INTEGERS.max)).any(axis=1))


def _check_range(plan: PatchPlan, clip: Clip) -> None:
    """Raise OutputError at the first coordinate beyond the range of the file's integers."""
    if plan.layout.is_float:
        return
    beyond = _beyond_integers(plan.in_units, plan.layout)
    if beyond.any():
        first = int(np.argmax(beyond))
        limit = plan.layout.scale * _INTEGERS.max
        raise OutputError(
            f"{clip.name}: the filled position of {clip.labels[plan.markers[first]]} in frame "
            f"{clip.first_frame + int(plan.frames[first])} is "
            f"{np.abs(plan.in_units[first]).max():.4g} file units from the origin; the integers of "
            f"this file end at {limit:.4g}: write a file with float coordinates (`rewrite`)"
        )


def _encode(in_units: NDArray[np.float64], layout: C3DLayout) -> NDArray[np.uint8]:
    """Return the bytes of records with these positions, residual 0 and no cameras."""
    words = np.zeros((len(in_units), WORDS_PER_POINT))
    words[:, :3] = in_units if layout.is_float else np.rint(in_units / layout.scale)
    at_origin = (words == 0).all(axis=1)
    words[at_origin, 2] = _ORIGIN_SHIFT if layout.is_float else 1
    if layout.is_float:
        return encode_floats(words, layout.processor)
    return encode_integers(words.astype(np.int16), layout.processor)


def _batches(plan: PatchPlan) -> Iterator[tuple[NDArray[np.uint8], slice, NDArray[np.intp]]]:
    """Read the source in batches, because it may not fit into memory.

    Yields
    ------
    original : ndarray of uint8
        The next bytes, with the samples that are exchanged in their new places.
    samples : slice
        The samples in them, in order of frames.
    places : ndarray of int [shape=(samples, bytes of a record)]
        Offsets of the samples' records in these bytes.
    """
    layout, path = plan.layout, plan.source.path
    exchanged = plan.source.exchanged()
    cuts = range(0, layout.frames, _BATCH_FRAMES)
    edges = [0, *(layout.data_start + frame * layout.frame_bytes for frame in cuts)]
    # no sample precedes the first frame
    starts = [0, *np.searchsorted(plan.frames, cuts).tolist()]
    digest = hashlib.sha256()
    with source_errors_explained(path):
        file = path.open("rb")
    with file:
        for (first, last), (start, stop) in zip(
            pairwise([*edges, plan.size]), pairwise([*starts, len(plan.frames)]), strict=True
        ):
            with source_errors_explained(path):
                part = file.read(last - first)
            digest.update(part)
            if len(part) != last - first:
                break
            some = slice(start, stop)
            offsets = layout.record_offsets(plan.frames[some], plan.points[some]) - first
            original = _exchanged(np.frombuffer(part, np.uint8), layout, first, exchanged)
            yield original, some, offsets[:, None] + np.arange(layout.record_bytes)
    check_unchanged(path, digest.hexdigest(), plan.source.sha256)  # by now


def _exchanged(
    original: NDArray[np.uint8],
    layout: C3DLayout,
    first: int,
    exchanged: tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]],
) -> NDArray[np.uint8]:
    """Return bytes of the source, from offset ``first``, with exchanged samples in new places.

    The bytes of a sample are its coordinates, residual and cameras.
    """
    frames, points, taken_from = exchanged
    new = layout.record_offsets(frames, points) - first
    old = layout.record_offsets(frames, taken_from) - first
    inside = (new >= 0) & (new < len(original))
    if not inside.any():
        return original
    record = np.arange(layout.record_bytes)
    moved = original.copy()
    moved[new[inside, None] + record] = original[old[inside, None] + record]
    return moved


def _write(temporary: Path, plan: PatchPlan) -> None:
    """Write the source with the filled samples."""
    with temporary.open("wb") as file:
        for original, some, places in _batches(plan):
            part = original.copy()
            part[places] = _encode(plan.in_units[some], plan.layout)
            file.write(part.data)


def _verify(temporary: Path, plan: PatchPlan) -> float:
    """Read the written file back and return the largest error of a coordinate (file units).

    Raises
    ------
    OutputError
        If a byte outside the filled samples differs or a filled sample is wrong, for instance
        because the disk is full; or if the source has changed in the meantime.
    """
    as_intended = temporary.stat().st_size == plan.size
    worst = 0.0
    with temporary.open("rb") as file, map_in_threads(plan.size) as mapped:
        both = ((file.read(len(batch[0])), *batch) for batch in _batches(plan))
        # to the end, where the hash of the source is checked
        for near, error in mapped(lambda batch: _compare(plan, *batch), both):
            as_intended = as_intended and near
            worst = max(worst, error)
    if not as_intended:
        raise OutputError(
            f"{temporary.parent}: the file written there does not read back as intended and was "
            "removed; check the disk and report this as a fault"
        )
    return worst


def _compare(
    plan: PatchPlan,
    read_back: bytes,
    original: NDArray[np.uint8],
    some: slice,
    places: NDArray[np.intp],
) -> tuple[bool, float]:
    """Compare bytes of the written file with a batch of the source.

    Returns
    -------
    as_intended : bool
        Whether only filled samples differ, and these as they should.
    worst : float
        The largest error of a coordinate (file units).
    """
    layout = plan.layout
    written = np.frombuffer(read_back, np.uint8)
    if len(written) != len(original):
        return False, 0.0
    differs = written != original
    differs[places] = False
    words = _decode(written[places], layout)
    expected = plan.in_units[some]
    error = np.abs(words[:, :3] - expected)
    allowed = np.abs(expected) * _FLOAT_STEP + _ORIGIN_SHIFT
    if not layout.is_float:
        allowed = np.full_like(error, layout.scale)
    near = bool((error <= allowed).all())  # False for NaN
    as_intended = near and not differs.any() and not words[:, 3].any()
    return as_intended, float(error.max(initial=0.0))


def _decode(records: NDArray[np.uint8], layout: C3DLayout) -> NDArray[np.float64]:
    """Return position (file units) and fourth word of each record [shape=(n, 4)]."""
    raw = records.tobytes()
    if layout.is_float:
        return decode_floats(raw, layout.processor).reshape(-1, WORDS_PER_POINT)
    words = decode_integers(raw, layout.processor).astype(np.float64)
    words = words.reshape(-1, WORDS_PER_POINT)
    words[:, :3] *= layout.scale
    return words
