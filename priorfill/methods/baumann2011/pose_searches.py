"""Plan the searches of a task: by which visible markers, and for which missing ones.

The poses found are the k neighbours y_i over which Eqs. (2)-(4) of Baumann et al. 2011, and so the
energy of Eq. (1), sum. Section 4.1 of the paper calls the markers of a search *viable*: those that
the marker set marks as reliable and that are measured. It searches by all of them, with a kd-tree
per clip; here there is one for each set of viable markers, and those that the takes lack are
dropped.
`neighbour_votes`, `weighted_votes` and `krueger2010` share these searches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.root_frames import RootGroup
from priorfill.methods.task import Task
from priorfill.search.bank import PoseBank, PoseBankCache
from priorfill.search.takes import Take

__all__ = [
    "BATCH_FRAMES",
    "MIN_POSES",
    "MIN_VIABLE",
    "MarkerSearch",
    "SearchPlan",
    "SearchPlanner",
]

MIN_VIABLE = 4
"""Viable markers per search: three determine the root frame, a fourth distinguishes poses."""

MIN_POSES = 16
"""Poses with all missing markers; with fewer, each missing marker is searched for on its own."""

BATCH_FRAMES = 64
"""Frames whose neighbours are gathered at once; limits the memory to about 100 MB."""

MIN_REDUCED_VIABLE = 2
"""Viable markers that a search keeps when it drops those that the takes lack."""

KEPT_VIABLE = 0.75
"""Share of the viable markers kept each time some are dropped."""


@dataclass(frozen=True, eq=False)
class MarkerSearch:
    """A search for poses: its root group, its viable markers, and the markers it predicts.

    Attributes
    ----------
    root : RootGroup
        Defines the root frames in which poses are compared.
    viable : ndarray of int [shape=(viable markers,)]
        Markers whose coordinates are compared.
    wanted : ndarray of int [shape=(wanted markers,)]
        Missing markers that are taken from the poses found.
    """

    root: RootGroup
    viable: NDArray[np.intp]
    wanted: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class SearchPlan:
    """The searches for a set of missing markers.

    Attributes
    ----------
    searches : list of MarkerSearch
        Each missing marker belongs to at most one of them.
    unsearched : list of (ndarray of int, str)
        Missing markers without a search, with the reason.
    """

    searches: list[MarkerSearch]
    unsearched: list[tuple[NDArray[np.intp], str]]


class SearchPlanner:
    """Plans searches and keeps the pose banks that they use.

    Parameters
    ----------
    task : Task
        The clip.
    takes : sequence of Take
        The recordings to search.
    min_viable : int
        With fewer reliable visible markers, all visible markers are viable.
    min_poses : int
        With fewer poses that have all wanted markers, markers are searched for one by one, and by
        fewer viable markers.

    Attributes
    ----------
    reliable : ndarray of bool [shape=(markers,)]
        Markers whose placement hardly varies between subjects, by the marker set.
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
        # how often the takes show each marker: the rarest are dropped first
        self._seen = np.zeros(len(labels))
        for take in takes:
            self._seen += take.shown * (take.lengths[-1] / take.lengths[0])
        self._banks = PoseBankCache(takes, way="kd-tree")

    def bank(self, search: MarkerSearch, rate: float) -> PoseBank:
        """Return the pose bank of a search at a frame rate (Hz)."""
        return self._banks.get(search.root, search.viable, search.wanted, rate)

    def plan(self, visible: NDArray[np.bool_], markers: Sequence[int]) -> SearchPlan:
        """Plan the searches for the markers of a gap group that are not visible.

        Parameters
        ----------
        visible : ndarray of bool [shape=(markers,)]
            Markers that are measured throughout the frames of the search.
        markers : sequence of int
            Markers of the gap group; others may be missing too, and are not searched for.

        Returns
        -------
        SearchPlan
            Searches, and the markers that no take shows together with visible ones.
        """
        of_group = np.array(markers, dtype=np.intp)
        wanted = of_group[~visible[of_group]]
        if not len(wanted):
            return SearchPlan([], [])
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
        """Split a search, or drop viable markers, until the takes have enough poses for it.

        A search without any pose is returned without viable markers.
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
        if len(search.viable) > MIN_REDUCED_VIABLE:
            most_seen = np.argsort(-self._seen[search.viable], kind="stable")
            count = max(MIN_REDUCED_VIABLE, int(len(search.viable) * KEPT_VIABLE))
            kept = np.sort(search.viable[most_seen[:count]])
            root = self._task.root_among(kept)
            if root is not None:
                return self._with_poses(MarkerSearch(root, kept, search.wanted))
        if len(bank):
            return [search]
        return [MarkerSearch(search.root, search.viable[:0], search.wanted)]
