"""What a method is given and what it gives back."""

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

__all__ = ["Estimate", "Method", "Note", "Task", "take_names"]


@dataclass(frozen=True, eq=False)
class Task:
    """A clip to be filled and what may be learnt from.

    Attributes
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        The clip, upright, NaN where missing.
    labels : tuple of str
        Its markers.
    rate : float
        Hz.
    marker_set : MarkerSet
        Segments and reliable bits of all the clip's markers.
    groups : tuple of GapGroup
        The gap groups to be filled.
    takes : tuple of Take
        Recordings of the prior database; empty without one.
    name, subject : str
        Of the clip.
    known_geometry : ClipGeometry, optional
        Of the clip's upright positions; made on first use if not given.
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

    @cached_property
    def geometry(self) -> ClipGeometry:
        """Validity, distances, mirror pairs and floor of the clip."""
        return self.known_geometry or ClipGeometry(self.positions, self.labels, self.marker_set)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Which samples are measured [shape=(frames, markers)]."""
        return self.geometry.valid

    @property
    def contralateral(self) -> NDArray[np.intp]:
        """Each marker's counterpart on the other side; see `ClipGeometry.contralateral`."""
        return self.geometry.contralateral

    def beside(self, takes: Sequence[str], database: str) -> str:
        """Say what was learnt from beside the clip itself.

        Parameters
        ----------
        takes : sequence of str
            Names of the recordings.
        database : str
            What to call those of the database.
        """
        same_subject = {take.name for take in self.takes if take.same_subject}
        said = []
        if any(name in same_subject for name in takes):
            said.append("other clips of the same person")
        if any(name not in same_subject for name in takes):
            said.append(database)
        joints = (",", " and") if len(said) > 1 else (" and",)
        return "".join(f"{joint} {one}" for joint, one in zip(joints, said, strict=False))

    def root_among(self, markers: NDArray[np.intp]) -> RootGroup | None:
        """Choose a root group among some markers; None where they give none."""
        among = np.zeros(len(self.labels), dtype=bool)
        among[markers] = True
        return choose_root(self.marker_set, self.labels, self.positions, among)


@dataclass(frozen=True)
class Note:
    """What a method says of a run of frames of one marker.

    Attributes
    ----------
    marker, start, stop : int
        Which samples.
    source : str
        What they were filled from, or the reason why they were not.
    filled : bool
        Whether they were filled.
    source_clips : tuple of str
        Names of the recordings that were learnt from.
    training_poses : int
        How many poses, or stretches, were learnt from; 0 where none were, as by a bridge over
        time.
    """

    marker: int
    start: int
    stop: int
    source: str
    filled: bool = True
    source_clips: tuple[str, ...] = ()
    training_poses: int = 0


@dataclass(frozen=True, eq=False)
class Estimate:
    """What a method gives back.

    Attributes
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        Upright; NaN where it could not say. Only missing samples are looked at.
    deviation : ndarray [shape=(frames, markers), mm]
        Expected rms error (Euclidean) of each filled sample; NaN where unknown.
    notes : list of Note
        How each run of missing samples was filled, or why not.
    error_bound_90 : ndarray [shape=(frames, markers), mm] or None
        Distance below which 90 % of the errors are expected to lie; NaN where unknown. None:
        `BOUND_FACTOR` times the deviation.
    """

    positions: NDArray[np.float64]
    expected_rms: NDArray[np.float64]
    notes: list[Note] = field(default_factory=list)
    error_bound_90: NDArray[np.float64] | None = None

    @classmethod
    def of(cls, task: Task) -> Estimate:
        """Return an estimate that holds what is measured and nothing else."""
        return cls(task.positions.copy(), np.full(task.positions.shape[:2], np.nan))

    @classmethod
    def told(
        cls,
        task: Task,
        positions: NDArray[np.float64],
        how: str | Callable[[Gap], str],
        reason: str | Callable[[Gap], str],
        takes: tuple[str, ...] = (),
    ) -> Estimate:
        """Return an estimate by a method that fills whole markers and knows no deviation.

        Parameters
        ----------
        task : Task
            What was asked.
        positions : ndarray [shape=(frames, markers, 3), mm]
            NaN where the method could not say.
        how, reason : str or callable
            What gaps were filled from, and why others were not: of all, or of one.
        takes : tuple of str
            Names of the recordings that were learnt from.
        """
        missing = ~task.valid
        given = missing & np.isfinite(positions).all(axis=2)
        notes = [
            Note(gap.marker, gap.start, gap.stop, _of(how, gap), source_clips=takes)
            for gap in find_gaps(given)
        ]
        notes += [
            Note(gap.marker, gap.start, gap.stop, _of(reason, gap), filled=False)
            for gap in find_gaps(missing & ~given)
        ]
        filled = np.where(given[..., None], positions, task.positions)
        return cls(filled, np.full(missing.shape, np.nan), notes)


def _of(said: str | Callable[[Gap], str], gap: Gap) -> str:
    """Return what is said of a gap."""
    return said if isinstance(said, str) else said(gap)


class Method(Protocol):
    """A method: a function of a task."""

    def __call__(self, task: Task, progress: Callable[[], None]) -> Estimate:
        """Fill the gaps of a task; ``progress`` is to be called once a gap group.

        Gaps that it cannot fill stay missing, each with its reason. It raises a `MethodError` only
        where what it needs of the clip or the takes as a whole is not there: whole frames, a
        number of markers, a database.
        """
        ...


def take_names(takes: Sequence[Take], used: NDArray[np.intp], most: int = 10) -> tuple[str, ...]:
    """Names of the takes used most often, the most used first.

    Parameters
    ----------
    takes : sequence of Take
        The takes that ``used`` counts in.
    used : ndarray of int
        Index of the take behind each vote, any shape.
    most : int
        How many names at most.
    """
    counts = np.bincount(used.ravel(), minlength=len(takes))
    order = np.argsort(-counts, kind="stable")[:most]
    return tuple(takes[i].name for i in order if counts[i])
