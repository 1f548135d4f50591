"""Plan by which visible markers a task's takes are searched for its missing ones.

What the methods that search for whole poses share: `priorfill.methods.baumann2011.neighbour_votes`,
`priorfill.methods.baumann2011.weighted_votes` and `priorfill.methods.baumann2011.krueger2010`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.root_frames import RootGroup
from priorfill.methods.task import Task
from priorfill.search.bank import Banks, PoseBank
from priorfill.search.takes import Take

__all__ = [
    "BATCH_FRAMES",
    "DEFAULT_NEIGHBOURS",
    "MIN_POSES",
    "MIN_VIABLE",
    "MarkerSearch",
    "SearchPlan",
    "SearchPlanner",
]

DEFAULT_NEIGHBOURS = 256
"""k. Krüger et al. 2010 and Tautges et al. 2011 search for 256 poses."""

MIN_VIABLE = 4
"""Four reliable markers fix the root and leave something to tell poses apart."""

MIN_POSES = 16
"""With fewer poses that have all the wanted markers, they are looked for one by one."""

BATCH_FRAMES = 64
"""Frames whose neighbours are gathered at once; bounds the memory to some 100 MB."""


@dataclass(frozen=True, eq=False)
class MarkerSearch:
    """What poses are searched by, and for.

    Attributes
    ----------
    root : RootGroup
        Gives the root frames that poses are compared in.
    viable : ndarray of int [shape=(viable markers,)]
        The markers searched by.
    wanted : ndarray of int [shape=(wanted markers,)]
        The missing markers that are read off the poses found.
    """

    root: RootGroup
    viable: NDArray[np.intp]
    wanted: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class SearchPlan:
    """The searches for some missing markers.

    Attributes
    ----------
    searches : list of MarkerSearch
        Each missing marker is wanted by at most one.
    left : list of (ndarray of int, str)
        Missing markers that cannot be searched for, and why.
    """

    searches: list[MarkerSearch]
    left: list[tuple[NDArray[np.intp], str]]


class SearchPlanner:
    """Plans searches, and keeps the banks that they use.

    Parameters
    ----------
    task : Task
        The clip.
    takes : sequence of Take
        Where to search.
    min_viable : int
        With fewer reliable markers in sight, all that are in sight are searched by.
    min_poses : int
        With fewer poses that have all the wanted markers, they are looked for one by one, and by
        fewer markers.

    Attributes
    ----------
    reliable : ndarray of bool [shape=(markers,)]
        Which of the clip's markers are placed the same way on everybody.
    """

    def __init__(
        self,
        task: Task,
        takes: tuple[Take, ...],
        min_viable: int = MIN_VIABLE,
        min_poses: int = MIN_POSES,
    ) -> None:
        self._task = task
        self._min_viable = min_viable
        self._min_poses = min_poses
        labels = task.labels
        self.reliable = np.array([task.marker_set.reliable.get(label, False) for label in labels])
        # how often the takes have each marker: the rarest are the first to be searched without
        self._seen = np.zeros(len(labels))
        for take in takes:
            self._seen += take.shown * (take.lengths[-1] / take.lengths[0])
        self._banks = Banks(takes)

    def bank(self, search: MarkerSearch, rate: float) -> PoseBank:
        """Return the bank of a search at a rate (Hz)."""
        return self._banks.get(search.root, search.viable, search.wanted, rate)

    def plan(self, visible: NDArray[np.bool_]) -> SearchPlan:
        """Plan the searches for all markers that are not visible [shape=(markers,)]."""
        wanted = np.flatnonzero(~visible)
        viable = np.flatnonzero(visible & self.reliable)
        if len(viable) < self._min_viable:
            viable = np.flatnonzero(visible)
        root = self._task.root_among(np.flatnonzero(visible))
        if root is None:
            return SearchPlan([], [(wanted, "fewer than two markers are visible")])
        found = self._with_poses(MarkerSearch(root, viable, wanted))
        reason = "no prior pose has this marker together with visible ones"
        return SearchPlan(
            [search for search in found if len(search.viable)],
            [(search.wanted, reason) for search in found if not len(search.viable)],
        )

    def _with_poses(self, search: MarkerSearch) -> list[MarkerSearch]:
        """Split a search or drop markers until the takes hold enough poses for it.

        A search that finds no pose however small comes back without viable markers.
        """
        bank = self.bank(search, self._task.rate)
        if len(bank) >= self._min_poses:
            return [search]
        if len(search.wanted) > 1:
            return [
                part
                for marker in search.wanted
                for part in self._with_poses(MarkerSearch(search.root, search.viable, marker[None]))
            ]
        if len(search.viable) > 2:
            kept = np.sort(
                search.viable[np.argsort(-self._seen[search.viable], kind="stable")][
                    : max(2, len(search.viable) * 3 // 4)
                ]
            )
            root = self._task.root_among(kept)
            if root is not None:
                return self._with_poses(MarkerSearch(root, kept, search.wanted))
        if len(bank):
            return [search]
        return [MarkerSearch(search.root, search.viable[:0], search.wanted)]
