"""The input and the output of a method."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from priorfill.gaps import Gap, GapGroup, find_gaps
from priorfill.geometry.root_frames import RootGroup
from priorfill.markers.clip_geometry import ClipGeometry
from priorfill.markers.marker_set import MarkerSet
from priorfill.markers.root_choice import choose_root
from priorfill.search.takes import Take

__all__ = [
    "MIRROR_IMAGE",
    "THIS_CLIP",
    "Estimate",
    "Method",
    "Note",
    "Progress",
    "Task",
    "no_progress",
    "take_names",
]

Progress = Callable[[float], None]
"""Is called by a method with the number of missing samples done since the last call; a fraction
where a part of the work on a sample is done."""

THIS_CLIP = -1
"""Number of the clip that is filled, among the numbers of takes, and of its subject, among those of
subjects. Takes and subjects of the database have numbers from 0."""

MIRROR_IMAGE = -2
"""The same for the clip's mirror image, whose proportions are those of a different subject."""


@dataclass(frozen=True, eq=False)
class Task:
    """A clip to be filled, and the recordings to learn from.

    Attributes
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        The clip, upright, NaN where missing.
    labels : tuple of str
        Its markers.
    rate : float
        Hz.
    marker_set : MarkerSet
        Body segments and reliable markers, of all markers of the clip.
    groups : tuple of GapGroup
        The gap groups to be filled.
    takes : tuple of Take
        Recordings of the prior database and other recordings of the same subject.
    name, subject : str
        Of the clip.
    known_geometry : ClipGeometry, optional
        Of the clip's upright positions; computed on first use by default.
    learn_from_clip : bool
        Whether methods may learn from the clip's own frames how the markers with gaps move; if
        not, from the takes alone.
    checkpoint : callable
        Called often, also from threads; what it raises stops the method.
    completed : ndarray [shape=(frames, markers, 3), mm], optional
        The clip with its gaps filled by an earlier call of the method, NaN where that fill is not
        believed: a method may use it to complete the poses that it learns from.
    """

    positions: NDArray[np.float64]
    labels: tuple[str, ...]
    rate: float
    marker_set: MarkerSet
    groups: tuple[GapGroup, ...]
    takes: tuple[Take, ...] = ()
    name: str = "clip"
    subject: str = ""
    known_geometry: ClipGeometry | None = None
    learn_from_clip: bool = True
    checkpoint: Callable[[], None] = lambda: None
    completed: NDArray[np.float64] | None = None

    @cached_property
    def geometry(self) -> ClipGeometry:
        """Validity, distances, mirror pairs and floor of the clip."""
        return self.known_geometry or ClipGeometry(self.positions, self.labels, self.marker_set)

    @property
    def samples(self) -> int:
        """Number of missing samples of the gap groups."""
        return sum(group.samples for group in self.groups)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Which samples are measured [shape=(frames, markers)]."""
        return self.geometry.valid

    @property
    def contralateral(self) -> NDArray[np.intp]:
        """Each marker's counterpart on the other side; see `ClipGeometry.contralateral`."""
        return self.geometry.contralateral

    @cached_property
    def speed(self) -> float:
        """Rms speed of all markers, from each sample to the next (mm/s); 0 where unknown."""
        square, count = 0.0, 0
        for marker in range(self.positions.shape[1]):
            known = np.flatnonzero(self.valid[:, marker])
            step = np.diff(self.positions[known, marker], axis=0)
            square += float(((step * (self.rate / np.diff(known)[:, None])) ** 2).sum())
            count += len(step)
        return float(np.sqrt(square / count)) if count else 0.0

    def and_sources(self, takes: Sequence[str], database: str) -> str:
        """Return text that continues a list of sources with some recordings.

        Parameters
        ----------
        takes : sequence of str
            Names of the recordings.
        database : str
            What to call those of the database.

        Returns
        -------
        str
            For example ``" and the database"``; empty without recordings.
        """
        same_subject = {take.name for take in self.takes if take.same_subject}
        sources = []
        if any(name in same_subject for name in takes):
            sources.append("other clips of the same subject")
        if any(name not in same_subject for name in takes):
            sources.append(database)
        joints = (",", " and") if len(sources) > 1 else (" and",)
        return "".join(f"{joint} {source}" for joint, source in zip(joints, sources, strict=False))

    def root_among(self, markers: NDArray[np.intp]) -> RootGroup | None:
        """Choose a root group among some markers; None if they contain none."""
        among = np.zeros(len(self.labels), dtype=bool)
        among[markers] = True
        return choose_root(self.marker_set, self.labels, self.positions, among)


@dataclass(frozen=True)
class Note:
    """How a run of frames of one marker was filled, or why it was not.

    Attributes
    ----------
    marker, start, stop : int
        The marker, and its frames ``start <= frame < stop``.
    source : str
        What the samples were filled from, or the reason why they were not filled.
    filled : bool
        Whether they were filled.
    source_clips : tuple of str
        Names of the recordings in the training data.
    training_poses : int
        Number of training poses or windows; 0 without training, as for interpolation over time.
    relative_error : float
        Ratio of the expected error to the one expected without the database; NaN where unknown.
    """

    marker: int
    start: int
    stop: int
    source: str
    filled: bool = True
    source_clips: tuple[str, ...] = ()
    training_poses: int = 0
    relative_error: float = float("nan")


@dataclass(frozen=True, eq=False)
class Estimate:
    """A method's positions and their expected errors.

    Attributes
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        Upright; NaN where it has no estimate. Only missing samples are used.
    expected_rms : ndarray [shape=(frames, markers), mm]
        Expected rms Euclidean error of each filled sample; NaN where unknown.
    notes : list of Note
        How each run of missing samples was filled, or why not.
    error_bound_90 : ndarray [shape=(frames, markers), mm] or None
        Distance below which 90 % of the errors are expected to lie; NaN where unknown. None:
        `priorfill.gp.calibration.BOUND_FACTOR` times `expected_rms`.
    """

    positions: NDArray[np.float64]
    expected_rms: NDArray[np.float64]
    notes: list[Note] = field(default_factory=list)
    error_bound_90: NDArray[np.float64] | None = None

    @classmethod
    def of(cls, task: Task) -> Estimate:
        """Return an estimate with the measured samples only."""
        return cls(task.positions.copy(), np.full(task.positions.shape[:2], np.nan))

    @classmethod
    def without_errors(
        cls,
        task: Task,
        positions: NDArray[np.float64],
        source: str | Callable[[Gap], str],
        reason: str | Callable[[Gap], str],
        takes: tuple[str, ...] = (),
    ) -> Estimate:
        """Return the estimate of a method that does not predict its errors.

        Parameters
        ----------
        task : Task
            The task.
        positions : ndarray [shape=(frames, markers, 3), mm]
            NaN where the method has no estimate.
        source, reason : str or callable
            What gaps were filled from, and why others were not filled: a text, or a function of
            the gap.
        takes : tuple of str
            Names of the recordings in the training data.
        """
        missing = ~task.valid
        given = missing.copy()
        given[missing] = np.isfinite(positions[missing]).all(axis=1)
        notes = [
            Note(gap.marker, gap.start, gap.stop, _text(source, gap), source_clips=takes)
            for gap in find_gaps(given)
        ]
        notes += [
            Note(gap.marker, gap.start, gap.stop, _text(reason, gap), filled=False)
            for gap in find_gaps(missing & ~given)
        ]
        filled = task.positions.copy()
        filled[given] = positions[given]
        return cls(filled, np.full(missing.shape, np.nan), notes)

    def drop(self, samples: NDArray[np.bool_], reason: str) -> None:
        """Leave samples missing, with a note for each run of them.

        Parameters
        ----------
        samples : ndarray of bool [shape=(frames, markers)]
            The samples.
        reason : str
            Why they stay missing.
        """
        if not samples.any():
            return
        self.positions[samples] = np.nan
        self.notes.extend(
            Note(gap.marker, gap.start, gap.stop, reason, filled=False)
            for gap in find_gaps(samples)
        )


def _text(text: str | Callable[[Gap], str], gap: Gap) -> str:
    """Return a text, or the text for a gap."""
    return text if isinstance(text, str) else text(gap)


class Method(Protocol):
    """A method: a function of a task."""

    def __call__(self, task: Task, progress: Progress) -> Estimate:
        """Fill the gaps of a task, calling ``progress`` with the samples done since the last call.

        Gaps that it cannot fill stay missing, each with a note of the reason.

        Raises
        ------
        MethodError
            Where the clip or the takes lack what the method needs throughout: complete frames, a
            number of markers, a database.
        """
        ...


def no_progress(samples: float) -> None:
    """Report no progress."""


def take_names(
    takes: Sequence[Take], used: NDArray[np.intp], max_names: int = 10
) -> tuple[str, ...]:
    """Return the names of the takes used most often, the most used first.

    Parameters
    ----------
    takes : sequence of Take
        All takes.
    used : ndarray of int [any shape]
        Index of the take of each training pose or vote.
    max_names : int
        Maximum number of names.
    """
    counts = np.bincount(used.ravel(), minlength=len(takes))
    order = np.argsort(-counts, kind="stable")[:max_names]
    return tuple(takes[i].name for i in order if counts[i])
