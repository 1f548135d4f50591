"""A recording: marker positions over time, and the file that they come from."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from numbers import Integral, Real
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from priorfill.errors import ArgumentTypeError, ClipError, MarkerNotFoundError, escaped
from priorfill.geometry.axes import UP_AXES
from priorfill.runtime.argument_types import check_labels, check_type
from priorfill.runtime.markup import html_table
from priorfill.runtime.option_texts import close_or_all
from priorfill.runtime.threads import by_frames

__all__ = ["MAX_RATE", "MIN_RATE", "Clip", "Source", "blank_incomplete_samples", "without_mask"]

MIN_RATE = 0.01
MAX_RATE = 1e6
"""Hz. No motion of a body is recorded more slowly or faster; such a rate is a slip, and durations
would overflow."""

MAX_FIRST_FRAME = 10**12
"""Largest number of a first frame: frame numbers are added and multiplied as 64-bit integers."""

MAX_NAME = 80
"""Characters of a name where a clip is described in a line."""


@dataclass(frozen=True)
class Source:
    """The file that a clip was read from, and the points of it that the clip holds.

    A filled clip is written by patching a copy of this file, so the source records the point of
    each marker.

    Attributes
    ----------
    path : Path
        The file.
    sha256 : str
        SHA-256 of the file when it was read. Writers refuse a file that has changed since.
    points : tuple of int
        Index of each marker among the points of the file.
    point_labels : tuple of str
        Labels of the markers as spelled in the file, including prefixes.
    unit : str
        Unit of length as spelled in the file.
    mm_per_unit : float
        Millimetres per unit of the file.
    up_found_from : str
        Origin of the up axis: ``"file"``, ``"data"``, ``"option"`` or ``"default"``.
    zero_samples : int
        Number of samples treated as missing because they are exactly (0, 0, 0).
    left_out : dict of str to str
        Labels of the points that the clip does not hold, with the reason.
    notes : tuple of str
        What a user should know about the interpretation of the file, one sentence each.
    interpolated : ndarray of bool [shape=(frames, markers)] or None
        Which samples the file marks as interpolated instead of measured; missing samples are not
        among them. None if the file does not distinguish them.
    format : str
        Name of the file's format in `priorfill.formats.FORMATS`.
    taken_from : ndarray of int [shape=(frames, markers)] or None
        The point of the file that each sample is from, where a user has exchanged samples of
        markers. None: each marker has the samples of its own point.
    """

    path: Path
    sha256: str
    points: tuple[int, ...]
    point_labels: tuple[str, ...]
    unit: str = "mm"
    mm_per_unit: float = 1.0
    up_found_from: str = "default"
    zero_samples: int = 0
    left_out: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    interpolated: NDArray[np.bool_] | None = field(default=None, repr=False, compare=False)
    format: str = "c3d"
    taken_from: NDArray[np.intp] | None = field(default=None, repr=False, compare=False)

    def point_of_sample(self, frames: int) -> NDArray[np.intp]:
        """Return the point that each sample is from [shape=(frames, markers)].

        Parameters
        ----------
        frames : int
            Number of frames of the clip.
        """
        if self.taken_from is not None:
            return self.taken_from
        points = np.asarray(self.points, dtype=np.intp)
        return np.broadcast_to(points, (frames, len(points)))

    def exchanged(self) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
        """Return which samples of the file are exchanged.

        Returns
        -------
        frames, points, taken_from : ndarray of int [shape=(samples,)]
            A sample's frame, the point that has it, and the point that it is from, in order of
            frames.
        """
        if self.taken_from is None:
            none = np.zeros(0, dtype=np.intp)
            return none, none, none
        points = np.asarray(self.points, dtype=np.intp)
        frames, markers = np.nonzero(self.taken_from != points)
        return frames.astype(np.intp), points[markers], self.taken_from[frames, markers]


@dataclass(frozen=True, eq=False)
class Clip:
    """A recording of the markers of one subject.

    ``clip["LTOE"]`` is the path of a marker [shape=(frames, 3), mm], a view that cannot be written
    to; a clip contains and iterates over its labels.

    Attributes
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        Float64, in the axes of the file; NaN if the marker is missing (all three coordinates). An
        array given to the constructor is copied unless it is read-only and owns its memory; what a
        masked array masks is missing.
    labels : tuple of str
        The markers' names without subject prefix, unique.
    rate : float
        Frame rate (Hz).
    up : str
        The axis that points up, one of `priorfill.geometry.axes.UP_AXES`.
    name : str
        Name of the clip in reports: the file's name without suffix.
    subject : str
        The subject recorded; empty if unknown.
    first_frame : int
        Number of the first frame in the file, for reports.
    source : Source or None
        The file that the clip was read from; None for a clip made in memory.

    Raises
    ------
    ClipError
        If shapes do not match, labels repeat or are empty, the rate is not positive, there are no
        frames or no markers, or a coordinate is infinite.
    ArgumentTypeError
        If an argument is of another type, such as positions that are no numbers.

    Examples
    --------
    >>> import numpy as np
    >>> clip = Clip(np.zeros((240, 2, 3)), ("LTOE", "RTOE"), 120.0)
    >>> clip.frames, clip.duration
    (240, 2.0)
    >>> clip["LTOE"].shape, "RTOE" in clip, list(clip)
    ((240, 3), True, ['LTOE', 'RTOE'])

    See Also
    --------
    priorfill.read : Read a clip from a file.
    priorfill.write : Write a clip to a file.
    priorfill.interop : Clips from and to other Python packages.
    """

    positions: NDArray[np.float64]
    labels: tuple[str, ...]
    rate: float
    up: str = "+Z"
    name: str = "clip"
    subject: str = ""
    first_frame: int = 0
    source: Source | None = None

    def __post_init__(self) -> None:
        check_type("name", self.name, str, "a text")
        check_type("subject", self.subject, str, "a text, empty if it is unknown")
        check_type("source", self.source, (Source, type(None)), "that of a clip, or None")
        labels = check_labels(self.labels)
        positions = _own_positions(self.positions)
        if positions.ndim != 3 or positions.shape[2] != 3:
            raise ClipError(
                f"{self.name}: positions have shape {positions.shape}; "
                "(frames, markers, 3) is needed"
            )
        if positions.shape[1] != len(labels):
            raise ClipError(
                f"{self.name}: {positions.shape[1]} markers but {len(labels)} labels; "
                "give one label per marker"
            )
        if positions.shape[0] == 0:
            raise ClipError(f"{self.name}: has no frames; there is nothing to fill")
        if positions.shape[1] == 0:
            raise ClipError(f"{self.name}: has no markers; there is nothing to fill")
        unnamed = next((k for k, label in enumerate(labels, start=1) if not label.strip()), None)
        if unnamed is not None:
            raise ClipError(
                f"{self.name}: marker {unnamed} of {len(labels)} has an empty label; name it, or "
                "leave it out"
            )
        twice = sorted(label for label, count in Counter(labels).items() if count > 1)
        if twice:
            raise ClipError(
                f"{self.name}: label {twice[0]} occurs {labels.count(twice[0])} times; "
                "rename the markers so that each label is unique"
            )
        _check_numbers(self.rate, self.first_frame, self.name)
        if self.up not in UP_AXES:
            raise ClipError(
                f"{self.name}: up axis {self.up!r} is unknown; use one of {' '.join(UP_AXES)}"
            )
        if any(by_frames(lambda some: np.isinf(some).any(), positions)):
            frame, marker = np.argwhere(np.isinf(positions).any(axis=2))[0]
            raise ClipError(
                f"{self.name}: marker {labels[marker]} has an infinite coordinate in frame "
                f"{self.first_frame + int(frame)}; mark the sample as missing"
            )
        if positions.flags.writeable:
            blank_incomplete_samples(positions)
            positions.setflags(write=False)
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "labels", labels)
        object.__setattr__(self, "rate", float(self.rate))

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.positions)

    @property
    def duration(self) -> float:
        """Length in seconds."""
        return self.frames / self.rate

    @property
    def missing(self) -> NDArray[np.bool_]:
        """Which samples are missing [shape=(frames, markers), bool]."""
        return np.isnan(self.positions[:, :, 0])

    def index(self, label: str) -> int:
        """Return the index of a marker.

        Parameters
        ----------
        label : str
            Its label.

        Raises
        ------
        MarkerNotFoundError
            A `KeyError` with similar labels, if the clip has no such marker.
        """
        try:
            return self.labels.index(label)
        except ValueError:
            if not isinstance(label, str):
                raise MarkerNotFoundError(
                    f"{self.name}: markers are chosen by their labels, not by {label!r}; "
                    "`positions` has them by number"
                ) from None
            of_subjects = [one for one in self.labels if one.endswith(f":{label}")]
            remedy = (
                f"did you mean {' or '.join(of_subjects)}?"
                if of_subjects
                else close_or_all(label, self.labels)
            )
            raise MarkerNotFoundError(f"{self.name}: has no marker {label}; {remedy}") from None

    def __getitem__(self, label: str) -> NDArray[np.float64]:
        return self.positions[:, self.index(label)]

    def __contains__(self, label: object) -> bool:
        return label in self.labels

    def __iter__(self) -> Iterator[str]:
        return iter(self.labels)

    def __repr__(self) -> str:
        facts = ", ".join(f"{name} {value}" for name, value in self._facts())
        return escaped(f"<Clip {_short(self.name)}: {facts}>")

    def _facts(self) -> list[tuple[str, str]]:
        """Return what the clip holds, as names and values."""
        last = self.first_frame + self.frames - 1
        return [
            *([("subject", _short(self.subject))] if self.subject else []),
            ("markers", str(len(self.labels))),
            ("frames", f"{self.first_frame}\u2013{last}"),
            ("duration", f"{self.duration:.2f} s at {self.rate:g} Hz"),
            ("missing", f"{100 * self.missing.mean():.1f} %"),
        ]

    def _repr_html_(self) -> str:
        """Return the clip as a notebook shows it: its facts, and markers with gaps."""
        share = 100 * self.missing.mean(axis=0)
        worst = sorted(np.flatnonzero(share), key=lambda marker: -share[marker])
        return html_table(f"Clip {self.name}", ("", ""), self._facts()) + html_table(
            "Missing by marker",
            ("marker", "missing>"),
            [(self.labels[marker], f"{share[marker]:.1f} %") for marker in worst],
        )

    def with_positions(self, positions: NDArray[np.float64]) -> Clip:
        """Return the clip with other positions [shape=(frames, markers, 3), mm]."""
        return replace(self, positions=positions)


def _short(name: str) -> str:
    """Return a name of a file or subject for a line of text."""
    return name if len(name) <= MAX_NAME else f"{name[:MAX_NAME]}\u2026"


def blank_incomplete_samples(positions: NDArray[np.float64]) -> None:
    """Set samples with a missing coordinate to NaN, in place [shape=(frames, markers, 3)]."""

    def blank(some: NDArray[np.float64]) -> None:
        some[_incomplete(some)] = np.nan

    by_frames(blank, positions)


def _check_numbers(rate: Any, first_frame: Any, name: str) -> None:
    """Raise ClipError for a frame rate that is out of range, or numbers that are none."""
    number = float(rate) if isinstance(rate, Real) else float("nan")
    if not MIN_RATE <= number <= MAX_RATE:
        shown = f"{number:g}" if isinstance(rate, Real) else repr(rate)
        raise ClipError(f"{name}: the frame rate is {shown} Hz; give the right one (`rate`)")
    if not isinstance(first_frame, Integral) or abs(int(first_frame)) > MAX_FIRST_FRAME:
        raise ClipError(
            f"{name}: the first frame is {first_frame!r}; give a whole number (`first_frame`)"
        )


def without_mask(values: ArrayLike) -> NDArray[np.float64]:
    """Return values as float64, with NaN for what a masked array masks.

    Parameters
    ----------
    values : array_like
        The values; copied if they are masked or of another type.

    Raises
    ------
    ArgumentTypeError
        If they are not real numbers, or rows differ in length.
    """
    try:
        kind = np.asanyarray(values).dtype.kind
        if kind in "cmMV":  # NumPy would make floats of them, and only warn
            raise TypeError(f"they are of type {np.asanyarray(values).dtype}")
        return _as_float(values)
    except (TypeError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise ArgumentTypeError(
            f"`positions` are no real numbers ({reason}); give an array of numbers"
        ) from error


def _as_float(values: ArrayLike) -> NDArray[np.float64]:
    """Return values as float64, with NaN for what a masked array masks."""
    if isinstance(values, np.ma.MaskedArray):
        masked: Any = values.astype(np.float64)
        return np.asarray(masked.filled(np.nan))
    return np.asarray(values, dtype=np.float64)


def _incomplete(positions: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which samples have one or two missing coordinates [shape=(frames, markers)]."""
    # spelt out, because NumPy takes ten times as long to reduce an axis of length three
    x, y, z = np.moveaxis(np.isnan(positions), 2, 0)
    incomplete: NDArray[np.bool_] = (x != y) | (x != z)
    return incomplete


def _own_positions(given: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the array given if it is immutable and in order, else a copy."""
    if (
        type(given) is np.ndarray
        and given.dtype == np.float64
        and given.flags.owndata
        and not given.flags.writeable
        and given.flags.c_contiguous
        and given.ndim == 3
        and given.shape[2] == 3
        and not any(by_frames(lambda some: _incomplete(some).any(), given))
    ):
        return given
    # in one layout: sums over another one differ in the last bits
    return np.array(without_mask(given), order="C")
