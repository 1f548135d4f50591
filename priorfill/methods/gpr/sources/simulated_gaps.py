"""Simulated gaps: the gap's markers removed where other recordings are most like the gap.

How much better a database predicts a gap than the clip alone cannot be seen in the clip, which may
show the movement of the gap once. So stretches of other recordings are found whose visible markers
move as those of the gap do. There the same markers are removed for the same time, and are predicted
twice: from that recording's own frames before and after, as the clip's own regression problem does,
and from the database without these poses. Both errors are known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.mirror import mirrored
from priorfill.geometry.poses import evenly_spaced
from priorfill.geometry.root_frames import RootGroup
from priorfill.gp.ensemble import Regression, regress
from priorfill.gp.linalg import squared_distances
from priorfill.gp.problem import GPModel, PoseSamples, RegressionProblem
from priorfill.methods.gpr.pose_search import PoseSearch
from priorfill.methods.task import MIRROR_IMAGE, THIS_CLIP
from priorfill.runtime.option_checks import check_at_least
from priorfill.search.bank import PoseBank

__all__ = ["SimulatedGapOptions", "SimulatedPlace", "SimulatedPlaces"]


@dataclass(frozen=True)
class SimulatedGapOptions:
    """Simulated gaps in other recordings.

    Attributes
    ----------
    places : int
        Number of simulated gaps at most, each in another take.
    searched_takes : int
        Takes that are examined: those with the most poses near the gap.
    searched_poses : int
        Poses of these takes that are compared at most, those around the poses near the gap: they
        take 20 MB.
    key_poses : int
        Evenly spaced poses of the gap that are compared.
    context_poses : int
        Poses before, and poses after each simulated gap that the problem with the database is
        trained with, since it is trained with the clip's own as well.
    own_poses : int
        Poses of a take that its own regression is trained with at most.
    min_own_poses : int
        A take with fewer poses outside the simulated gap is not used.
    min_gap_poses : int
        A simulated gap with fewer poses among the training poses is not used.
    body_difference : float
        mm. A take whose body differs so much from the clip's (rms offset of its visible markers)
        counts half.
    """

    places: int = 8
    searched_takes: int = 40
    searched_poses: int = 40_000
    key_poses: int = 8
    context_poses: int = 4
    own_poses: int = 80
    min_own_poses: int = 6
    min_gap_poses: int = 3
    body_difference: float = 20.0

    def __post_init__(self) -> None:
        check_at_least(self, 0, "places", "context_poses")
        check_at_least(self, 2, "key_poses", "min_own_poses")
        check_at_least(self, 1, "searched_takes", "searched_poses", "own_poses", "min_gap_poses")
        check_at_least(self, 0.1, "body_difference")

    def likeness(self, offset: NDArray[np.float64]) -> float:
        """Return how far a take's errors are those of the clip, by its body.

        Parameters
        ----------
        offset : ndarray [shape=(poses, markers, 3), mm]
            What is added to its visible markers to fit them to the clip's.
        """
        square = float((offset**2).sum(axis=-1).mean())
        return 1.0 / (1.0 + square / self.body_difference**2)


@dataclass(frozen=True, eq=False)
class SimulatedPlace:
    """A stretch of a take that is like the gap.

    Attributes
    ----------
    take : int
        Number of the take.
    distance : float
        mm. Rms distance of its poses' visible markers from the gap's.
    gap_rows : ndarray of int
        Rows of the bank inside the simulated gap.
    own_rows : ndarray of int
        Rows of the take before and after it.
    """

    take: int
    distance: float
    gap_rows: NDArray[np.intp]
    own_rows: NDArray[np.intp]

    def context(self, count: int) -> NDArray[np.intp]:
        """Return evenly spaced rows before, and as many after the gap; those adjacent included."""
        before = self.own_rows[self.own_rows < self.gap_rows[0]]
        after = self.own_rows[self.own_rows > self.gap_rows[-1]]
        return np.concatenate([rows[evenly_spaced(len(rows), count)] for rows in (before, after)])


@dataclass(frozen=True, eq=False)
class SimulatedPlaces:
    """Finds simulated gaps in a bank, and predicts them from each take's own poses.

    Attributes
    ----------
    bank : PoseBank
        The poses of the database.
    root : RootGroup
        Aligns poses to be compared.
    search : PoseSearch
        Of the bank.
    visible, missing : ndarray of int
        Markers of the clip, the nearest visible ones first.
    query : PoseSamples
        Poses in the gap, in order of time.
    seconds_before, seconds_after : float
        s. How much of the clip there is before and after the gap.
    options : SimulatedGapOptions
        Numbers of places and poses.
    """

    bank: PoseBank
    root: RootGroup
    search: PoseSearch
    visible: NDArray[np.intp]
    missing: NDArray[np.intp]
    query: PoseSamples
    seconds_before: float
    seconds_after: float
    options: SimulatedGapOptions

    def find(self, near_gap: NDArray[np.intp]) -> list[SimulatedPlace]:
        """Find the places most like the gap, the most alike first, each in another take.

        Parameters
        ----------
        near_gap : ndarray of int
            Rows of the bank nearest to the gap.
        """
        options, bank = self.options, self.bank
        if not options.places or not len(near_gap):
            return []
        counts = np.bincount(bank.take(near_gap))
        takes = np.argsort(-counts, kind="stable")[: options.searched_takes]
        takes = takes[counts[takes] > 0]
        rows = bank.rows[np.isin(bank.take(bank.rows), takes)]
        if len(rows) > options.searched_poses:
            rows = self._near(rows, near_gap)
        distance = self._window_distance(rows)
        found: list[SimulatedPlace] = []
        used: set[int] = set()
        for index in np.argsort(distance, kind="stable"):
            take = int(bank.take(rows[index : index + 1])[0])
            if len(found) == options.places or not np.isfinite(distance[index]):
                break
            if take not in used:
                place = self._place(rows, int(index), take, float(distance[index]))
                used.add(take)
                if len(place.own_rows) >= options.min_own_poses:
                    found.append(place)
        return found

    def _near(self, rows: NDArray[np.intp], near_gap: NDArray[np.intp]) -> NDArray[np.intp]:
        """Return as many of the rows as may be compared: those around rows near the gap."""
        gap = np.sort(near_gap)
        after = np.minimum(np.searchsorted(gap, rows), len(gap) - 1)
        lag = np.minimum(np.abs(gap[after] - rows), np.abs(gap[np.maximum(after - 1, 0)] - rows))
        nearest = np.argsort(lag, kind="stable")[: self.options.searched_poses]
        return rows[np.sort(nearest)]

    def _window_distance(self, rows: NDArray[np.intp]) -> NDArray[np.float64]:
        """Return the distance of the gap from the stretch that starts at each row (mm).

        Infinite where the take ends earlier.
        """
        keys = evenly_spaced(len(self.query.time), self.options.key_poses)
        poses = self._local(self.bank.positions(rows, self.visible))
        targets = self._local(self.query.visible[keys])
        norms = (poses**2).sum(axis=1), (targets**2).sum(axis=1)
        square = squared_distances(poses @ targets.T, *norms) / (poses.shape[1] / 3.0)
        lag = self.query.time[keys] - self.query.time[0]
        steps = np.round(lag * self.bank.rates(rows)[:, None]).astype(np.intp)
        take = self.bank.take(rows)
        at = np.minimum(np.searchsorted(rows, rows[:, None] + steps), len(rows) - 1)
        there = (rows[at] == rows[:, None] + steps) & (take[at] == take[:, None])
        total = square[at, np.arange(len(keys))].mean(axis=1)
        distance: NDArray[np.float64] = np.where(there.all(axis=1), np.sqrt(total), np.inf)
        return distance

    def _place(
        self, rows: NDArray[np.intp], start: int, take: int, distance: float
    ) -> SimulatedPlace:
        """Return the place that starts at one of the rows."""
        own = rows[self.bank.take(rows) == take]
        rate = float(self.bank.rates(own[:1])[0])
        length = round((self.query.time[-1] - self.query.time[0]) * rate) + 1
        first, stop = rows[start], rows[start] + length
        inside = (own >= first) & (own < stop)
        before = round(self.seconds_before * rate)
        after = round(self.seconds_after * rate)
        context = ~inside & (own >= first - before) & (own < stop + after)
        return SimulatedPlace(take, distance, own[inside], own[context])

    def _local(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the searched markers in root frames [shape=(poses, 3 * markers), mm]."""
        frames = self.root.frames(self.search.in_clip_order(self.visible, poses))
        local = frames.to_local(poses)[:, : self.search.options.max_markers]
        return local.reshape(len(poses), -1)

    def predict_own(
        self,
        place: SimulatedPlace,
        models: Sequence[GPModel],
        distance: NDArray[np.float64],
        spread: NDArray[np.float64],
        mirror: float | None,
    ) -> Regression:
        """Predict a simulated gap from its take's own poses.

        Parameters
        ----------
        place : SimulatedPlace
            The place.
        models : sequence of GPModel
            The ensemble, without lag features.
        distance, spread : ndarray [shape=(visible markers,), mm]
            See `RegressionProblem`.
        mirror : float or None
            Correlation of the take's mirror image, if it is used.
        """
        rows = place.own_rows[evenly_spaced(len(place.own_rows), self.options.own_poses)]
        seconds = len(place.gap_rows) / float(self.bank.rates(place.gap_rows[:1])[0])
        problem = RegressionProblem(
            self._with_mirror_image(self._poses(rows), mirror),
            self._poses(place.gap_rows),
            distance,
            spread,
        )
        return regress((problem,), models, seconds)

    def _poses(self, rows: NDArray[np.intp]) -> PoseSamples:
        """Return poses of the bank as a clip's own."""
        bank = self.bank
        return PoseSamples(
            bank.positions(rows, self.visible),
            bank.positions(rows, self.missing),
            rows / bank.rates(rows),
            np.full(len(rows), THIS_CLIP),
        )

    def _with_mirror_image(self, poses: PoseSamples, correlation: float | None) -> PoseSamples:
        """Add the mirror image of poses, if it has all markers."""
        if correlation is None or not self._mirrored_markers_known:
            return poses
        both = np.concatenate([self.visible, self.missing])
        positions = np.concatenate([poses.visible, poses.missing], axis=1)
        contralateral = self.search.task.contralateral
        image = mirrored(self.search.in_clip_order(both, positions), contralateral)
        count = len(poses.time)
        return PoseSamples(
            np.concatenate([poses.visible, image[:, self.visible]]),
            np.concatenate([poses.missing, image[:, self.missing]]),
            np.tile(poses.time, 2),
            np.repeat([THIS_CLIP, MIRROR_IMAGE], count),
            np.repeat([1.0, correlation], count),
        )

    @cached_property
    def _mirrored_markers_known(self) -> bool:
        both = np.concatenate([self.visible, self.missing])
        return bool(np.isin(self.search.task.contralateral[both], both).all())
