"""Tasks with some of the markers of a task."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import wraps
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.gaps import gap_groups
from priorfill.geometry.distances import pair_statistics
from priorfill.markers.describe import describe_markers
from priorfill.methods.task import Estimate, Progress, Task, no_progress
from priorfill.search.takes import Take

__all__ = ["part_of_task", "seeing_only", "wanted_samples"]


def wanted_samples(task: Task) -> NDArray[np.bool_]:
    """Return the samples of the gaps of a task's gap groups [shape=(frames, markers)]."""
    wanted = np.zeros(task.valid.shape, dtype=bool)
    for group in task.groups:
        for gap in group.gaps:
            wanted[gap.start : gap.stop, gap.marker] = True
    return wanted


def part_of_task(
    task: Task, gappy: NDArray[np.intp], columns: NDArray[np.intp], wanted: NDArray[np.bool_]
) -> Task:
    """Return the task of some markers with gaps, and the columns of the clip that it needs.

    Parameters
    ----------
    task : Task
        The whole task.
    gappy : ndarray of int
        The markers whose gaps are filled.
    columns : ndarray of int
        The markers of the part, among them these; ascending.
    wanted : ndarray of bool [shape=(frames, markers)]
        The samples to fill.
    """
    requested = wanted[:, columns] & np.isin(columns, gappy)
    positions = np.ascontiguousarray(task.positions[:, columns])
    labels = tuple(task.labels[column] for column in columns)
    return Task(
        positions,
        labels,
        task.rate,
        describe_markers(labels, positions, task.marker_set, lambda: pair_statistics(positions)),
        tuple(gap_groups(requested)),
        tuple(_columns_of(take, columns) for take in task.takes),
        task.name,
        task.subject,
        completed=None if task.completed is None else task.completed[:, columns],
        learn_from_clip=task.learn_from_clip,
        checkpoint=task.checkpoint,
    )


def seeing_only(
    method: Callable[..., Estimate], filled: Sequence[int], seen: Sequence[int]
) -> Callable[..., Estimate]:
    """Return a method that sees some markers only, and fills some of these.

    Parameters
    ----------
    method : Method
        Any method.
    filled : sequence of int
        The markers that it fills.
    seen : sequence of int
        The markers that it sees in addition.
    """
    gappy = np.unique(np.array(filled, dtype=np.intp))
    columns = np.union1d(gappy, np.array(seen, dtype=np.intp))
    own = np.searchsorted(columns, gappy)

    @wraps(method)
    def fill(task: Task, progress: Progress = no_progress, **options: Any) -> Estimate:
        chosen = part_of_task(task, gappy, columns, wanted_samples(task))
        share = task.samples / max(chosen.samples, 1)
        part = method(chosen, lambda samples: progress(share * samples), **options)
        result = Estimate.of(task)
        result.positions[:, gappy] = part.positions[:, own]
        result.expected_rms[:, gappy] = part.expected_rms[:, own]
        result.notes.extend(replace(n, marker=int(columns[n.marker])) for n in part.notes)
        if part.error_bound_90 is None:
            return result
        bound = np.full_like(result.expected_rms, np.nan)
        bound[:, gappy] = part.error_bound_90[:, own]
        return replace(result, error_bound_90=bound)

    return fill


def _columns_of(take: Take, columns: NDArray[np.intp]) -> Take:
    """Return a take with some markers of the clip."""
    return replace(
        take,
        shown=take.shown[columns],
        read=lambda level, markers: take.read(level, columns[markers]),
    )
