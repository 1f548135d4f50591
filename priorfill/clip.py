"""One recording: marker positions over time, and where they came from."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import ClipError
from priorfill.geometry.axes import UP_AXES

__all__ = ["Clip", "Source", "blank_incomplete_samples"]


@dataclass(frozen=True)
class Source:
    """The file that a clip was read from, and which of its points the clip holds.

    A filled clip is written by patching a copy of this file, so it says where each
    marker's samples are.

    Attributes
    ----------
    path : Path
        The file.
    sha256 : str
        Hash of the file's bytes when it was read; a writer refuses a file changed since.
    points : tuple of int
        For each marker of the clip, its index among the points of the file.
    point_labels : tuple of str
        The markers' labels as the file spells them, with their prefix.
    unit : str
        The file's unit of length as it spells it.
    mm_per_unit : float
        What a coordinate of the file is multiplied with to give mm.
    up_found_from : str
        How the up axis was found: ``"file"``, ``"data"``, ``"option"`` or ``"default"``.
    zero_samples : int
        Samples taken as missing because they are exactly (0, 0, 0) with a valid residual.
    left_out : dict of str to str
        Points of the file that are not markers, with the reason.
    notes : tuple of str
        What a user should know about how the file was understood, a sentence each.
    interpolated : ndarray of bool [shape=(frames, markers)] or None
        Which samples the file says are interpolated, not measured; missing ones are not among
        them. None where the file does not tell.
    format : str
        The name of the file's format in `priorfill.formats.FORMATS`.
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


@dataclass(frozen=True, eq=False)
class Clip:
    """One recording.

    Attributes
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        Float64, in the file's own axes; NaN where the marker is missing (all three
        coordinates or none). Of what is given a copy is made, unless nobody can change it.
    labels : tuple of str
        The markers' names without subject prefix, unique.
    rate : float
        Frames per second (Hz).
    up : str
        Which of the axes points up, one of `UP_AXES`.
    name : str
        What the clip is called in reports: the file's stem.
    subject : str
        Whose motion it is; empty if unknown.
    first_frame : int
        Number of the first frame in the file's own counting, for reports.
    source : Source or None
        The file it came from; None for a clip made in memory.

    Raises
    ------
    ClipError
        Where shapes do not fit, labels are duplicate, the rate is not positive, there is no
        frame or no marker, or a coordinate is infinite.
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
        positions = _kept(self.positions)
        if positions.ndim != 3 or positions.shape[2] != 3:
            raise ClipError(
                f"{self.name}: positions have shape {positions.shape}; "
                "(frames, markers, 3) is needed"
            )
        labels = tuple(self.labels)
        if positions.shape[1] != len(labels):
            raise ClipError(
                f"{self.name}: {positions.shape[1]} markers but {len(labels)} labels; "
                "give one label a marker"
            )
        if positions.shape[0] == 0:
            raise ClipError(f"{self.name}: has no frames; there is nothing to fill")
        if positions.shape[1] == 0:
            raise ClipError(f"{self.name}: has no markers; there is nothing to fill")
        twice = sorted({label for label in labels if labels.count(label) > 1})
        if twice:
            raise ClipError(
                f"{self.name}: label {twice[0]} occurs {labels.count(twice[0])} times; "
                "rename the markers so that each label is unique"
            )
        if not (np.isfinite(self.rate) and self.rate > 0):
            raise ClipError(
                f"{self.name}: the frame rate is {self.rate:g} Hz; give the right one (--rate)"
            )
        if self.up not in UP_AXES:
            raise ClipError(
                f"{self.name}: up axis {self.up!r} is unknown; use one of {' '.join(UP_AXES)}"
            )
        infinite = np.isinf(positions)
        if infinite.any():
            frame, marker = np.argwhere(infinite.any(axis=2))[0]
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
        """Which samples are missing [shape=(frames, markers)]."""
        return np.isnan(self.positions[:, :, 0])

    def with_positions(self, positions: NDArray[np.float64]) -> Clip:
        """Return the same clip with other positions [shape=(frames, markers, 3), mm]."""
        return replace(self, positions=positions)


def blank_incomplete_samples(positions: NDArray[np.float64]) -> None:
    """Make samples missing, in place, of which one coordinate is [shape=(frames, markers, 3)]."""
    unknown = np.isnan(positions)
    some = unknown.any(axis=2)
    some &= ~unknown.all(axis=2)
    positions[some] = np.nan


def _kept(given: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return positions that a clip can keep: those given, where they cannot change, or a copy."""
    if (
        isinstance(given, np.ndarray)
        and given.dtype == np.float64
        and given.flags.owndata
        and not given.flags.writeable
        and given.ndim == 3
    ):
        unknown = np.isnan(given)
        if (unknown.any(axis=2) == unknown.all(axis=2)).all():
            return given
    return np.array(given, dtype=np.float64)
