"""Subjects of a task: a few poses of each recording, and which recordings are of the clip's own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.distances import median_distances, pooled_distances
from priorfill.geometry.mirror import mirrored
from priorfill.geometry.poses import complete_poses, evenly_spaced
from priorfill.methods.gpr.dropout.options import DropoutOptions
from priorfill.methods.task import THIS_CLIP, Task

__all__ = ["THIS_CLIP", "SubjectSample", "Subjects"]

_Float = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SubjectSample:
    """A few poses of a take, or of the clip itself.

    Attributes
    ----------
    take : int
        Number of the take in the task; `THIS_CLIP` for the clip.
    subject : int
        Number of the subject; `THIS_CLIP` for the clip's own.
    poses : ndarray [shape=(poses, all markers, 3), mm]
        Upright; NaN where missing.
    """

    take: int
    subject: int
    poses: NDArray[np.float64]

    @property
    def from_clip(self) -> bool:
        """Whether the poses are the clip's."""
        return self.take == THIS_CLIP


class Subjects:
    """The subjects of a task's clip and takes.

    Parameters
    ----------
    task : Task
        The clip and the takes.
    options : DropoutOptions
        Numbers of takes and poses, and limits for the same subject.
    """

    def __init__(self, task: Task, options: DropoutOptions) -> None:
        self.task = task
        self.contralateral = task.contralateral
        self._options = options
        self._kept: dict[bytes, dict[int, tuple[_Float, _Float]]] = {}

    @cached_property
    def samples(self) -> list[SubjectSample]:
        """A few poses of the clip, which is the first, and of each take that is examined."""
        samples = [self._clip_sample()]
        numbers: dict[str, int] = {}
        for i in self._examined_takes:
            take = self.task.takes[i]
            subject = THIS_CLIP
            if not take.same_subject:
                subject = numbers.setdefault(take.subject or f"\0{i}", len(numbers))
            level = take.nearest_level(self._options.database_rate)
            frames = evenly_spaced(take.lengths[level], self._options.shape_poses)
            poses = take.positions(level)[frames].astype(np.float64)
            samples.append(SubjectSample(i, subject, poses))
        return samples

    @property
    def _examined_takes(self) -> list[int]:
        """Takes of the same subject, and some of the database."""
        takes = self.task.takes
        same_subject = [i for i, take in enumerate(takes) if take.same_subject]
        others = [i for i, take in enumerate(takes) if not take.same_subject]
        chosen = evenly_spaced(len(others), self._options.max_database_takes)
        return same_subject + [others[i] for i in chosen]

    def _clip_sample(self) -> SubjectSample:
        """Evenly spaced frames of the clip, and all that show a rarely visible marker."""
        task, max_poses = self.task, self._options.max_own_poses
        rare = task.valid.any(axis=0) & (task.valid.sum(axis=0) < max_poses)
        frames = np.union1d(
            evenly_spaced(len(task.positions), max_poses),
            np.flatnonzero(task.valid[:, rare].any(axis=1)),
        )
        return SubjectSample(THIS_CLIP, THIS_CLIP, task.positions[frames])

    @cached_property
    def same_subject_takes(self) -> frozenset[int]:
        """Takes of the clip's own subject with the same marker placement.

        These are the task's recordings of the same subject, and takes of the database in which the
        distances of rigid pairs of markers are the clip's.
        """
        options = self._options
        clip = self.samples[0]
        markers = np.arange(len(self.task.labels))
        one, other = np.triu_indices(len(markers), 1)
        spread = self.distances(markers)[1][one, other]
        clip_distance = median_distances(clip.poses, one, other)
        found = []
        for sample in self.samples[1:]:
            take = self.task.takes[sample.take]
            if take.same_subject:
                found.append(sample.take)
                continue
            if take.virtual_markers:
                continue  # they are not placed where the subject's markers were
            difference = np.abs(median_distances(sample.poses, one, other) - clip_distance)
            known = np.flatnonzero(~np.isnan(difference))
            count = options.rigid_pairs_per_marker * len(np.unique([one[known], other[known]]))
            rigid = known[np.argsort(spread[known], kind="stable")][:count]
            same_name = take.subject != "" and take.subject == self.task.subject
            limit = options.same_name_distance if same_name else options.same_subject_distance
            if len(rigid) and np.median(difference[rigid]) <= limit:
                found.append(sample.take)
        return frozenset(found)

    def distances(
        self, markers: NDArray[np.intp], samples: Sequence[SubjectSample] | None = None
    ) -> tuple[_Float, _Float]:
        """Return `pooled_distances` of some markers in some samples, or in all."""
        if samples is None:
            return self._kept_distances(b"", markers, lambda: self.samples)
        return pooled_distances([sample.poses for sample in samples], markers)

    def distances_where_shown(
        self, shown: NDArray[np.intp], markers: NDArray[np.intp]
    ) -> tuple[_Float, _Float]:
        """Return `pooled_distances` of some markers in the samples that show others together."""
        return self._kept_distances(shown.tobytes(), markers, lambda: self.samples_with(shown))

    def _kept_distances(
        self, key: bytes, markers: NDArray[np.intp], samples: Callable[[], list[SubjectSample]]
    ) -> tuple[_Float, _Float]:
        """Return distances of some markers; those of each marker are computed once.

        A marker that the clip never shows can have hundreds of gap segments with other visible
        markers each.
        """
        kept = self._kept.setdefault(key, {})
        new = np.array([m for m in dict.fromkeys(markers.tolist()) if m not in kept], dtype=np.intp)
        if len(new):
            new_rows = zip(*self.distances(new, samples()), strict=True)
            kept.update(zip(new.tolist(), new_rows, strict=True))
        found = np.empty((2, len(markers), len(self.task.labels)))
        for row, marker in enumerate(markers.tolist()):
            found[:, row] = kept[marker]
        return found[0], found[1]

    def samples_with(self, markers: NDArray[np.intp]) -> list[SubjectSample]:
        """Return the samples, and mirror images of samples, that show some markers together.

        Those of the clip are among them only if it may be learnt from.
        """
        return [
            SubjectSample(sample.take, sample.subject, poses)
            for sample in self.samples
            if self.task.learn_from_clip or not sample.from_clip
            for poses in (sample.poses, mirrored(sample.poses, self.contralateral))
            if complete_poses(poses[:, markers]).any()
        ]
