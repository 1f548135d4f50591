"""Search for poses of a task's takes that are similar to poses of its clip."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.poses import evenly_spaced
from priorfill.geometry.root_frames import RootGroup
from priorfill.methods.gpr.other_bodies import BodyMapOptions, bring_onto_clip
from priorfill.methods.task import THIS_CLIP, Task
from priorfill.runtime.option_checks import check_at_least
from priorfill.search.bank import PoseBank, PoseBankCache

__all__ = ["PoseSearch", "SearchOptions"]

MIN_SHARE_OF_TAKES = 0.5
"""A marker is searched by if at least this share of the takes that have the missing markers have it
too: a pose must have all markers that it is searched by."""


@dataclass(frozen=True)
class SearchOptions:
    """How poses of the database are searched.

    Attributes
    ----------
    queries : int
        Frames of the clip that are searched for, evenly spaced.
    max_markers : int
        Visible markers that are compared, the nearest to the missing ones.
    rate : float
        Hz. Highest resolution at which poses are searched.
    max_poses : int
        Maximum number of poses searched. A larger database is searched at a lower rate and, if it
        is still too large, by evenly spaced poses: consecutive poses are redundant.
    bodies : BodyMapOptions
        How poses of other subjects are mapped onto the clip's body.
    """

    queries: int = 100
    max_markers: int = 12
    rate: float = 30.0
    max_poses: int = 1_000_000
    bodies: BodyMapOptions = field(default_factory=BodyMapOptions)

    def __post_init__(self) -> None:
        check_at_least(self, 1, "queries", "max_poses")
        check_at_least(self, 3, "max_markers")
        check_at_least(self, 0.1, "rate")


class PoseSearch:
    """Searches the poses of a task's takes.

    Parameters
    ----------
    task : Task
        The clip and the takes.
    options : SearchOptions
        Number of poses.
    """

    def __init__(self, task: Task, options: SearchOptions = SearchOptions()) -> None:
        self.task = task
        self.options = options
        self._banks = PoseBankCache(task.takes)

    def common_markers(self, markers: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return the markers of most takes that have some given markers [bool, shape=(markers,)].

        Parameters
        ----------
        markers : ndarray of int
            The markers that a take must have to be counted.
        """
        having = self._has_marker[np.logical_and.reduce(self._has_marker[:, markers], axis=1)]
        common: NDArray[np.bool_] = having.sum(axis=0) >= max(1.0, MIN_SHARE_OF_TAKES * len(having))
        return common

    def bank(
        self,
        root: RootGroup,
        viable: NDArray[np.intp],
        wanted: NDArray[np.intp],
        rate: float,
        *,
        on_clips_body: bool = False,
    ) -> PoseBank:
        """Return a bank of the takes at a rate (Hz), or at a lower one if it would be too large.

        Parameters
        ----------
        root, viable, wanted, rate
            As of `priorfill.search.bank.PoseBankCache.get`.
        on_clips_body : bool
            Whether poses of other subjects are mapped onto the clip's body.
        """
        return self._banks.get(
            root,
            viable,
            wanted,
            min(rate, self._highest_rate),
            self.options.max_poses,
            self._map_onto_clip if on_clips_body else None,
        )

    def _map_onto_clip(
        self,
        positions: NDArray[np.float32],
        take: NDArray[np.intp],
        rows: NDArray[np.intp],
        markers: NDArray[np.intp],
    ) -> NDArray[np.float32] | None:
        """Map the poses of other subjects onto the clip's body; a `PoseMapping`.

        Not if takes of the clip's subject are among them, see `BodyMapOptions`.
        """
        task = self.task
        names = {task.takes[i].subject for i in np.unique(take[rows])}
        if task.subject and task.subject in names:
            return None
        pairs, geometry = np.ix_(markers, markers), task.geometry
        mapped = positions.copy()
        changed = bring_onto_clip(
            mapped,
            self.subjects[take],
            rows,
            (geometry.distance[pairs], geometry.spread[pairs]),
            self.options.bodies,
        )
        return mapped if changed else None

    def nearest(
        self,
        bank: PoseBank,
        root: RootGroup,
        markers: NDArray[np.intp],
        poses: NDArray[np.float64],
        neighbours: int,
    ) -> NDArray[np.intp]:
        """Return the rows of a bank that are nearest to poses, the nearest first, each once.

        Parameters
        ----------
        bank : PoseBank
            Where to search.
        root : RootGroup
            Aligns the poses.
        markers : ndarray of int
            Markers of the poses.
        poses : ndarray [shape=(poses, markers, 3), mm]
            Complete; evenly spaced ones are searched for.
        neighbours : int
            Nearest poses of each.
        """
        chosen = poses[evenly_spaced(len(poses), self.options.queries)]
        queries = self.in_clip_order(markers, chosen)
        rows = bank.search(queries, root.frames(queries), neighbours)[1]
        return _by_rank(rows)

    def in_clip_order(
        self, markers: NDArray[np.intp], poses: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return poses of some markers with all markers of the clip, NaN for the others."""
        placed = np.full((len(poses), len(self.task.labels), 3), np.nan)
        placed[:, markers] = poses
        return placed

    @cached_property
    def subjects(self) -> NDArray[np.intp]:
        """Number of each take's subject [shape=(takes,)]; `THIS_CLIP` for the clip's own.

        Each take whose subject is unknown is counted as another subject.
        """
        names = [take.subject or f"\0{i}" for i, take in enumerate(self.task.takes)]
        numbers = np.unique(names, return_inverse=True)[1].astype(np.intp)
        same_subject = np.array([take.same_subject for take in self.task.takes], dtype=bool)
        return np.where(same_subject, THIS_CLIP, numbers)

    @cached_property
    def _highest_rate(self) -> float:
        """The highest rate (Hz) at which the takes have few enough poses, or their coarsest."""
        takes, rate = self.task.takes, self.options.rate
        while (
            rate > min(take.rates[-1] for take in takes)
            and sum(take.lengths[take.nearest_level(rate)] for take in takes)
            > self.options.max_poses
        ):
            rate /= 2.0
        return rate

    @cached_property
    def _has_marker(self) -> NDArray[np.bool_]:
        """Which markers each take has [shape=(takes, markers)]."""
        return np.array([take.shown > 0 for take in self.task.takes])


def _by_rank(neighbours: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return neighbours [shape=(queries, k)] in the order of their rank, each once.

    The nearest of all queries come first, then the second nearest, and so on.
    """
    rows = neighbours.T.ravel()
    _, first = np.unique(rows, return_index=True)
    return rows[np.sort(first)]
