"""Gaussian-process regression from visible to missing markers.

The rows are poses in which the missing markers were seen. Poses are aligned near the gap (a
*view*), the visible markers' coordinates weighted by how near and how firmly they are tied to
the missing ones, and a Gaussian process (GP) predicts the missing coordinates in the aligned
frame. Its kernel has a linear part (bodies are nearly linear between near poses), a radial part
(k-nearest-neighbour like), and a part that decays with time, which carries the seam: rows right
beside the gap are followed closely there and forgotten further in.

Poses that look alike can belong to different movements. So the features may also hold a
*moment*: where the visible markers are shortly before and after, or how they move.

No view, moment and kernel is best for all movements. Each triple of them is a *member*; all
predict, and each counts by its error when blocks as long as the gap are left out of the rows, which
has a closed form [R06]_ Eq. (5.12), generalised to blocks: with the inverse kernel matrix G, the
residuals of block B are inv(G_BB) (G Y)_B and their covariance is inv(G_BB). A member that is less
sure of the gap than of those blocks counts less.

The mixture's own residuals of the blocks say how far its deviation is to be trusted.

Rows may also say how fast the missing markers move. Velocities are predicted in the same way,
from the same matrices, and mixed by their own errors. `priorfill.motion` joins them with the
positions.

References
----------
.. [R06] Rasmussen and Williams, Gaussian Processes for Machine Learning, MIT Press 2006.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.calibration import BOUND_FACTOR, BOUND_SHARE
from priorfill.gp.data import Lesson, Member
from priorfill.gp.linalg import shares
from priorfill.gp.models import (
    Learnt,
    Reader,
    Shared,
    Told,
)
from priorfill.gp.velocities import Motion, error_by_speed

__all__ = ["Regression", "regress"]

AT_ONCE = 200
"""Queries that all members predict at once: the matrices of a member take 0.4 MB each, and what
some hundred members say of a dozen targets 8 MB, however long the gap is."""

SELECTION_POWER = 8.0
"""Members count by (least error / own error) to this power: between the mean of all (0) and the
best alone (infinite), both of which fill worse."""

DOUBT_POWER = 0.35
"""In each frame members count by their left-out error times (deviation predicted there / in the
blocks left out) to this power: 0.25 to 0.5 fill alike, 0 and 1 worse by one or two parts in a
hundred, and far worse in the worst case."""

PRIOR_BLOCKS = 8.0
"""Blocks that `BOUND_FACTOR`, and a deviation that is right as predicted, count as against those
that were left out: a few blocks tell little of the tails."""

CHOICE = 1.3
"""So many times what left-out blocks tell is the deviation of what lessons beside the first say,
since they are weighed by the same blocks: without it, bounds that should hold for 90 % of samples
held for 85 % with a database, on 60 gaps, and for 90 % without."""

LEAST_DEVIATION = 1e-3
"""mm. Nothing is known better; a marker in the place of a visible one might seem to be."""

FEWEST_JUDGED = 20
"""Fewest rows that lessons must have in common for their mixture to be judged by them."""


@dataclass(frozen=True, eq=False)
class Regression:
    """What the regression says of the missing markers.

    Attributes
    ----------
    positions : ndarray [shape=(poses, missing markers, 3), mm]
        Upright.
    deviation : ndarray [shape=(poses, missing markers), mm]
        Expected rms Euclidean error.
    bound_factor : float
        Times the deviation: what 90 % of the errors are expected to lie within.
    motion : Motion or None
        How the missing markers move, if all lessons' rows say so.
    """

    positions: NDArray[np.float64]
    expected_rms: NDArray[np.float64]
    bound_factor: float
    motion: Motion | None = None


def _calibrate(
    share: NDArray[np.float64],
    residuals: NDArray[np.float64],
    left_out: NDArray[np.float64],
    blocks: int,
) -> tuple[float, float]:
    """Judge a mixture's deviation by what it got wrong on blocks left out.

    Parameters
    ----------
    share : ndarray [shape=(members,)]
        Sum 1.
    residuals : ndarray [shape=(members, rows, missing markers, 3), mm]
        Of the same rows.
    left_out : ndarray [shape=(members, rows, missing markers), mm²]
        Predicted variance of each.
    blocks : int
        How many blocks the rows are from.

    Returns
    -------
    factor : float
        What the mixture's deviation is to be multiplied by.
    bound : float
        What times that deviation 90 % of the errors lie within.
    """
    mean = np.einsum("k,krmi->rmi", share, residuals)
    disagreement = ((residuals - mean) ** 2).sum(axis=3)
    variance = np.einsum("k,krm->rm", share, left_out + disagreement)
    ratio = np.sqrt((mean**2).sum(axis=2) / np.maximum(variance, 1e-12))
    known = blocks / (blocks + PRIOR_BLOCKS)
    factor = float(np.sqrt((ratio**2).mean()))
    if factor < LEAST_DEVIATION:  # nothing was wrong at all
        return LEAST_DEVIATION, BOUND_FACTOR
    bound = float(np.quantile(ratio, BOUND_SHARE)) / factor
    return factor**known, bound**known * BOUND_FACTOR ** (1.0 - known)


@dataclass(frozen=True, eq=False)
class _Taught:
    """Lessons, their readers, and the members of all of them in one order."""

    lessons: Sequence[Lesson]
    shared: Sequence[Shared]
    readers: Sequence[Reader]
    of_lesson: NDArray[np.intp]  # (members,)

    @property
    def learnt(self) -> list[Learnt]:
        """What each member has learnt."""
        return [one for reader in self.readers for one in reader.learnt]


@dataclass(eq=False)
class _Mixture:
    """What members say together of some of the targets: a part of the queries at a time.

    Members count frame by frame, by their errors in the blocks left out and their doubt.
    """

    taught: _Taught
    targets: slice
    mean: NDArray[np.float64]  # (queries, targets, 3)
    expected_rms: NDArray[np.float64]  # (queries, targets), as they predict it
    usual: NDArray[np.float64]  # (members,), how much they count in the gap, summed
    error: NDArray[np.float64]  # (members,), rms in the blocks left out

    @classmethod
    def of(cls, taught: _Taught, targets: slice, queries: int, count: int) -> _Mixture:
        """Return a mixture for so many queries and targets, of which nothing is said yet."""
        square = [(one.residuals[:, targets] ** 2).sum(axis=2).mean() for one in taught.learnt]
        return cls(
            taught,
            targets,
            np.empty((queries, count, 3)),
            np.empty((queries, count)),
            np.zeros(len(square)),
            np.sqrt(square),
        )

    def add(self, some: slice, found: Sequence[Told], inside: NDArray[np.bool_]) -> None:
        """Mix what the readers say of some of the queries.

        Parameters
        ----------
        some : slice
            Which queries.
        found : sequence of Told
            Of each reader.
        inside : ndarray of bool [shape=(some,)]
            Which of them are in the gap.
        """
        told = np.concatenate([one.told[:, :, self.targets] for one in found])
        variance = np.concatenate([one.variance[:, :, self.targets] for one in found])
        doubt = np.concatenate([one.doubt for one in found])
        handicap = np.array([lesson.handicap for lesson in self.taught.lessons])
        # a clip that stands still has no error
        judged = np.maximum(self.error[:, None] * doubt**DOUBT_POWER, 1e-6)
        share = shares(judged * handicap[self.taught.of_lesson, None], SELECTION_POWER)
        mean = np.einsum("kq,kqmi->qmi", share, told)
        told -= mean
        # sums over the last axis, of three, are slow
        disagreement = told[..., 0] ** 2 + told[..., 1] ** 2 + told[..., 2] ** 2
        self.mean[some] = mean
        self.expected_rms[some] = np.sqrt(np.einsum("kq,kqm->qm", share, variance + disagreement))
        self.usual += share[:, inside].sum(axis=1)

    def judge(self) -> _Judgement:
        """Judge it by the rows that all lessons have, or else by those of the weightiest."""
        taught, learnt = self.taught, self.taught.learnt
        usual = self.usual / self.usual.sum()
        lessons, shared, of_lesson = taught.lessons, taught.shared, taught.of_lesson
        times = [lesson.rows.time[s.judged] for lesson, s in zip(lessons, shared, strict=True)]
        common = reduce(np.intersect1d, times)
        if len(lessons) > 1 and len(common) >= FEWEST_JUDGED:
            counted, by = np.arange(len(learnt)), 0
            rows = [np.searchsorted(time, common) for time in times]
        else:
            by = int(np.argmax(np.bincount(of_lesson, usual)))
            counted = np.flatnonzero(of_lesson == by)
            rows = [np.arange(len(time)) for time in times]
        moving = lessons[by].rows.moving
        known = np.empty((len(rows[by]), 0, 3))
        if moving is not None and self.targets.start:
            known = moving[shared[by].judged[rows[by]]]
        return _Judgement(
            float(usual[of_lesson > 0].sum()),
            usual[counted] / usual[counted].sum(),
            np.stack([learnt[k].residuals[rows[of_lesson[k]], self.targets] for k in counted]),
            np.stack([learnt[k].left_out[rows[of_lesson[k]], self.targets] for k in counted]),
            known,
            min(len(s.blocks) for s in shared),
        )


@dataclass(frozen=True, eq=False)
class _Judgement:
    """What a mixture got wrong of its targets, by the members and rows that can tell."""

    beside: float  # how much lessons beside the first count
    share: NDArray[np.float64]  # (members,)
    residuals: NDArray[np.float64]  # (members, rows, targets, 3)
    left_out: NDArray[np.float64]  # (members, rows, targets)
    known: NDArray[np.float64]  # (rows, targets, 3), velocities; empty of positions
    blocks: int

    @property
    def wrong(self) -> NDArray[np.float64]:
        """The mixture's residuals [shape=(rows, targets, 3)]."""
        residuals: NDArray[np.float64] = np.einsum("k,krmi->rmi", self.share, self.residuals)
        return residuals


def regress(
    lessons: Sequence[Lesson],
    members: Sequence[Member],
    block_seconds: float,
    inside: NDArray[np.bool_] | None = None,
    each: Callable[..., Iterable[Any]] = map,
) -> Regression:
    """Predict the missing markers of some poses.

    Parameters
    ----------
    lessons : sequence of Lesson
        Ways to learn the same thing: all have the same queries and missing markers.
    members : sequence of Member
        Ways to predict; each does by each lesson that has its moment. Those of one view, and in
        it of one moment, follow each other.
    block_seconds : float
        Length of the blocks left out: that of the gap.
    inside : ndarray of bool [shape=(poses,)], optional
        Which of the queries stand for the gap, the others being beside it or too many;
        all by default.
    each : callable
        How views are gone through: as `map` does, or several at a time.

    Returns
    -------
    Regression
        Members mixed by their left-out error.
    """
    queries = len(lessons[0].query.time)
    if inside is None:
        inside = np.ones(queries, dtype=bool)
    taught = _teach(lessons, members, block_seconds, each)
    markers = lessons[0].rows.missing.shape[1]
    mixtures = [_Mixture.of(taught, slice(0, markers), queries, markers)]
    moving = all(lesson.rows.moving is not None for lesson in lessons)
    if moving:
        mixtures.append(_Mixture.of(taught, slice(markers, None), queries, markers))
    for start in range(0, queries, AT_ONCE):
        some = slice(start, start + AT_ONCE)
        found = _tell(taught, some, each)
        for mixture in mixtures:
            mixture.add(some, found, inside[some])
    place, judgement = mixtures[0], mixtures[0].judge()
    factor, bound = _calibrate(
        judgement.share, judgement.residuals, judgement.left_out, judgement.blocks
    )
    factor *= CHOICE**judgement.beside
    expected_rms = np.maximum(place.expected_rms * factor, LEAST_DEVIATION)
    motion = None
    if moving:
        pace, paced = mixtures[1], mixtures[1].judge()
        motion = Motion(
            pace.mean,
            np.sqrt(
                pace.expected_rms
                * error_by_speed(pace.mean, paced.known - paced.wrong, paced.wrong)
            ),
            np.maximum(np.sqrt((judgement.wrong**2).sum(axis=2).mean(axis=0)), LEAST_DEVIATION),
        )
    return Regression(place.mean, expected_rms, bound, motion)


def _teach(
    lessons: Sequence[Lesson],
    members: Sequence[Member],
    block_seconds: float,
    each: Callable[..., Iterable[Reader]],
) -> _Taught:
    """Let members learn; parameters as for `regress`."""
    kernels = tuple(dict.fromkeys(member.kernel for member in members))
    shared = [Shared.of(lesson, kernels, block_seconds) for lesson in lessons]
    able = [[m for m in members if lesson.shows(m.moment)] for lesson in lessons]
    tasks = [
        (view, lesson, tuple(some), share)
        for lesson, share, readers in zip(lessons, shared, able, strict=True)
        for view, some in groupby(readers, key=lambda member: member.view)
    ]
    readers = list(each(Reader.of, *zip(*tasks, strict=True)))
    return _Taught(
        lessons, shared, readers, np.repeat(np.arange(len(lessons)), [len(some) for some in able])
    )


def _tell(taught: _Taught, some: slice, each: Callable[..., Iterable[Told]]) -> list[Told]:
    """Let all readers predict some of the queries."""
    asked = {}
    for lesson, share in zip(taught.lessons, taught.shared, strict=True):
        query = lesson.asked(some)
        asked[id(share)] = (query, *share.asked(query))
    return list(each(lambda reader: reader.tell(*asked[id(reader.shared)]), taught.readers))
