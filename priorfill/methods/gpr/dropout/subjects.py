"""Bodies: a few poses of each recording, and which recordings are of the clip's own body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.distances import median_distances, pooled_distances
from priorfill.geometry.mirror import mirrored
from priorfill.geometry.poses import complete_poses, evenly_spaced
from priorfill.methods.task import Task

__all__ = ["CLIP", "OWN", "OWN_ROWS", "RATE", "Bodies", "Sample"]

EXAMPLES = 400
"""Takes of a database that are looked at, evenly spread: enough to meet most of its people."""

SAMPLED = 24
"""Poses of each by which distances and shapes are judged."""

OWN_ROWS = 400
"""Poses of the clip's own body."""

RATE = 15.0
"""Hz. Poses that follow each other more closely say the same."""

SAME_BODY = 2.8
"""mm. A take of a database whose firm distances differ from the clip's by no more than this
(median) is of the same body with the same markers on it. In CMU, HDM05 and gait recordings takes
of one session differ by 0.3 to 2.4 mm, those of different people by 3.4 and more."""

SAME_NAME = 6.0
"""mm. The same for takes whose subject has the name of the clip's: markers put on again differ by
4 mm and more, but names like "male" are no proof."""

FIRM_PAIRS = 2
"""So many pairs of markers for each marker are compared, those whose distances vary least."""

OWN = -1
"""Number of the clip's own body."""

CLIP = -1
"""Number of the clip among the takes."""


@dataclass(frozen=True, eq=False)
class Sample:
    """A few poses of a take, or of the clip itself.

    Attributes
    ----------
    take : int
        Its number in the task; `CLIP` for the clip.
    body : int
        Number of the body; `OWN` for the clip's.
    poses : ndarray [shape=(poses, all markers, 3), mm]
        Upright; NaN where missing.
    """

    take: int
    body: int
    poses: NDArray[np.float64]


class Bodies:
    """The bodies that the clip of a task, its companions and its database show.

    Parameters
    ----------
    task : Task
        The clip and the takes to learn from.

    Attributes
    ----------
    partner : ndarray of int [shape=(markers,)]
        See `Task.contralateral`.
    """

    def __init__(self, task: Task) -> None:
        self.task = task
        self.contralateral = task.contralateral

    @cached_property
    def _takes(self) -> list[int]:
        """Takes that are looked at: the companions, and some of the database's."""
        takes = self.task.takes
        same_subject = [i for i, take in enumerate(takes) if take.same_subject]
        others = [i for i, take in enumerate(takes) if not take.same_subject]
        return same_subject + [others[i] for i in evenly_spaced(len(others), EXAMPLES)]

    @cached_property
    def samples(self) -> list[Sample]:
        """A few poses of the clip, of its companions and of takes of the database."""
        task = self.task
        numbers: dict[str, int] = {}
        # every other frame, say, of the clip: what few frames show a marker are all looked at
        rare = task.valid.any(axis=0) & (task.valid.sum(axis=0) < OWN_ROWS)
        some = np.union1d(
            evenly_spaced(len(task.positions), OWN_ROWS),
            np.flatnonzero(task.valid[:, rare].any(axis=1)),
        )
        samples = [Sample(CLIP, OWN, task.positions[some])]
        for i in self._takes:
            take = task.takes[i]
            body = OWN
            if not take.same_subject:
                body = numbers.setdefault(take.subject or f"\0{i}", len(numbers))
            level = take.nearest_level(RATE)
            at = evenly_spaced(take.lengths[level], SAMPLED)
            samples.append(Sample(i, body, take.positions(level)[at].astype(np.float64)))
        return samples

    @cached_property
    def same_body(self) -> frozenset[int]:
        """Takes that are of the clip's own body: companions, and what is of the same shape."""
        task, first = self.task, self.samples[0]
        markers = np.arange(len(task.labels))
        one, other = np.triu_indices(len(markers), 1)
        spread = self.distances(markers)[1][one, other]
        mine = median_distances(first.poses, one, other)
        found = []
        for sample in self.samples[1:]:
            take = task.takes[sample.take]
            differ = np.abs(median_distances(sample.poses, one, other) - mine)
            known = np.flatnonzero(~np.isnan(differ))
            shared = np.unique([one[known], other[known]])
            firm = known[np.argsort(spread[known], kind="stable")][: FIRM_PAIRS * len(shared)]
            if take.virtual_markers and not take.same_subject:
                continue  # its markers are not where the body's were
            named = take.subject != "" and take.subject == task.subject
            most = SAME_NAME if named else SAME_BODY
            if take.same_subject or (len(firm) and np.median(differ[firm]) <= most):
                found.append(sample.take)
        return frozenset(found)

    def distances(
        self, markers: NDArray[np.intp], samples: Sequence[Sample] | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return `pooled_distances` of some markers in some samples, or in all."""
        some = self.samples if samples is None else samples
        return pooled_distances([sample.poses for sample in some], markers)

    def witnessing(self, markers: NDArray[np.intp]) -> list[Sample]:
        """Return the samples that show some markers, in a mirror if need be."""
        return [
            Sample(sample.take, sample.body, poses)
            for sample in self.samples
            for poses in (sample.poses, mirrored(sample.poses, self.contralateral))
            if complete_poses(poses[:, markers]).any()
        ]
