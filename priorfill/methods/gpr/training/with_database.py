"""A lesson that other recordings share with the clip: poses of other bodies beside its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.poses import evenly_spaced
from priorfill.gp.data import Lesson, Rows
from priorfill.methods.gpr.gap_segments import FEWEST_VISIBLE
from priorfill.methods.gpr.options import GPROptions
from priorfill.methods.gpr.pose_search import OWN_BODY, PoseSearch
from priorfill.methods.gpr.training.lagged_poses import standing_in
from priorfill.methods.gpr.training.own_clip import (
    IMAGE,
    OWN,
    VELOCITY_SECONDS,
    OwnLesson,
)
from priorfill.methods.gpr.training.subject_correlation import (
    MIRROR_KINSHIP,
    STRANGER_KINSHIP,
    SYNTHESISED_KINSHIP,
)
from priorfill.methods.gpr.training.subject_offsets import shifts
from priorfill.methods.task import Task, take_names
from priorfill.search.bank import PoseBank

__all__ = ["shared_lesson"]

MOVEMENT_RATE = 15.0
"""Hz. Resolution of the database's poses that stand beside the clip's own: of as many rows, more
different ones."""

SELF_SUFFICIENT = 4.0
"""s. A clip that shows the missing markers for longer is less in need of other bodies."""

HANDICAP = 0.1
"""By how much better other bodies must do for each doubling of that; by how much worse they may do
where it is half as long or less, for then few blocks can be left out to tell."""


def shared_lesson(
    own: OwnLesson, task: Task, search: PoseSearch, options: GPROptions
) -> tuple[Lesson, tuple[str, ...]] | None:
    """Make a lesson of the clip and the database together; None where that shows too little.

    Parameters
    ----------
    own : OwnLesson
        With moments, and with the mirror image's poses where there are any.
    task : Task
        The clip and the takes to learn from.
    search : PoseSearch
        Of these takes.
    options : GPROptions
        How many rows.

    Returns
    -------
    lesson : Lesson
    takes : tuple of str
        Recordings of the database in it.
    """
    if not task.takes:
        return None
    lesson, piece, rate = own.lesson, own.piece, task.rate
    kept = np.flatnonzero(search.shown_with(piece.markers)[own.visible])
    markers = own.visible[kept]
    root = task.root_among(markers)
    if len(kept) < FEWEST_VISIBLE or root is None:
        return None
    needed = np.concatenate([piece.markers, markers])
    bank = search.bank(root, markers[: options.visible], needed, MOVEMENT_RATE)
    if len(bank) < options.fewest_rows:
        return None

    own_rows, image_rows, gap_rows, other_rows = options.shared_rows
    clip, image = (np.flatnonzero(lesson.rows.take == take) for take in (OWN, IMAGE))
    frames = np.round(lesson.rows.time * rate).astype(np.intp)
    beside = clip[np.isin(frames[clip], own.near)]
    clip = np.union1d(beside, clip[evenly_spaced(len(clip), own_rows)])
    image = image[evenly_spaced(len(image), image_rows)]
    here, asked = lesson.rows.visible[:, kept], lesson.query.visible[:, kept]
    chosen = search.nearest(bank, root, markers, asked)[:gap_rows]
    more = search.nearest(bank, root, markers, here[clip])
    chosen = np.concatenate([chosen, more[~np.isin(more, chosen)][:other_rows]])
    there = bank.positions(chosen, markers)
    some = np.concatenate([clip, image])
    body = search.bodies[bank.take(chosen)]
    frames_here, frames_there = (
        root.frames(search.placed(markers, poses)) for poses in (here[some], there)
    )
    local = shifts(frames_here.to_local(here[some]), frames_there.to_local(there), body)
    kin = body == OWN_BODY  # other clips of the same person: nothing is constantly off
    local[kin] = 0.0
    shift = local @ np.swapaxes(frames_there.rotation, 1, 2)
    there = there + shift

    rates = bank.rates(chosen)
    around = {}
    for seconds, now in lesson.rows.around.items():
        steps = seconds * rates
        if np.round(steps).any():  # a coarse resolution does not show short moments
            moved = [_moved(bank, chosen, markers, d) + shift for d in (-steps, steps)]
            moment = [now[:, some][:, :, kept], standing_in(there, *moved)]
            around[seconds] = np.concatenate(moment, axis=1)
    moving = None
    if lesson.rows.moving is not None:
        steps = VELOCITY_SECONDS * rates
        before, after = standing_in(
            bank.positions(chosen, piece.markers),
            *(_moved(bank, chosen, piece.markers, d) for d in (-steps, steps)),
        )
        moving = np.concatenate(
            [lesson.rows.moving[some], (after - before) / (2.0 * VELOCITY_SECONDS)]
        )
    # as takes, so bodies: OWN and IMAGE are the clip and its mirror image
    numbers = np.where(kin, OWN, IMAGE + 1 + body)
    kinship = np.repeat([1.0, MIRROR_KINSHIP], [len(clip), len(image)])
    placed = np.array([take.virtual_markers for take in task.takes])[bank.take(chosen)]
    strange = np.where(placed, SYNTHESISED_KINSHIP, STRANGER_KINSHIP)
    take = lesson.rows.take[some]
    rows = Rows(
        np.concatenate([here[some], there]),
        np.concatenate([lesson.rows.missing[some], bank.positions(chosen, piece.markers)]),
        np.concatenate([lesson.rows.time[some], chosen / rates]),
        np.concatenate([take, IMAGE + 1 + bank.take(chosen)]),
        np.concatenate([kinship, np.where(kin, 1.0, strange)]),
        np.concatenate([take, numbers]),
        around,
        moving,
    )
    query = replace(lesson.query, visible=asked)
    around_queries = None if lesson.surroundings is None else lesson.surroundings.among(kept)
    shown = np.logical_and.reduce(task.valid[:, piece.markers], axis=1).sum() / rate
    handicap = 1.0 + HANDICAP * max(-1.0, float(np.log2(shown / SELF_SUFFICIENT)))
    distance, spread = lesson.distance[kept], lesson.spread[kept]
    names = take_names(task.takes, bank.take(chosen))
    return Lesson(rows, query, distance, spread, handicap, around_queries), names


def _moved(
    bank: PoseBank, rows: NDArray[np.intp], markers: NDArray[np.intp], steps: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return markers so many frames after rows of a bank, between frames on the line."""
    near = np.trunc(steps).astype(np.intp)
    rest = np.abs(steps - near)[:, None, None]
    at = bank.moved(rows, near)
    beyond = bank.moved(at, np.sign(steps).astype(np.intp))
    moved: NDArray[np.float64] = bank.positions(at, markers)
    between = (rest > 0.0)[:, 0, 0]
    moved[between] += rest[between] * (bank.positions(beyond[between], markers) - moved[between])
    return moved
