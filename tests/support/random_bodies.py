"""Bodies of nine markers with random poses, and tasks whose takes are such bodies."""

from __future__ import annotations

import numpy as np

from priorfill.gaps import gap_groups
from priorfill.markers.marker_set import MarkerSet
from priorfill.methods.task import Task
from priorfill.search.takes import own_take
from priorfill.signal.resample import pyramid

__all__ = ["LABELS", "body", "task_of"]

LABELS = tuple(f"M{i}" for i in range(9))


def body(seed: int, frames: int) -> np.ndarray:
    """Nine markers relative to a moving root; the first four are rigid."""
    rng = np.random.default_rng(seed)
    shape = np.random.default_rng(99).uniform(-300.0, 300.0, (9, 3))
    local = np.repeat(shape[None], frames, axis=0)
    local[:, 4:] += 80.0 * rng.normal(size=(frames, 5, 3))
    angle = np.cumsum(0.05 * rng.normal(size=frames)) + seed
    where = np.cumsum(5.0 * rng.normal(size=(frames, 1, 3)), axis=0)
    turn = np.zeros((frames, 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
    turn[:, 0, 1], turn[:, 1, 0] = np.sin(angle), -np.sin(angle)
    turn[:, 2, 2] = 1.0
    return local @ turn + where


def _marker_set(reliable: set[int]) -> MarkerSet:
    return MarkerSet(
        name="test",
        labels=LABELS,
        mirror={},
        segment={x: "pelvis" if i < 4 else f"other{i}" for i, x in enumerate(LABELS)},
        reliable={x: i in reliable for i, x in enumerate(LABELS)},
        root_segments=("pelvis",),
    )


def task_of(positions: np.ndarray, others: list[np.ndarray], reliable: set[int]) -> Task:
    takes = tuple(
        own_take(pyramid(other, 30.0, 1), f"take {i}", "") for i, other in enumerate(others)
    )
    groups = tuple(gap_groups(np.isnan(positions[..., 0])))
    return Task(positions, LABELS, 30.0, _marker_set(reliable), groups, takes)
