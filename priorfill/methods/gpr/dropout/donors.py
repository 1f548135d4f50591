"""Witnesses of missing markers: who they are, and what they show of the visible markers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.mirror import mirrored, reflected
from priorfill.geometry.poses import complete_poses, evenly_spaced, sample_complete_poses
from priorfill.methods.gpr.dropout.marker_coupling import Ties
from priorfill.methods.gpr.dropout.subjects import (
    OWN,
    OWN_ROWS,
    RATE,
    Bodies,
    Sample,
)
from priorfill.methods.task import Task

__all__ = ["IMAGE_ROWS", "Witness", "Witnesses", "said_by"]

VISIBLE = 12
"""Visible markers that a missing one is predicted by, the nearest ones."""

BODIES = 16
"""Other bodies learnt from, those of the most similar shape."""

TAKES = 6
"""Takes of each."""

ROWS = 20
"""Poses of each other body, and as many of its mirror image."""

IMAGE_ROWS = 60
"""Poses of its mirror image."""

OFTEN = 0.5
"""Visible markers that fewer of the witnesses have are given up: a row must have all."""

FEW_POSES = 12
"""Poses of the own body that say more of a marker than its partner does."""

STILL = 0.25
"""A witness whose markers move against each other by less than this part of what the clip's do
tells nothing of what moves with what."""

BESIDE = 120.0
"""mm. How near are the visible markers that tell it instead."""

OWN_FRAMES = "the clip's own few frames"
OTHER_RECORDINGS = "other recordings of the same body"
OWN_IMAGE = "the clip's mirror image"
OTHER_BODIES = "the database's bodies"
"""What witnesses are called, in this order."""


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
    said : tuple of str
        What to call it in reports.
    """

    body: int
    mirrored: bool
    visible: NDArray[np.float64]
    missing: NDArray[np.float64]
    takes: tuple[str, ...] = ()
    said: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        body: int,
        mirrored: bool,
        rows: NDArray[np.float64],
        missing: int,
        takes: tuple[str, ...],
        *said: str,
    ) -> Witness:
        """Return a witness by its rows, whose last markers are the missing ones."""
        return cls(body, mirrored, rows[:, :-missing], rows[:, -missing:], takes, said)


class Witnesses:
    """Finds the witnesses of markers that the clip of a task hardly shows.

    Parameters
    ----------
    task : Task
        The clip and the takes to learn from.
    """

    def __init__(self, task: Task) -> None:
        self.task = task
        self.bodies = Bodies(task)

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
        samples = self.bodies.witnessing(markers)
        if not samples:
            return visible[:0]
        having = np.array([~np.isnan(s.poses[..., 0]).all(axis=0) for s in samples])
        often = having[:, visible].mean(axis=0) >= OFTEN
        distance = self.bodies.distances(markers, samples)[0].min(axis=0)
        usable = visible[often & np.isfinite(distance[visible])]
        image = mirrored(self.task.positions, self.bodies.contralateral)
        shown = image[complete_poses(image[:, markers])]
        if len(shown) and not self._moves(markers, usable):
            # what the image does not show would cost it: the image of a partner is what is missing
            usable = usable[~np.isnan(shown[:, usable, 0]).all(axis=0)]
        nearest: NDArray[np.intp] = usable[np.argsort(distance[usable], kind="stable")]
        return nearest[:VISIBLE]

    def _moves(self, markers: NDArray[np.intp], visible: NDArray[np.intp]) -> bool:
        """Whether other recordings of the clip's body show some markers moving."""
        own = [
            Sample(s.take, s.body, s.poses[complete_poses(s.poses[:, markers])])
            for s in self.bodies.samples
            if s.take < 0 or s.take in self.bodies.same_body
        ]
        if sum(len(s.poses) for s in own) < FEW_POSES:
            return False
        there, here = (self._inner(visible, some) for some in (own, self.bodies.samples))
        known = np.isfinite(there)
        return bool(known.any() and there[known].mean() >= STILL * here[known].mean())

    def _inner(self, visible: NDArray[np.intp], samples: Sequence[Sample]) -> NDArray[np.float64]:
        """Return how much the distances of visible markers vary in some samples."""
        return self.bodies.distances(visible, samples)[1][:, visible]

    def speaking_for(
        self, markers: NDArray[np.intp], visible: NDArray[np.intp]
    ) -> tuple[list[Witness], Ties]:
        """Return who can speak for some markers, and how these are tied to the visible ones."""
        ties = self.ties(markers, visible)
        here = self.task.positions[:, visible]
        shape = ties.shape(here[complete_poses(here)])
        away: dict[int, float] = {}  # by take
        for sample in self.bodies.samples:
            seen = sample.poses[:, visible]
            seen = seen[complete_poses(seen)]
            if sample.take >= 0 and len(seen):
                away[sample.take] = float(np.linalg.norm(ties.shape(seen) - shape))
        takes = self.task.takes
        own = [i for i in away if i in self.bodies.same_body]
        people: dict[int, list[int]] = {}
        for sample in self.bodies.samples:
            if sample.take in away and sample.take not in own:
                people.setdefault(sample.body, []).append(sample.take)
        placed = {  # markers placed on a skeleton speak where there are too few recordings
            body for body, some in people.items() if all(takes[i].virtual_markers for i in some)
        }
        nearest = sorted(
            people, key=lambda body: (body in placed, min(away[i] for i in people[body]), body)
        )

        witnesses = self.own(own, markers, visible, self.shown(markers))
        for body in nearest[:BODIES]:
            some = sorted(people[body], key=lambda i: (away[i], i))[:TAKES]
            witnesses += self._read(some, body, markers, visible)
        return witnesses, ties

    def ties(self, markers: NDArray[np.intp], visible: NDArray[np.intp]) -> Ties:
        """Return how some markers are tied to visible ones, by whoever shows them."""
        witnessing = self.bodies.witnessing(markers)
        distances, spreads = self.bodies.distances(markers, witnessing)
        distance, spread = distances.min(axis=0)[visible], spreads.min(axis=0)[visible]
        inner, moved = (self._inner(visible, some) for some in (self.bodies.samples, witnessing))
        if np.nanmean(moved[np.isfinite(moved)]) < STILL * inner[np.isfinite(inner)].mean():
            # who stands still does not show what moves with what; the markers beside it do
            beside = np.exp(-0.5 * (distance / BESIDE) ** 2) * (1.0 - np.eye(len(visible)))
            spread = np.maximum(spread, (beside * inner).sum(axis=1) / beside.sum(axis=1))
        return Ties(distance, spread, inner)

    def own(
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
        rows = [sample_complete_poses(part, OWN_ROWS) for part in parts]
        told = tuple(name for name, part in zip(names, rows, strict=True) if len(part))
        seen = np.concatenate(rows)
        seen = seen[evenly_spaced(len(seen), OWN_ROWS)]
        image = sample_complete_poses(
            mirrored(task.positions, self.bodies.contralateral)[:, columns], IMAGE_ROWS
        )
        found = []
        if len(seen):
            said = [OWN_FRAMES] if len(rows[0]) else []
            said += [OTHER_RECORDINGS] if any(map(len, rows[1:])) else []
            found.append(Witness.of(OWN, False, seen, len(markers), told, *said))
        if len(image):
            found.append(Witness.of(OWN, True, image, len(markers), (task.name,), OWN_IMAGE))
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
        found = []
        for image, wanted in ((False, columns), (True, self.bodies.contralateral[columns])):
            if (wanted < 0).any():
                continue
            parts, names = [], []
            for i in takes:
                take = self.task.takes[i]
                poses = take.positions(take.nearest_level(RATE), wanted).astype(np.float64)
                poses = poses[complete_poses(poses)]
                if len(poses):
                    parts.append(poses)
                    names.append(take.name)
            if parts:
                rows = np.concatenate(parts)
                rows = rows[evenly_spaced(len(rows), ROWS)]
                rows = reflected(rows) if image else rows
                told = tuple(names)
                found.append(Witness.of(body, image, rows, len(markers), told, OTHER_BODIES))
        return found

    def shown(self, markers: NDArray[np.intp]) -> NDArray[np.intp]:
        """Return the frames of the clip in which some markers are seen."""
        frames: NDArray[np.intp] = np.flatnonzero(self.task.valid[:, markers].all(axis=1))
        return frames


def said_by(witnesses: Sequence[Witness]) -> str:
    """Say who the witnesses are."""
    said = {name for witness in witnesses for name in witness.said}
    names = (OWN_FRAMES, OTHER_RECORDINGS, OWN_IMAGE, OTHER_BODIES)
    return ", ".join(name for name in names if name in said)
