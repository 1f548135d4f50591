"""Search the poses of a task's takes by markers of its clip."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.poses import evenly_spaced
from priorfill.geometry.root_frames import RootGroup
from priorfill.methods.gpr.options import GPROptions
from priorfill.methods.task import Task
from priorfill.search.bank import Banks, PoseBank

__all__ = ["DATABASE_RATE", "OWN_BODY", "PoseSearch"]

DATABASE_RATE = 30.0
"""Hz. Resolution at which the database's poses are searched: they speak for poses, not for
detail in time."""

MOST_POSES = 1_000_000
"""Poses that are searched at most: of a larger database a coarser level, and of that every other
pose, say. Poses follow each other so closely that a part of them says as much."""


OWN_BODY = -1
"""Number of the clip's own body among those of the takes."""


class PoseSearch:
    """Searches the poses of a task's takes.

    Parameters
    ----------
    task : Task
        The clip and the takes.
    options : GPROptions
        How many poses to search for.
    """

    def __init__(self, task: Task, options: GPROptions) -> None:
        self.task = task
        self._options = options
        self._banks = Banks(task.takes)

    def shown_with(self, markers: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Which markers the takes that have all of some markers have too [shape=(markers,)]."""
        having = self._taken[np.logical_and.reduce(self._taken[:, markers], axis=1)]
        # rare ones are given up: a pose must have all that it is searched by
        often: NDArray[np.bool_] = having.sum(axis=0) >= max(1.0, 0.5 * len(having))
        return often

    def bank(
        self, root: RootGroup, viable: NDArray[np.intp], wanted: NDArray[np.intp], rate: float
    ) -> PoseBank:
        """Return a bank of the database at a rate (Hz), or at a lower one if it is large."""
        return self._banks.get(root, viable, wanted, min(rate, self._highest_rate), MOST_POSES)

    def nearest(
        self,
        bank: PoseBank,
        root: RootGroup,
        markers: NDArray[np.intp],
        poses: NDArray[np.float64],
    ) -> NDArray[np.intp]:
        """Return the rows of a bank nearest to poses of some markers, the nearest first."""
        some = self.placed(markers, poses[evenly_spaced(len(poses), self._options.queries)])
        return _in_turn(bank.search(some, root.frames(some), self._options.neighbours)[1])

    def placed(self, markers: NDArray[np.intp], poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return poses of some markers in the clip's order, with NaN for all other markers."""
        placed = np.full((len(poses), len(self.task.labels), 3), np.nan)
        placed[:, markers] = poses
        return placed

    @cached_property
    def bodies(self) -> NDArray[np.intp]:
        """Number of each take's subject; one whose subject is unknown has it to itself.

        Companions are of the clip's own body, which is none of these: their number is
        `OWN_BODY`.
        """
        subjects = [take.subject or f"\0{i}" for i, take in enumerate(self.task.takes)]
        numbers = np.unique(subjects, return_inverse=True)[1].astype(np.intp)
        same_subject = np.array([take.same_subject for take in self.task.takes], dtype=bool)
        return np.where(same_subject, OWN_BODY, numbers)

    @cached_property
    def _highest_rate(self) -> float:
        """The rate (Hz) up to which the database has few enough poses, or its coarsest."""
        takes, rate = self.task.takes, DATABASE_RATE
        while (
            rate > min(take.rates[-1] for take in takes)
            and sum(take.lengths[take.nearest_level(rate)] for take in takes) > MOST_POSES
        ):
            rate /= 2.0
        return rate

    @cached_property
    def _taken(self) -> NDArray[np.bool_]:
        """Which markers each take of the database has [shape=(takes, markers)]."""
        return np.array([take.shown > 0 for take in self.task.takes])


def _in_turn(ranked: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return neighbours [shape=(frames, k)] in the order of their worth, each once.

    Every frame's nearest come first, then every frame's second nearest, and so on.
    """
    rows = ranked.T.ravel()
    _, once = np.unique(rows, return_index=True)
    return rows[np.sort(once)]
