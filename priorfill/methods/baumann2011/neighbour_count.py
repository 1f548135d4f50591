"""Choose k, the number of neighbours, by leaving takes out of the database.

Baumann et al. 2011 [B11]_ do not state k. In hours of recordings hundreds of poses are like a
query, and their mean has little noise. In minutes there are ten, and the mean of hundreds is an
average pose. The database shows which: poses like those of the gap are predicted from the poses of
other takes, as the clip is from the database, and k is the number with the least error.

References
----------
.. [B11] Baumann, Krüger, Zinke and Weber, Data-driven completion of motion capture data,
   VRIPHYS 2011.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.baumann2011.pose_searches import MarkerSearch
from priorfill.search.bank import PoseBank

__all__ = ["COUNTS", "NeighbourCount", "choose_neighbours"]

COUNTS = (1, 2, 4, 8, 16, 32, 64, 128, 256)
"""Numbers of neighbours that are compared. Errors change by a few percent between two of them."""

MAX_PROBES = 32
"""Poses that are predicted. With 128 the same numbers are chosen, or those next to them."""

MAX_CANDIDATES = 4096
"""Nearest poses of a probe that are looked at. Where nearly all are of the probe's own take, fewer
than the greatest number of neighbours may be of others."""

UNKNOWN_COUNT = 16
"""k where the database cannot show it: one take, no longer than the gap."""


@dataclass(frozen=True, eq=False)
class NeighbourCount:
    """A number of neighbours, and how far their mean is off in takes that are left out.

    Attributes
    ----------
    k : int
        The number.
    rms : ndarray [shape=(wanted markers,), mm]
        Rms error of each marker; 0 where it is unknown.
    """

    k: int
    rms: NDArray[np.float64]

    @classmethod
    def unmeasured(cls, k: int, search: MarkerSearch) -> NeighbourCount:
        """Return a number that is given, not chosen."""
        return cls(k, np.zeros(len(search.wanted)))


def choose_neighbours(
    bank: PoseBank, search: MarkerSearch, positions: NDArray[np.float64]
) -> NeighbourCount:
    """Choose the number of neighbours for some frames of a clip.

    The pose nearest to each of some frames is a probe. Its wanted markers are predicted by the mean
    of the k poses nearest to it in other takes. If all probes' neighbours are of their own takes,
    as in a search of the clip itself, those of the same take count that are farther away in time
    than the frames last.

    Parameters
    ----------
    bank : PoseBank
        The poses that are searched.
    search : MarkerSearch
        By which markers, and for which.
    positions : ndarray [shape=(frames, all markers, 3), mm]
        The frames of the clip, at the rate of the bank; the viable markers are measured in each.

    Returns
    -------
    NeighbourCount
        One of `COUNTS`; `UNKNOWN_COUNT` if no pose is left for any probe.
    """
    if not len(bank):
        return NeighbourCount.unmeasured(UNKNOWN_COUNT, search)
    some = np.unique(np.linspace(0, len(positions) - 1, MAX_PROBES).round().astype(np.intp))
    _, nearest = bank.search(positions[some], search.root.frames(positions[some]), 1)
    probes = np.unique(nearest)
    found, usable = _candidates(bank, search, probes, len(positions))
    known = usable.any(axis=1)
    if not known.any():
        return NeighbourCount.unmeasured(UNKNOWN_COUNT, search)
    probes, found, usable = probes[known], found[known], usable[known]
    order = np.argsort(~usable, axis=1, kind="stable")[:, : max(COUNTS)]
    found = np.take_along_axis(found, order, axis=1)
    truth = bank.wanted(probes)
    poses = bank.wanted(found.ravel()).reshape(*found.shape, *truth.shape[1:])
    sums = np.cumsum(poses, axis=1)
    left = usable.sum(axis=1)
    each = np.arange(len(probes))
    errors = []
    for count in COUNTS:
        k = np.minimum(left, count)  # where fewer are left, all of them
        mean = sums[each, k - 1] / k[:, None, None]
        errors.append(np.linalg.norm(mean - truth, axis=2))
    best = int(np.argmin([error.mean() for error in errors]))
    return NeighbourCount(COUNTS[best], np.sqrt((errors[best] ** 2).mean(axis=0)))


def _candidates(
    bank: PoseBank, search: MarkerSearch, probes: NDArray[np.intp], frames: int
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return the poses nearest to each probe, and which of them may predict it.

    Both are [shape=(probes, candidates)], nearest first.
    """
    needed = np.unique(np.concatenate([search.root.markers, search.viable])).astype(np.intp)
    poses = np.full((len(probes), int(needed.max()) + 1, 3), np.nan)
    poses[:, needed] = bank.positions(probes, needed)
    roots = search.root.frames(poses)
    own = bank.take(probes)[:, None]
    count = 2 * max(COUNTS)
    while True:
        _, found = bank.search(poses, roots, count)
        other = bank.take(found) != own
        enough = other.sum(axis=1).min() >= max(COUNTS)
        if enough or count >= min(MAX_CANDIDATES, len(bank)):
            break
        count *= 4
    if not other.any():
        other = np.abs(found - probes[:, None]) > frames
    return found, other
