"""The path from file contents to a clip, the same for every format.

Each format has a parser that turns bytes into a `Recording`: all points of the file, in file
units, with whatever the file declares about them. `make_clip` turns a recording into a clip: it
selects the markers of one subject, makes labels unique, blanks missing samples, converts to mm and
finds the up axis.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip, Source, blank_incomplete_samples
from priorfill.errors import ClipError, OptionError
from priorfill.formats.file_bytes import read_bounded
from priorfill.formats.point_kinds import find_model_points, split_label
from priorfill.formats.subjects import choose_subject
from priorfill.formats.units import find_unit
from priorfill.formats.up_axis import find_up_axis
from priorfill.runtime.argument_types import check_number, check_type
from priorfill.runtime.threads import by_frames, map_in_threads

__all__ = [
    "ReadOptions",
    "Recording",
    "check_coordinates",
    "clip_from_file",
    "make_clip",
    "notes_on_marks",
]

_MIN_MARKS = 3
"""Samples with three equal coordinates, the same in all of them, that are noted."""

MAX_COORDINATE = 1e12
"""Largest coordinate accepted, in any unit of length. No marker is that far away, and squares of
smaller numbers stay finite."""

MIN_RESIDUAL_SHARE = 0.1
"""Minimum share of present samples with a residual above 0 for residuals of 0 to mean
"interpolated". Many systems write 0 everywhere; those that write residuals write one for nearly
every measured sample, and nobody fills more than nine tenths of a recording."""


@dataclass(frozen=True)
class ReadOptions:
    """How to interpret a file.

    Attributes
    ----------
    zeros_missing : bool
        Treat samples at exactly (0, 0, 0) as missing.
    up : str or None
        The axis that points up, one of `priorfill.geometry.axes.UP_AXES`; found if None.
    rate : float or None
        Frame rate (Hz) that replaces the file's.
    unit : str or None
        Unit of length (mm, cm, m, ...) that replaces the file's.
    subject : str or None
        The subject whose markers are read; needed if the file holds several.
    ignore_residuals : bool
        Take samples as measured whose residual in the file marks them as missing.

    Raises
    ------
    OptionError
        If the rate is not positive.
    ArgumentTypeError
        If the rate is no number, or another value no text.
    """

    zeros_missing: bool = True
    up: str | None = None
    rate: float | None = None
    unit: str | None = None
    subject: str | None = None
    ignore_residuals: bool = False

    def __post_init__(self) -> None:
        for name in ("up", "unit", "subject"):
            check_type(name, getattr(self, name), (str, type(None)), "a text, or None")
        if self.rate is not None:
            check_number("rate", self.rate)
        if self.rate is not None and not (np.isfinite(self.rate) and self.rate > 0):
            raise OptionError(f"`rate` is {self.rate:g} Hz; give the frames per second, above 0")


@dataclass
class Recording:
    """Contents of a file, before markers are separated from other points.

    Not frozen: `make_clip` takes over the positions, because a large file fits into memory once.

    Attributes
    ----------
    positions : ndarray [shape=(frames, points, 3), file units]
        NaN where the file has no coordinates.
    labels : tuple of str
        Labels as spelled in the file, including the subject's prefix.
    rate : float or None
        Frame rate (Hz); None if the file states none, or none that is positive.
    unit : str
        Unit of length as spelled in the file; empty if absent.
    first_frame : int
        Number of the first frame.
    up : str
        The up axis declared by the file; empty if absent.
    up_sign_declared : bool
        Whether the program that wrote the file gives the sign of that axis a meaning.
    default_up : str
        The customary up axis of the format, used if nothing else determines it.
    prefixes : tuple of str
        Label prefixes declared by the file, separator included. A prefix before a colon needs no
        declaration.
    subjects : tuple of str
        Subjects declared by the file apart from label prefixes.
    model_outputs : mapping of str to str
        Labels declared as model outputs, with the reason.
    not_markers : mapping of int to str
        Points declared as something other than markers, with the reason.
    notes : tuple of str
        What a user should know about the file, one sentence each.
    interpolated : ndarray [shape=(frames, points), bool] or None
        Which samples the file declares as filled.
    residuals : ndarray [shape=(frames, points)] or None
        Residual of each sample. A negative one marks the sample as missing; 0 may mean
        "interpolated", if `interpolated` is None.
    """

    positions: NDArray[np.float64]
    labels: tuple[str, ...]
    rate: float | None
    unit: str
    first_frame: int = 1
    up: str = ""
    up_sign_declared: bool = True
    default_up: str = "+Z"
    prefixes: tuple[str, ...] = ()
    subjects: tuple[str, ...] = ()
    model_outputs: Mapping[str, str] = field(default_factory=dict)
    not_markers: Mapping[int, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    interpolated: NDArray[np.bool_] | None = None
    residuals: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class _Markers:
    """The points of a recording that become markers of the clip.

    Attributes
    ----------
    names : dict of int to str
        Unique label of each point used, in the file's order.
    left_out : dict of int to str
        The reason for each point not used.
    subject : str
        The subject; empty if unknown.
    notes : list of str
        Notes on labels that occur twice.
    """

    names: dict[int, str]
    left_out: dict[int, str]
    subject: str
    notes: list[str]


def clip_from_file(
    path: Path,
    options: ReadOptions,
    format: str,
    parse: Callable[[bytes, str], Recording],
    load: Callable[[Path], bytes] = read_bounded,
) -> Clip:
    """Read a clip from a file.

    Parameters
    ----------
    path : Path
        The file.
    options : ReadOptions
        How to interpret it.
    format : str
        The format's name in `priorfill.formats.FORMATS`.
    parse : callable
        Makes a recording from the file's contents and name.
    load : callable
        Returns the file's contents.

    Raises
    ------
    FormatError, ClipError, OptionError
        As `load`, `parse` and `make_clip` do.

    See Also
    --------
    priorfill.read
    """
    data = load(path)
    with map_in_threads(len(data)) as mapped:
        works = (lambda: parse(data, path.name), lambda: hashlib.sha256(data).hexdigest())
        recording, sha256 = mapped(lambda work: work(), works)
    return make_clip(recording, path.name, options, path=path, sha256=sha256, format=format)


def make_clip(
    recording: Recording,
    name: str,
    options: ReadOptions,
    *,
    path: Path | None = None,
    sha256: str = "",
    format: str = "",
) -> Clip:
    """Make a clip from a recording.

    Parameters
    ----------
    recording : Recording
        The contents of the file. Its positions are replaced by those of the clip to save memory,
        so it cannot be used again.
    name : str
        The file's name in messages.
    options : ReadOptions
        How to interpret the recording.
    path : Path or None
        The file; None for data from memory, which get no source.
    sha256 : str
        SHA-256 of the file's contents.
    format : str
        The format's name in `priorfill.formats.FORMATS`.

    Returns
    -------
    Clip
        The markers of one subject in mm.

    Raises
    ------
    ClipError
        If there are no points, no frames, no labelled marker or no rate; a marker is farther away
        than `MAX_COORDINATE`; the unit is implausible; the subject is unknown, or there are
        several and none is chosen (MultipleSubjectsError).
    OptionError
        If the unit or up axis of `options` is unknown.
    """
    for count, what in zip(recording.positions.shape, ("frames", "points"), strict=False):
        if count == 0:
            raise ClipError(f"{name}: has no {what}; there is nothing to fill")
    residual_notes = _blank_invalid_samples(recording, options)
    blank_incomplete_samples(recording.positions)
    markers, zero = _choose_markers(recording, options, name)
    points, labels = list(markers.names), tuple(markers.names.values())
    kept = _of_points(recording.positions, points)
    recording.positions = kept  # frees the memory of the other points
    check_coordinates(kept, labels, recording.first_frame, name)
    notes = (*recording.notes, *residual_notes, *notes_on_marks(kept), *markers.notes)
    _, mm_per_unit, unit_notes = find_unit(kept, recording.unit, options.unit, name)
    kept *= mm_per_unit
    kept.setflags(write=False)  # so that the clip need not copy it
    up, up_found_from, up_notes = find_up_axis(
        kept,
        labels,
        recording.up,
        options.up,
        recording.default_up,
        sign_declared=recording.up_sign_declared,
    )
    rate = recording.rate if options.rate is None else options.rate
    if rate is None or not (np.isfinite(rate) and rate > 0):
        raise ClipError(f"{name}: has no frame rate; give the frames per second (`rate`)")
    source = None
    if path is not None:
        source = Source(
            path=path,
            sha256=sha256,
            points=tuple(points),
            point_labels=tuple(recording.labels[point] for point in points),
            unit=recording.unit,
            mm_per_unit=mm_per_unit,
            up_found_from=up_found_from,
            zero_samples=int(zero[:, points].sum()),
            left_out=_by_label(markers.left_out, recording.labels),
            notes=(*notes, *unit_notes, *up_notes),
            interpolated=_interpolated_samples(recording, points, ~np.isnan(kept[:, :, 0])),
            format=format,
        )
    return Clip(
        positions=kept,
        labels=labels,
        rate=rate,
        up=up,
        name=name if path is None else path.stem,
        subject=markers.subject,
        first_frame=recording.first_frame,
        source=source,
    )


def _blank_invalid_samples(recording: Recording, options: ReadOptions) -> list[str]:
    """Blank samples with a negative residual in place; return what the user should know."""
    if recording.residuals is None:
        return []
    invalid = np.concatenate(by_frames(lambda some: some < 0, recording.residuals))
    if not invalid.any():
        return []
    if options.ignore_residuals:
        return [f"{int(invalid.sum())} samples with a negative residual are taken as measured."]
    notes = []
    if invalid.all() and (recording.positions[np.isfinite(recording.positions)] != 0).any():
        notes = [
            "All samples have a negative residual, which marks them as missing, although the file "
            "has coordinates; if they are measured, read it with `ignore_residuals`."
        ]
    recording.positions[invalid] = np.nan
    return notes


def notes_on_marks(positions: NDArray[np.float64]) -> list[str]:
    """Return a note on a number that some programs write for missing samples, such as -9999.

    Three equal coordinates, several times the same, are no measurement.
    """

    def three_equal(some: NDArray[np.float64]) -> NDArray[np.float64]:
        same = (some[..., 0] == some[..., 1]) & (some[..., 1] == some[..., 2])
        found: NDArray[np.float64] = some[same][:, 0]
        return found

    marks = np.concatenate(by_frames(three_equal, positions))
    values, counts = np.unique(marks, return_counts=True)
    return [
        f"{count} samples are at ({value:g}, {value:g}, {value:g}); they are taken as "
        "measured. If they are missing, blank them."
        for value, count in zip(values.tolist(), counts.tolist(), strict=True)
        if count >= _MIN_MARKS and value != 0
    ]


def _choose_markers(
    recording: Recording, options: ReadOptions, name: str
) -> tuple[_Markers, NDArray[np.bool_]]:
    """Choose the markers of one subject, and blank samples at the origin in place.

    Returns
    -------
    markers : _Markers
        The points used, and why the others are not.
    zero : ndarray [shape=(frames, points), bool]
        The samples treated as missing because they are (0, 0, 0).

    Raises
    ------
    ClipError
        If no point is a labelled marker, the subject is unknown, or several are there and none is
        chosen.
    """
    positions, labels = recording.positions, recording.labels
    split = [split_label(label, recording.prefixes) for label in labels]
    names = [marker for _, marker in split]
    left_out = find_model_points(names, labels, positions, recording.model_outputs)
    left_out |= recording.not_markers
    owners = {point: owner for point, (owner, _) in enumerate(split) if point not in left_out}
    subject, others = choose_subject(owners, options.subject, recording.subjects, name)
    left_out |= others
    points = [point for point in range(len(labels)) if point not in left_out]
    if not points:
        raise ClipError(
            f"{name}: none of its {len(labels)} points is a labelled marker; "
            "label the markers first"
        )
    if options.zeros_missing:
        zero = np.concatenate(by_frames(_blank_zeros, positions))
    else:
        zero = np.zeros(positions.shape[:2], dtype=bool)
    seen = np.any(by_frames(lambda some: ~np.isnan(some[..., 0]).all(axis=0), positions), axis=0)
    unique, twins, notes = _unique_names(points, names, seen)
    return _Markers(unique, left_out | twins, subject, notes), zero


def _blank_zeros(positions: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Blank samples at the origin in place; return which they are [shape=(frames, points)]."""
    x, y, z = np.moveaxis(positions == 0, 2, 0)  # faster than `all` over three
    zero: NDArray[np.bool_] = x & y & z
    positions[zero] = np.nan
    return zero


def _unique_names(
    points: Sequence[int], names: Sequence[str], seen: NDArray[np.bool_]
) -> tuple[dict[int, str], dict[int, str], list[str]]:
    """Give markers that share a label different names.

    The file does not show which of them is right. So no marker with samples is dropped, none is
    merged with another, and the first keeps the name.

    Returns
    -------
    unique : dict of int to str
        Name of each point.
    twins : dict of int to str
        Why points are left out: they have no samples, and another point of their label has some.
    notes : list of str
        What the user should know.
    """
    by_name: dict[str, list[int]] = {}
    for point in points:
        by_name.setdefault(names[point], []).append(point)
    unique = {point: names[point] for point in points}
    twins: dict[int, str] = {}
    notes = []
    for name, same in by_name.items():
        used = [point for point in same if seen[point]] or same[:1]
        for point in same:
            if point not in used:
                del unique[point]
                twins[point] = f"never seen, and point {used[0] + 1} is labelled {name} too"
        for point in used[1:]:
            other = f"{name}#{point + 1}"
            while other in by_name:
                other += "#"
            unique[point] = other
            notes.append(
                f"Points {used[0] + 1} and {point + 1} are both labelled {name}; "
                f"the second is called {other} here. Rename one of them if it is another marker."
            )
    return unique, twins, notes


def _of_points(values: NDArray[np.float64], points: list[int]) -> NDArray[np.float64]:
    """Return the values of some points, as an array that owns its memory.

    Most files hold markers only; their arrays are used without a copy.
    """
    if points == list(range(values.shape[1])) and values.flags.owndata:
        return values
    return np.take(values, points, axis=1)


def _beyond(positions: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which samples are beyond `MAX_COORDINATE` [shape=(frames, markers)]."""
    far = positions > MAX_COORDINATE
    far |= positions < -MAX_COORDINATE
    x, y, z = np.moveaxis(far, 2, 0)  # faster than `any` over three
    beyond: NDArray[np.bool_] = x | y | z
    return beyond


def check_coordinates(
    positions: NDArray[np.float64], labels: tuple[str, ...], first_frame: int, name: str
) -> None:
    """Raise ClipError at the first coordinate beyond `MAX_COORDINATE`."""
    if any(by_frames(lambda some: _beyond(some).any(), positions)):
        frame, marker = np.argwhere(_beyond(positions))[0]
        largest = float(np.abs(positions[frame, marker]).max())
        size = (
            f"a coordinate of {largest:.3g}" if np.isfinite(largest) else "an infinite coordinate"
        )
        raise ClipError(
            f"{name}: marker {labels[marker]} has {size} in frame "
            f"{first_frame + int(frame)}; mark the sample as missing"
        )


def _interpolated_samples(
    recording: Recording, points: list[int], present: NDArray[np.bool_]
) -> NDArray[np.bool_] | None:
    """Return which samples the file marks as interpolated [shape=(frames, markers)].

    C3D marks them by residual 0 and no cameras. Both are in the fourth word of a sample, which is
    compared as stored: decoded, a residual below one step, or one written as a plain fraction,
    would be 0, too. None if the file does not distinguish interpolated from measured samples.
    """
    if recording.interpolated is not None:
        found: NDArray[np.bool_] = recording.interpolated[:, points] & present
    elif recording.residuals is not None:
        words = _of_points(recording.residuals, points)
        count = int(present.sum())
        if count == 0 or int((present & (words > 0)).sum()) / count < MIN_RESIDUAL_SHARE:
            return None
        found = present & (words == 0)
    else:
        return None
    found.setflags(write=False)
    return found


def _by_label(reasons: Mapping[int, str], labels: Sequence[str]) -> dict[str, str]:
    """Return the reasons by label; an empty or repeated label gets the point's number."""
    by_label: dict[str, str] = {}
    for point in sorted(reasons):
        label = labels[point].strip()
        if not label or label in by_label:
            label = f"{label} (point {point + 1})".strip()
        by_label[label] = reasons[point]
    return by_label
