"""From what a file holds to a clip: what formats other than C3D have in common."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip, Source
from priorfill.errors import (
    ClipError,
    FormatError,
    OptionError,
    OutputError,
)
from priorfill.formats.c3d.parameters import Parameters
from priorfill.formats.c3d.point_kinds import find_model_points, split_label
from priorfill.formats.contents import check_unchanged, read_contents
from priorfill.formats.subjects import choose_subject
from priorfill.formats.units import find_unit
from priorfill.formats.up_axis import find_up_axis

__all__ = [
    "LARGEST",
    "Reading",
    "Recording",
    "check_filled",
    "check_size",
    "make_clip",
    "read_bounded",
    "read_source",
]

LARGEST = 1 << 30
"""Bytes of the largest file, or array in a file, that is read: ten hours of 50 markers at 100 Hz
as text are about as much, and reading text takes several times its size in memory."""

FARTHEST = 1e12
"""In any unit of length: no marker is farther away, and squares stay finite."""

_NOTHING_DECLARED = Parameters({})
"""Only C3D files declare which points are model outputs."""


@dataclass(frozen=True)
class Reading:
    """How a file is to be understood; see `priorfill.formats.read`."""

    zeros_missing: bool = True
    up: str | None = None
    rate: float | None = None
    unit: str | None = None
    subject: str | None = None


@dataclass(frozen=True)
class Recording:
    """What a file holds, before it is said which of it are markers.

    Attributes
    ----------
    positions : ndarray [shape=(frames, points, 3), file units]
        NaN where the file says so or has no number.
    labels : tuple of str
        As the file spells them, with the subject's prefix.
    rate : float or None
        Frames per second (Hz); None if the file does not tell, or tells nonsense.
    unit : str
        Unit of length as the file spells it; empty if it does not.
    first_frame : int
        Number of the first frame.
    up : str
        The up axis as the file says it; empty if it does not.
    usual_up : str
        The up axis that is usual in such files, for when nothing tells.
    subject : str
        Whose motion it is, where the file says so apart from the labels.
    no_markers : mapping of int to str
        Points that the file says are no markers, with the reason.
    notes : tuple of str
        What a user should know, a sentence each.
    interpolated : ndarray [shape=(frames, points), bool] or None
        Which samples the file says are filled.
    """

    positions: NDArray[np.float64]
    labels: tuple[str, ...]
    rate: float | None
    unit: str
    first_frame: int = 1
    up: str = ""
    usual_up: str = "+Z"
    subject: str = ""
    no_markers: Mapping[int, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    interpolated: NDArray[np.bool_] | None = None


def check_size(size: int, name: str) -> None:
    """Raise FormatError if something is too large to be read."""
    if size > LARGEST:
        raise FormatError(
            f"{name}: holds {size / 2**30:.1f} GiB; at most {LARGEST / 2**30:.0f} GiB are read: "
            "export it in parts"
        )


def read_bounded(path: Path) -> bytes:
    """Return a file's contents.

    Raises
    ------
    FormatError
        If it cannot be read, or is larger than `LARGEST`.
    """
    with suppress(OSError):  # reading says better what is wrong
        check_size(path.stat().st_size, path.name)
    return read_contents(path, most=LARGEST)


def read_source(source: Source) -> bytes:
    """Return the contents of the file that a clip was read from.

    Raises
    ------
    FormatError
        If it is gone.
    OutputError
        If it has changed since.
    """
    data = read_bounded(source.path)
    check_unchanged(source.path, hashlib.sha256(data).hexdigest(), source.sha256)
    return data


def check_filled(clip: Clip, filled: NDArray[np.bool_] | None) -> NDArray[np.bool_]:
    """Return the mask of filled samples, of none if there is none.

    Raises
    ------
    OutputError
        If its shape is wrong, or a filled sample has no position.
    """
    if filled is None:
        return np.zeros_like(clip.missing)
    filled = np.asarray(filled, dtype=bool)
    if filled.shape != clip.missing.shape:
        raise OutputError(
            f"{clip.name}: the mask of filled samples has shape {filled.shape}; "
            f"{clip.missing.shape} (frames, markers) is needed"
        )
    unknown = filled & clip.missing
    if unknown.any():
        frame, marker = np.argwhere(unknown)[0]
        raise OutputError(
            f"{clip.name}: marker {clip.labels[marker]} is to be written as filled in frame "
            f"{clip.first_frame + int(frame)} but has no position; mark only samples that have one"
        )
    return filled


def make_clip(
    recording: Recording,
    name: str,
    reading: Reading,
    *,
    path: Path | None = None,
    data: bytes = b"",
    format: str = "",
) -> Clip:
    """Make a clip of what a file holds.

    Parameters
    ----------
    recording : Recording
        What the file holds.
    name : str
        What to call the file in messages.
    reading : Reading
        How it is to be understood.
    path : Path or None
        The file; None for what comes from memory, which gets no source.
    data : bytes
        The file's contents.
    format : str
        The name of the file's format.

    Raises
    ------
    ClipError
        If its contents make no sense: no marker, no rate, a marker beyond `FARTHEST`,
        two markers of one name, an implausible unit, an unknown subject, or several subjects and
        none chosen.
    OptionError
        If an option is out of range.
    """
    if reading.rate is not None and not (np.isfinite(reading.rate) and reading.rate > 0):
        raise OptionError(f"rate {reading.rate:g} Hz is not positive; give the frames per second")
    positions = np.array(recording.positions, dtype=np.float64)
    if positions.shape[0] == 0 or positions.shape[1] == 0:
        raise ClipError(
            f"{name}: has {positions.shape[0]} frames of {positions.shape[1]} markers; "
            "there is nothing to fill"
        )
    positions[np.isnan(positions).any(axis=2)] = np.nan
    beyond = np.abs(positions) > FARTHEST
    if beyond.any():
        frame, point = np.argwhere(beyond.any(axis=2))[0]
        raise ClipError(
            f"{name}: {recording.labels[point]} is out of this world in frame "
            f"{recording.first_frame + int(frame)}; mark the sample as missing"
        )
    split = [split_label(label, ()) for label in recording.labels]
    names = [marker for _, marker in split]
    reasons = dict(recording.no_markers)
    modelled = find_model_points(names, recording.labels, positions, _NOTHING_DECLARED)
    for point, reason in modelled.items():
        reasons.setdefault(point, reason)
    owners = {point: owner for point, (owner, _) in enumerate(split) if point not in reasons}
    declared = [recording.subject] if recording.subject else []
    subject, others = choose_subject(owners, reading.subject, declared, name)
    reasons |= others
    points = [point for point in range(len(names)) if point not in reasons]
    if not points:
        raise ClipError(
            f"{name}: none of its {len(names)} points is a labelled marker; label the markers first"
        )
    labels = tuple(names[point] for point in points)
    _check_labels(points, labels, name)
    kept = positions[:, points]
    zero = (kept == 0).all(axis=2)
    if reading.zeros_missing:
        kept[zero] = np.nan
    _, mm_per_unit, unit_notes = find_unit(kept, recording.unit, reading.unit, name)
    kept *= mm_per_unit
    up, found_from, up_notes = find_up_axis(kept, labels, recording.up, reading.up)
    if found_from == "default":
        up = recording.usual_up
        up_notes = [f"Nothing tells which axis is up; {up} is assumed (see --up)."]
    rate = recording.rate if reading.rate is None else reading.rate
    if rate is None or not (np.isfinite(rate) and rate > 0):
        raise ClipError(f"{name}: has no frame rate; give the frames per second (--rate)")
    source = None
    if path is not None:
        interpolated = recording.interpolated
        if interpolated is not None:
            interpolated = interpolated[:, points] & ~np.isnan(kept[:, :, 0])
            interpolated.setflags(write=False)
        source = Source(
            path=path,
            sha256=hashlib.sha256(data).hexdigest(),
            points=tuple(points),
            point_labels=tuple(recording.labels[point] for point in points),
            unit=recording.unit,
            mm_per_unit=mm_per_unit,
            up_found_from=found_from,
            zero_samples=int(zero.sum()) if reading.zeros_missing else 0,
            left_out=_left_out(reasons, recording.labels),
            notes=(*recording.notes, *unit_notes, *up_notes),
            interpolated=interpolated,
            format=format,
        )
    return Clip(
        positions=kept,
        labels=labels,
        rate=rate,
        up=up,
        name=os.path.splitext(name)[0] if path is not None else name,  # noqa: PTH122 (no path)
        subject=subject,
        first_frame=recording.first_frame,
        source=source,
    )


def _check_labels(points: Sequence[int], labels: Sequence[str], name: str) -> None:
    """Raise ClipError if two markers have the same name."""
    first: dict[str, int] = {}
    for point, label in zip(points, labels, strict=True):
        if label in first:
            raise ClipError(
                f"{name}: markers {first[label] + 1} and {point + 1} are both named {label}; "
                "rename one of them"
            )
        first[label] = point


def _left_out(reasons: Mapping[int, str], labels: Sequence[str]) -> dict[str, str]:
    """Return the reasons by label; a label that is empty or taken gets the point's number."""
    left_out: dict[str, str] = {}
    for point in sorted(reasons):
        label = labels[point].strip()
        if not label or label in left_out:
            label = f"{label} (point {point + 1})".strip()
        left_out[label] = reasons[point]
    return left_out
