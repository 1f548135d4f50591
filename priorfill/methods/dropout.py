"""Markers that the clip hardly shows: from other recordings, other bodies, and the mirror.

Where a marker sits on a body cannot be learnt from such a clip, so it is learnt from *witnesses*,
bodies that are seen with the marker. A witness is

* the clip's own body: other recordings of it (the clip's companions, and takes of the database
  whose markers keep the same distances), and the few frames in which the clip shows the marker;
* the clip's own body in a mirror, where the marker is the image of its partner;
* other people of the database, and they in a mirror.

All of them are rows of one Gaussian process from the visible markers nearby to the missing ones,
in frames aligned with those. Bodies differ by an offset and by how they move. Both are parts of
the covariance that rows share as far as their bodies do: wholly for one body, much for bodies of
nearly the same shape (the distances between visible markers that hardly vary), partly for a body
and its mirror image. How far a prediction is off is told by leaving whole bodies out, each
predicted from the others and its own image as the clip is. Several members are mixed by that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.task import Task
from priorfill.normalise import heading_frames, rigid_frames
from priorfill.regression import View, block_residuals

__all__ = ["Dropouts", "Told", "partners"]

EXAMPLES = 400
"""Takes of a database that are looked at, evenly spread: enough to meet most of its people."""

SAMPLED = 24
"""Poses of each by which distances and shapes are judged."""

VISIBLE = 12
"""Visible markers that a missing one is predicted by, the nearest ones."""

FEWEST_VISIBLE = 3
"""Visible markers that make a frame of reference."""

BODIES = 16
"""Other bodies learnt from, those of the most similar shape."""

TAKES = 6
"""Takes of each."""

ROWS = 20
"""Poses of each other body, and as many of its mirror image."""

OWN_ROWS = 400
"""Poses of the clip's own body."""

IMAGE_ROWS = 60
"""Poses of its mirror image."""

OFTEN = 0.5
"""Visible markers that fewer of the witnesses have are given up: a row must have all."""

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

FIRM = 5.0
"""mm. Distances that vary by this much count half as much in the shape of a body."""

SHAPE_REACH = 300.0
"""mm. Markers at this distance D from the missing one count exp(-1/2) in the shape."""

ALIGNMENT_FLOOR = 1e-3
"""Least weight of a visible marker in the alignment; see `priorfill.regression`."""

OWN_NOISE = 0.1
"""Noise of rows of the clip's own body, of that of other rows."""

SELECTION_POWER = 4.0
"""Members count by (least error / own error) to this power when bodies are left out."""

FEW_POSES = 12
"""Poses of the own body that say more of a marker than its partner does."""

STILL = 0.25
"""A witness whose markers move against each other by less than this part of what the clip's do
tells nothing of what moves with what."""

BESIDE = 120.0
"""mm. How near are the visible markers that tell it instead."""

STAND_INS = 5
"""Visible markers nearby, at most, that stand in for the missing one to find out how well it is
predicted where there is no other body to tell."""

LEAST_DEVIATION = 0.1
"""mm. No marker is measured better."""

CHUNK = 500
"""Frames predicted at a time."""

UNTOLD = 100.0
"""mm. Expected error where nothing tells it."""

VIEWS = (
    View("rigid", 160.0, 0.002),
    View("rigid", 220.0, 0.005, 10.0),
    View("heading", 220.0, 0.005, 10.0),
)
"""How poses are aligned and visible markers weighted."""


@dataclass(frozen=True)
class Kin:
    """What bodies have in common: a kernel for rows of several bodies.

    The covariance of two rows with features f, f' is ``1 + k + b (offset + movement k)`` with
    ``k = linear f . f' + radial exp(-|f - f'|² / 2 length²)``, and b what their bodies share:
    ``shape exp(-|d|² / 2 reach²) + image [same body, in a mirror or not] + rest [same]``, d the
    difference of their shapes; the three parts sum to 1.

    Attributes
    ----------
    linear, radial, length : float
        As in `priorfill.regression.Kernel`.
    offset, movement : float
        Variance of what a body is off by, and how much of k is its own.
    shape, image : float
        Parts of that which are shared by bodies of the same shape, and by a body and its image.
    reach : float
        mm; how similar shapes are that share much.
    noise : float
        Variance that rows do not share with anything.
    """

    linear: float
    radial: float
    length: float
    offset: float
    movement: float
    shape: float
    image: float
    reach: float
    noise: float

    def similarity(
        self, product: NDArray[np.float64], square: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return k of poses by inner product and squared distance of their features."""
        result: NDArray[np.float64] = self.linear * product
        result += self.radial * np.exp(-0.5 / self.length**2 * square)
        return result

    def shared(
        self,
        shapes: NDArray[np.float64],
        body: NDArray[np.intp],
        mirrored: NDArray[np.bool_],
    ) -> NDArray[np.float64]:
        """Return b of each pair of witnesses."""
        square = ((shapes[:, None] - shapes) ** 2).sum(axis=2)
        one = body[:, None] == body
        same = one & (mirrored[:, None] == mirrored)
        rest = 1.0 - self.shape - self.image
        result: NDArray[np.float64] = self.shape * np.exp(-0.5 / self.reach**2 * square)
        result += self.image * one + rest * same
        return result


KINDS = (
    Kin(1.0, 1.0, 0.6, 0.2, 0.2, 0.75, 0.20, 30.0, 0.1),
    Kin(0.1, 2.0, 0.6, 0.2, 0.2, 0.80, 0.10, 30.0, 0.1),
)
"""Members: each view with each of these. Chosen on 92 markers taken out of takes of other people;
members that trust the mirror image more do no better."""


def partners(task: Task) -> NDArray[np.intp]:
    """Return the mirror partner of each marker of a task [shape=(markers,)]; -1 for none."""
    index = {label: i for i, label in enumerate(task.labels)}
    mirror = task.marker_set.mirror
    return np.array([index.get(mirror.get(label, ""), -1) for label in index], dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Witness:
    """A body that is seen with the missing markers, from one side.

    Attributes
    ----------
    body : int
        Number of the body; `OWN` for the clip's.
    mirrored : bool
        Whether it is seen in a mirror.
    visible : ndarray [shape=(poses, visible markers, 3), mm]
        Upright.
    missing : ndarray [shape=(poses, missing markers, 3), mm]
        What is to be predicted of the clip.
    takes : tuple of str
        The recordings.
    """

    body: int
    mirrored: bool
    visible: NDArray[np.float64]
    missing: NDArray[np.float64]
    takes: tuple[str, ...] = ()


OWN = -1
"""Number of the clip's own body."""


@dataclass(frozen=True, eq=False)
class Told:
    """What witnesses say of missing markers.

    Attributes
    ----------
    positions : ndarray [shape=(poses, missing markers, 3), mm]
        Upright.
    deviation : ndarray [shape=(poses, missing markers), mm]
        Expected rms Euclidean error.
    how : str
        Which witnesses.
    takes : tuple of str
        Recordings learnt from.
    """

    positions: NDArray[np.float64]
    deviation: NDArray[np.float64]
    how: str
    takes: tuple[str, ...]


def _evenly(count: int, most: int) -> NDArray[np.intp]:
    """Return up to ``most`` indices below ``count``, evenly spread."""
    some: NDArray[np.intp] = np.linspace(0, count - 1, min(most, count)).astype(np.intp)
    return some


@dataclass(frozen=True, eq=False)
class _Sample:
    """A few poses of a take, or of the clip itself."""

    take: int  # -1 for the clip
    body: int
    poses: NDArray[np.float64]  # (poses, all markers, 3)


class Dropouts:
    """Predicts the markers of one task that its clip hardly shows.

    Parameters
    ----------
    task : Task
        The clip and the takes to learn from.
    """

    def __init__(self, task: Task) -> None:
        self.task = task
        self._partner = partners(task)

    def nearest_visible(
        self, markers: NDArray[np.intp], visible: NDArray[np.intp]
    ) -> NDArray[np.intp]:
        """Choose the visible markers to predict by, the nearest first.

        Parameters
        ----------
        markers : ndarray of int
            What is missing.
        visible : ndarray of int
            Markers seen where they are to be predicted.
        """
        samples = self._witnessing(markers)
        if not samples:
            return visible[:0]
        having = np.array([~np.isnan(s.poses[..., 0]).all(axis=0) for s in samples])
        often = having[:, visible].mean(axis=0) >= OFTEN
        distance = _distances(samples, markers)[0].min(axis=0)
        usable = visible[often & np.isfinite(distance[visible])]
        image = self._mirror(self.task.positions)
        shown = image[_whole(image[:, markers])]
        if len(shown) and not self._moves(markers, usable):
            # what the image does not show would cost it: the image of a partner is what is missing
            usable = usable[~np.isnan(shown[:, usable, 0]).all(axis=0)]
        nearest: NDArray[np.intp] = usable[np.argsort(distance[usable], kind="stable")]
        return nearest[:VISIBLE]

    def _moves(self, markers: NDArray[np.intp], visible: NDArray[np.intp]) -> bool:
        """Whether other recordings of the clip's body show some markers moving."""
        own = [
            _Sample(s.take, s.body, s.poses[_whole(s.poses[:, markers])])
            for s in self._samples
            if s.take < 0 or s.take in self._same_body
        ]
        if sum(len(s.poses) for s in own) < FEW_POSES:
            return False
        there, here = (_distances(some, visible)[1][:, visible] for some in (own, self._samples))
        known = np.isfinite(there)
        return bool(known.any() and there[known].mean() >= STILL * here[known].mean())

    def predict(
        self,
        markers: NDArray[np.intp],
        visible: NDArray[np.intp],
        frames: NDArray[np.intp],
    ) -> Told | None:
        """Predict missing markers from witnesses; None where there is none.

        Parameters
        ----------
        markers : ndarray of int
            What is missing.
        visible : ndarray of int
            The markers to predict by, from `nearest_visible`.
        frames : ndarray of int
            Frames of the clip in which those are seen.
        """
        if len(visible) < FEWEST_VISIBLE:
            return None
        witnesses, ties = self._witnesses(markers, visible)
        if not witnesses:
            return None
        query = self.task.positions[np.ix_(frames, visible)]
        judged = any(w.body != OWN for w in witnesses)
        errors = None if judged else self._stand_in_errors(markers, visible)
        positions, deviation = testify(witnesses, query, ties, errors)
        return Told(
            positions,
            deviation,
            _how(witnesses),
            tuple(dict.fromkeys(name for w in witnesses for name in w.takes)),
        )

    @cached_property
    def _takes(self) -> list[int]:
        """Takes that are looked at: the companions, and some of the database's."""
        takes = self.task.takes
        companions = [i for i, take in enumerate(takes) if take.companion]
        others = [i for i, take in enumerate(takes) if not take.companion]
        return companions + [others[i] for i in _evenly(len(others), EXAMPLES)]

    @cached_property
    def _samples(self) -> list[_Sample]:
        """A few poses of the clip, of its companions and of takes of the database."""
        task = self.task
        numbers: dict[str, int] = {}
        # every other frame, say, of the clip: what few frames show a marker are all looked at
        rare = task.valid.any(axis=0) & (task.valid.sum(axis=0) < OWN_ROWS)
        some = np.union1d(
            _evenly(len(task.positions), OWN_ROWS),
            np.flatnonzero(task.valid[:, rare].any(axis=1)),
        )
        samples = [_Sample(-1, OWN, task.positions[some])]
        for i in self._takes:
            take = task.takes[i]
            body = OWN
            if not take.companion:
                body = numbers.setdefault(take.subject or f"\0{i}", len(numbers))
            level = take.nearest_level(RATE)
            at = _evenly(take.lengths[level], SAMPLED)
            samples.append(_Sample(i, body, take.positions(level)[at].astype(np.float64)))
        return samples

    @cached_property
    def _same_body(self) -> frozenset[int]:
        """Takes that are of the clip's own body: companions, and what is of the same shape."""
        task, first = self.task, self._samples[0]
        markers = np.arange(len(task.labels))
        spread = _distances(self._samples, markers)[1]
        one, other = np.triu_indices(len(markers), 1)
        spread = spread[one, other]
        mine = _median_distances(first.poses, one, other)
        found = []
        for sample in self._samples[1:]:
            take = task.takes[sample.take]
            differ = np.abs(_median_distances(sample.poses, one, other) - mine)
            known = np.flatnonzero(~np.isnan(differ))
            shared = np.unique([one[known], other[known]])
            firm = known[np.argsort(spread[known], kind="stable")][: FIRM_PAIRS * len(shared)]
            named = take.subject != "" and take.subject == task.subject
            most = SAME_NAME if named else SAME_BODY
            if take.companion or (len(firm) and np.median(differ[firm]) <= most):
                found.append(sample.take)
        return frozenset(found)

    def _mirror(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return poses of all markers in a mirror; NaN for markers without a partner."""
        image = poses[:, self._partner] * [-1.0, 1.0, 1.0]
        image[:, self._partner < 0] = np.nan
        return image

    def _witnessing(self, markers: NDArray[np.intp]) -> list[_Sample]:
        """Return the samples that show some markers, in a mirror if need be."""
        return [
            _Sample(sample.take, sample.body, poses)
            for sample in self._samples
            for poses in (sample.poses, self._mirror(sample.poses))
            if _whole(poses[:, markers]).any()
        ]

    def _witnesses(
        self, markers: NDArray[np.intp], visible: NDArray[np.intp]
    ) -> tuple[list[Witness], Ties]:
        """Return who can speak for some markers, and how these are tied to the visible ones."""
        ties = self._ties(markers, visible)
        here = self.task.positions[:, visible]
        shape = ties.shape(here[_whole(here)])
        away: dict[int, float] = {}  # by take
        for sample in self._samples:
            seen = sample.poses[:, visible]
            seen = seen[_whole(seen)]
            if sample.take >= 0 and len(seen):
                away[sample.take] = float(np.linalg.norm(ties.shape(seen) - shape))
        own = [i for i in away if i in self._same_body]
        people: dict[int, list[int]] = {}
        for sample in self._samples:
            if sample.take in away and sample.take not in own:
                people.setdefault(sample.body, []).append(sample.take)
        nearest = sorted(people, key=lambda body: (min(away[i] for i in people[body]), body))

        witnesses = self._own_witnesses(own, markers, visible, self._shown(markers))
        for body in nearest[:BODIES]:
            some = sorted(people[body], key=lambda i: (away[i], i))[:TAKES]
            witnesses += self._read(some, body, markers, visible)
        return witnesses, ties

    def _ties(self, markers: NDArray[np.intp], visible: NDArray[np.intp]) -> Ties:
        """Return how some markers are tied to visible ones, by whoever shows them."""
        witnessing = self._witnessing(markers)
        distances, spreads = _distances(witnessing, markers)
        distance, spread = distances.min(axis=0)[visible], spreads.min(axis=0)[visible]
        inner = _distances(self._samples, visible)[1][:, visible]
        moved = _distances(witnessing, visible)[1][:, visible]
        if np.nanmean(moved[np.isfinite(moved)]) < STILL * inner[np.isfinite(inner)].mean():
            # who stands still does not show what moves with what; the markers beside it do
            beside = np.exp(-0.5 * (distance / BESIDE) ** 2) * (1.0 - np.eye(len(visible)))
            spread = np.maximum(spread, (beside * inner).sum(axis=1) / beside.sum(axis=1))
        return Ties(distance, spread, inner)

    def _own_witnesses(
        self,
        takes: Sequence[int],
        markers: NDArray[np.intp],
        visible: NDArray[np.intp],
        frames: NDArray[np.intp],
    ) -> list[Witness]:
        """Return the clip's own body in some frames, and its mirror image, as witnesses."""
        task = self.task
        columns = np.concatenate([visible, markers])
        parts, names = [task.positions[np.ix_(frames, columns)]], [task.name]
        for i in takes:
            # what is measured, not what is left of it at a lower rate: there may be little
            parts.append(task.takes[i].positions(0, columns).astype(np.float64))
            names.append(task.takes[i].name)
        rows = [part[_whole(part)] for part in parts]
        rows = [part[_evenly(len(part), OWN_ROWS)] for part in rows]
        told = tuple(name for name, part in zip(names, rows, strict=True) if len(part))
        seen = np.concatenate(rows)
        seen = seen[_evenly(len(seen), OWN_ROWS)]
        image = self._mirror(task.positions)[:, columns]
        image = image[_whole(image)]
        image = image[_evenly(len(image), IMAGE_ROWS)]
        count = len(visible)
        found = []
        if len(seen):
            found.append(Witness(OWN, False, seen[:, :count], seen[:, count:], told))
        if len(image):
            found.append(Witness(OWN, True, image[:, :count], image[:, count:], (task.name,)))
        return found

    def _read(
        self,
        takes: Sequence[int],
        body: int,
        markers: NDArray[np.intp],
        visible: NDArray[np.intp],
    ) -> list[Witness]:
        """Return a body of the database as witness, and its mirror image."""
        columns = np.concatenate([visible, markers])
        partner = self._partner[columns]
        count = len(visible)
        found = []
        for mirrored, wanted in ((False, columns), (True, partner)):
            if (wanted < 0).any():
                continue
            parts, names = [], []
            for i in takes:
                take = self.task.takes[i]
                poses = take.positions(take.nearest_level(RATE), wanted).astype(np.float64)
                poses = poses[_whole(poses)]
                if len(poses):
                    parts.append(poses)
                    names.append(take.name)
            if parts:
                rows = np.concatenate(parts)
                rows = rows[_evenly(len(rows), ROWS)]
                if mirrored:
                    rows = rows * [-1.0, 1.0, 1.0]
                found.append(
                    Witness(body, mirrored, rows[:, :count], rows[:, count:], tuple(names))
                )
        return found

    def _stand_in_errors(
        self, markers: NDArray[np.intp], visible: NDArray[np.intp]
    ) -> NDArray[np.float64]:
        """Return the error (mm) of each member for visible markers nearby.

        They are predicted as the missing ones are: from the same frames, companions, and in the
        mirror.
        """
        frames, same_body = self._shown(markers), sorted(self._same_body)
        squares = []
        for marker in visible[:STAND_INS]:
            alone, others = np.array([marker]), visible[visible != marker]
            if len(others) < FEWEST_VISIBLE:
                continue
            found = self._own_witnesses(same_body, alone, others, frames)
            if all(w.mirrored for w in found) and self._partner[marker] == marker:
                continue  # a marker in the middle is its own image
            truth = self.task.positions[:, np.concatenate([others, alone])]
            truth = truth[_whole(truth)]
            truth = truth[_evenly(len(truth), IMAGE_ROWS)]
            if found and len(truth):
                told = _all_members(found, truth[:, :-1], self._ties(alone, others), UNTOLD)
                off = told.positions[:, :, 0] - truth[:, -1]
                squares.append((off**2).sum(axis=2).mean(axis=1))
        if not squares:
            return np.full(len(VIEWS) * len(KINDS), UNTOLD)
        errors: NDArray[np.float64] = np.sqrt(np.mean(squares, axis=0))
        return errors

    def _shown(self, markers: NDArray[np.intp]) -> NDArray[np.intp]:
        """Return the frames of the clip in which some markers are seen."""
        frames: NDArray[np.intp] = np.flatnonzero(self.task.valid[:, markers].all(axis=1))
        return frames


def _whole(poses: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which poses have all of their markers."""
    whole: NDArray[np.bool_] = np.logical_and.reduce(~np.isnan(poses[..., 0]), axis=1)
    return whole


def _median_distances(
    poses: NDArray[np.float64], one: NDArray[np.intp], other: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Return the median distance of pairs of markers [shape=(pairs,), mm]; NaN where unknown."""
    between = np.sort(np.linalg.norm(poses[:, one] - poses[:, other], axis=2), axis=0)  # NaN last
    count = (~np.isnan(between)).sum(axis=0)
    median: NDArray[np.float64] = between[np.maximum(count - 1, 0) // 2, np.arange(len(one))]
    return median


def _distances(
    samples: Sequence[_Sample], markers: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return rms distances of some markers to all, and their standard deviation in a take.

    Both have shape (markers, all markers); infinite where no sample shows a pair.
    """
    total = samples[0].poses.shape[1] if samples else 0
    count = np.zeros((len(markers), total))
    square, varied = np.zeros_like(count), np.zeros_like(count)
    for sample in samples:
        poses = sample.poses
        between = np.linalg.norm(poses[:, markers, None] - poses[:, None], axis=3)
        known = ~np.isnan(between)
        between = np.where(known, between, 0.0)
        here = known.sum(axis=0)
        mean = between.sum(axis=0) / np.maximum(here, 1)
        count += here
        square += (between**2).sum(axis=0)
        varied += np.where(known, (between - mean) ** 2, 0.0).sum(axis=0)
    unknown = count == 0
    count[unknown] = 1.0
    return (
        np.where(unknown, np.inf, np.sqrt(square / count)),
        np.where(unknown, np.inf, np.sqrt(varied / count)),
    )


@dataclass(frozen=True, eq=False)
class Ties:
    """How the missing markers are tied to the visible ones.

    Attributes
    ----------
    distance, spread : ndarray [shape=(visible markers,), mm]
        Rms distance of each visible marker to the nearest missing one, and how much it varies.
    inner : ndarray [shape=(visible markers, visible markers), mm]
        How much the distances of the visible ones vary.
    """

    distance: NDArray[np.float64]
    spread: NDArray[np.float64]
    inner: NDArray[np.float64]

    def shape(self, visible: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what tells one body from another: its mean distances, weighted.

        The difference of two of them has the length of the rms difference (mm) of the distances,
        those counting most that vary least and are near the missing markers.
        """
        one, other = np.triu_indices(len(self.distance), 1)
        near = np.exp(-0.25 * (self.distance / SHAPE_REACH) ** 2)
        weight = near[one] * near[other] / (1.0 + (self.inner[one, other] / FIRM) ** 2)
        weight /= weight.sum()
        between = np.linalg.norm(visible[:, one] - visible[:, other], axis=2).mean(axis=0)
        result: NDArray[np.float64] = np.sqrt(weight) * between
        return result


@dataclass(frozen=True, eq=False)
class _Members:
    """What all members predict."""

    positions: NDArray[np.float64]  # (members, poses, missing, 3)
    variance: NDArray[np.float64]  # (members, poses, missing)
    errors: NDArray[np.float64]  # (members,)


def testify(
    witnesses: Sequence[Witness],
    query: NDArray[np.float64],
    ties: Ties,
    errors: NDArray[np.float64] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Predict missing markers from witnesses.

    Parameters
    ----------
    witnesses : sequence of Witness
        At least one.
    query : ndarray [shape=(poses, visible markers, 3), mm]
        The clip's visible markers.
    ties : Ties
        Of the missing markers and the visible ones.
    errors : ndarray [shape=(members,), mm], optional
        Expected error of each member; without it, it is told by leaving other bodies out.

    Returns
    -------
    positions : ndarray [shape=(poses, missing markers, 3), mm]
        Upright.
    deviation : ndarray [shape=(poses, missing markers), mm]
        Expected rms Euclidean error.
    """
    told = _all_members(witnesses, query, ties, errors)
    error = np.maximum(told.errors, 1e-9)
    share = (error.min() / error) ** SELECTION_POWER
    share /= share.sum()
    mean = np.einsum("k,kqmi->qmi", share, told.positions)
    variance = told.variance + ((told.positions - mean) ** 2).sum(axis=3)
    deviation = np.sqrt(np.einsum("k,kqm->qm", share, variance))
    return mean, np.maximum(deviation, LEAST_DEVIATION)


def _all_members(
    witnesses: Sequence[Witness],
    query: NDArray[np.float64],
    ties: Ties,
    errors: NDArray[np.float64] | float | None,
) -> _Members:
    """Predict by all members; parameters as for `testify`."""
    rows = _Rows.of(witnesses, query, ties)
    found = [
        member for view in VIEWS for member in _predict(view, rows, query, ties, errors is None)
    ]
    positions, variances, judged = zip(*found, strict=True)
    variance = np.stack(variances)
    if errors is None:
        return _Members(np.stack(positions), variance, np.array(judged))
    told = np.broadcast_to(errors, len(found)).astype(np.float64)
    return _Members(
        np.stack(positions), np.broadcast_to(told[:, None, None] ** 2, variance.shape), told
    )


@dataclass(frozen=True, eq=False)
class _Rows:
    """The poses of all witnesses."""

    visible: NDArray[np.float64]  # (rows, visible, 3)
    missing: NDArray[np.float64]  # (rows, missing, 3)
    witness: NDArray[np.intp]  # (rows,) whose
    body: NDArray[np.intp]  # (witnesses and the clip,)
    mirrored: NDArray[np.bool_]  # (witnesses and the clip,)
    shapes: NDArray[np.float64]  # (witnesses and the clip, pairs)

    @classmethod
    def of(cls, witnesses: Sequence[Witness], query: NDArray[np.float64], ties: Ties) -> _Rows:
        # one body has one shape, whatever its takes show
        shapes = [
            ties.shape(query if w.body == OWN and not w.mirrored else w.visible) for w in witnesses
        ]
        return cls(
            np.concatenate([w.visible for w in witnesses]),
            np.concatenate([w.missing for w in witnesses]),
            np.repeat(np.arange(len(witnesses)), [len(w.visible) for w in witnesses]),
            np.array([*(w.body for w in witnesses), OWN]),
            np.array([*(w.mirrored for w in witnesses), False]),
            np.array([*shapes, ties.shape(query)]),
        )

    @property
    def own(self) -> NDArray[np.bool_]:
        """Which rows are of the clip's own body, and not in a mirror."""
        own: NDArray[np.bool_] = (self.body == OWN)[self.witness] & ~self.mirrored[self.witness]
        return own

    def blocks(self) -> list[NDArray[np.intp]]:
        """Rows of each other body; its image stays if the clip has one to learn from."""
        others = self.body[:-1] != OWN
        seen_in_mirror = bool(np.any(~others & self.mirrored[:-1]))
        blocks = []
        for number in np.flatnonzero(others):
            same = np.flatnonzero(self.body[:-1] == self.body[number])
            if seen_in_mirror:
                same = np.array([number])
            elif number != same[0]:
                continue  # done with the other side
            blocks.append(np.flatnonzero(np.isin(self.witness, same)))
        return blocks


_Member = tuple[NDArray[np.float64], NDArray[np.float64], float]
"""Position and variance (poses, missing) that a member predicts, and its left-out error."""


def _predict(
    view: View, rows: _Rows, query: NDArray[np.float64], ties: Ties, judge: bool
) -> list[_Member]:
    """Predict by the members of one view; ``judge`` them by leaving bodies out, too."""
    nearness = np.exp(-0.5 * (ties.distance / view.reach) ** 2)
    firmness = np.ones_like(nearness)
    if view.slack is not None:
        firmness = 1.0 / (1.0 + (ties.spread / view.slack) ** 2)
    alignment = nearness * firmness + ALIGNMENT_FLOOR
    weight = nearness * np.sqrt(firmness) + view.floor
    align = rigid_frames if view.frame == "rigid" else heading_frames
    template = query[len(query) // 2]
    row_frames = align(rows.visible, template, alignment)
    query_frames = align(query, template, alignment)

    known = (row_frames.to_local(rows.visible) * weight[:, None]).reshape(len(rows.visible), -1)
    asked = (query_frames.to_local(query) * weight[:, None]).reshape(len(query), -1)
    middle = known.mean(axis=0)
    known, asked = known - middle, asked - middle
    scale = float(np.sqrt((known**2).sum(axis=1).mean())) or 1.0
    known, asked = known / scale, asked / scale
    targets = row_frames.to_local(rows.missing).reshape(len(known), -1)
    # the own body, where it is a witness, is what others are compared with
    centre = (targets[rows.own] if rows.own.any() else targets).mean(axis=0)
    targets = targets - centre

    product = known @ known.T
    norm = np.diag(product)
    square = np.maximum(norm[:, None] + norm - 2.0 * product, 0.0)
    blocks = rows.blocks() if judge else []
    markers = targets.shape[1] // 3
    members = []
    for kin in KINDS:
        shared = kin.shared(rows.shapes, rows.body, rows.mirrored)
        alike = kin.similarity(product, square)
        covariance = 1.0 + alike
        covariance += shared[np.ix_(rows.witness, rows.witness)] * (
            kin.offset + kin.movement * alike
        )
        noise = kin.noise * np.where(rows.own, OWN_NOISE, 1.0)
        covariance[np.diag_indices_from(covariance)] += noise
        inverse = np.linalg.inv(covariance).astype(np.float64, copy=False)
        coefficients = inverse @ targets
        local = np.empty((len(asked), targets.shape[1]))
        left = np.empty(len(asked))
        for start in range(0, len(asked), CHUNK):
            some = slice(start, start + CHUNK)
            cross_product = asked[some] @ known.T
            length = (asked[some] ** 2).sum(axis=1)
            cross_square = np.maximum(length[:, None] + norm - 2.0 * cross_product, 0.0)
            alike = kin.similarity(cross_product, cross_square)
            cross = 1.0 + alike + shared[-1][rows.witness] * (kin.offset + kin.movement * alike)
            itself = kin.linear * length + kin.radial
            local[some] = cross @ coefficients
            left[some] = 1.0 + itself + kin.offset + kin.movement * itself
            left[some] -= np.einsum("qr,qr->q", cross @ inverse, cross)
        least = float(noise.min())
        left = np.maximum(left + least, least)
        positions = query_frames.to_world((local + centre).reshape(-1, markers, 3))
        unit, missed = np.ones(markers), np.nan
        if judge:
            unit, missed = _judge(inverse, targets, blocks, markers)
        members.append((positions, left[:, None] * unit, missed))
    return members


def _judge(
    inverse: NDArray[np.float64],
    targets: NDArray[np.float64],
    blocks: Sequence[NDArray[np.intp]],
    markers: int,
) -> tuple[NDArray[np.float64], float]:
    """Leave bodies out: what a unit of variance is in mm², by marker, and the rms error in mm."""
    residuals, variance = block_residuals(inverse, targets, blocks)
    judged = np.concatenate(blocks)
    square = (residuals[judged].reshape(len(judged), markers, 3) ** 2).sum(axis=2)
    unit = (square / variance[judged][:, None]).mean(axis=0)
    return unit, float(np.sqrt(square.mean()))


def _how(witnesses: Sequence[Witness]) -> str:
    """Say who the witnesses are."""
    said = {
        "other recordings of the same body": lambda w: w.body == OWN and not w.mirrored,
        "the clip's mirror image": lambda w: w.body == OWN and w.mirrored,
        "the database's bodies": lambda w: w.body != OWN,
    }
    return ", ".join(name for name, holds in said.items() if any(map(holds, witnesses)))
