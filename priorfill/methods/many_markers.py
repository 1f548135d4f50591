"""Fill clips of very many markers neighbourhood by neighbourhood.

Methods consider pairs of markers. Above `MAX_DENSE_MARKERS`, each neighbourhood with a gap is a
task of its own, with the markers nearest to its gaps.
"""

from __future__ import annotations

from dataclasses import replace
from functools import wraps
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import MethodError
from priorfill.gaps import find_gaps
from priorfill.geometry.distances import norms
from priorfill.geometry.neighbourhoods import MAX_DENSE_MARKERS, mean_places, neighbourhoods
from priorfill.methods.task import Estimate, Method, Note, Progress, Task, no_progress
from priorfill.methods.task_parts import part_of_task, wanted_samples

__all__ = ["by_neighbourhoods"]

NEAREST_MARKERS = 20
"""Markers nearest to one with a gap that its task contains, whatever neighbourhood they are in."""

UNSEEN_MARKERS = 16
"""Markers of a task at most that the clip never shows."""


def by_neighbourhoods(method: Method) -> Method:
    """Return a method that divides tasks of more than `MAX_DENSE_MARKERS` markers.

    Parameters
    ----------
    method : Method
        Any method.

    Returns
    -------
    Method
        The same for tasks of fewer markers.
    """

    @wraps(method)
    def fill(task: Task, progress: Progress = no_progress, **options: Any) -> Estimate:
        if len(task.labels) <= MAX_DENSE_MARKERS:
            return method(task, progress, **options)
        return _fill_parts(method, task, progress, options)

    return fill


def _fill_parts(
    method: Method, task: Task, progress: Progress, options: dict[str, Any]
) -> Estimate:
    """Fill a task part by part."""
    wanted = wanted_samples(task)
    result = Estimate.of(task)
    bound = np.full_like(result.expected_rms, np.nan)
    bounded = False
    errors: list[MethodError] = []
    parts = _parts(task, wanted)
    for gappy, columns in parts:
        try:
            part = method(part_of_task(task, gappy, columns, wanted), progress, **options)
        except MethodError as error:
            errors.append(error)
            reason = str(error).removeprefix(f"{task.name}: ")
            result.notes.extend(
                Note(int(gappy[gap.marker]), gap.start, gap.stop, reason, filled=False)
                for gap in find_gaps(wanted[:, gappy])
            )
            continue
        own = np.searchsorted(columns, gappy)
        result.positions[:, gappy] = part.positions[:, own]
        result.expected_rms[:, gappy] = part.expected_rms[:, own]
        if part.error_bound_90 is not None:
            bound[:, gappy], bounded = part.error_bound_90[:, own], True
        result.notes.extend(replace(n, marker=int(columns[n.marker])) for n in part.notes)
    if errors and len(errors) == len(parts):
        raise errors[0]
    return replace(result, error_bound_90=bound) if bounded else result


def _parts(
    task: Task, wanted: NDArray[np.bool_]
) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Return markers with gaps, part by part, and with each part the markers that it needs."""
    from scipy.spatial import cKDTree  # slow to import

    gaps, shown = (np.asarray(mask.any(axis=0)) for mask in (wanted, task.valid))
    seen = np.flatnonzero(shown)
    parts = []
    if len(seen):
        places = mean_places(task.positions[:, seen])
        tree, count = cKDTree(places), min(NEAREST_MARKERS + 1, len(seen))  # 1 is the marker itself
        for group in neighbourhoods(task.positions[:, seen]):
            near = group[gaps[seen[group]]]
            if len(near):
                columns = np.union1d(near, tree.query(places[near], k=count)[1].ravel())
                parts.append((seen[near], seen[columns]))
    unseen = np.flatnonzero(gaps & ~shown)
    for first in range(0, len(unseen), UNSEEN_MARKERS):
        some = unseen[first : first + UNSEEN_MARKERS]
        related = [_related(task, int(marker), seen) for marker in some]
        parts.append((some, np.unique(np.concatenate([some, *related]))))
    return parts


def _related(task: Task, marker: int, seen: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return visible markers near to one that the clip never shows.

    The nearest ones in the first recording that shows it, or else the next ones in the order of the
    clip's labels, where those of one body mostly follow one another.
    """
    distance = np.abs(seen - marker).astype(np.float64)
    take = next((take for take in task.takes if take.shown[marker]), None)
    if take is not None:
        columns = np.concatenate([[marker], seen])
        places = mean_places(take.positions(len(take.rates) - 1, columns))
        distance = np.nan_to_num(norms(places[1:] - places[0]), nan=np.inf)
    return np.asarray(seen[np.argsort(distance, kind="stable")[:NEAREST_MARKERS]])
