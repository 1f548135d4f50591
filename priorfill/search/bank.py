"""Pose banks: the poses of takes in the root frames of one search and level.

A bank records where each pose comes from, so that the poses one frame before and after a neighbour
can be looked up. Their differences are the velocities ν_i and accelerations α_i of Eqs. (3) and (4)
of Baumann et al. 2011, which therefore need not be stored.
"""

from __future__ import annotations

import copy
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.poses import complete_poses, evenly_spaced
from priorfill.geometry.root_frames import RootFrames, RootGroup
from priorfill.runtime.threads import run_in_threads, split_range
from priorfill.search.bounds import POSES_PER_THREAD
from priorfill.search.index import MAX_BRUTE_FORCE_POSES, PoseIndex, Way
from priorfill.search.takes import Take

__all__ = ["Neighbours", "PoseBank", "PoseBankCache", "PoseMapping", "spaced_rows"]

PoseMapping = Callable[
    [NDArray[np.float32], NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]],
    NDArray[np.float32] | None,
]
"""Returns changed poses of takes, or None if it changes none. Its arguments: positions
[shape=(poses, markers, 3), mm], the take of each pose, the poses that are searched, and the
markers."""

MAX_CACHE_BYTES = 2**29
"""Bytes of banks kept for reuse: in a clip with flickering markers every gap needs banks of its
own, and a bank holds part of the complete database."""

POSES_PER_BATCH = 2**12
"""Poses transformed into root frames at a time: in double precision they take about 1 MB."""

ROWS_PER_PRODUCT = 2**14
"""Poses whose distances from given ones are computed at a time."""


def spaced_rows(
    rows: NDArray[np.intp], take: NDArray[np.intp], spacing: NDArray[np.float64], max_count: int
) -> NDArray[np.intp]:
    """Return the places of the first rows that are not too near to a previous one of their take.

    Parameters
    ----------
    rows : ndarray of int
        Of a bank.
    take : ndarray of int [shape=(rows,)]
        The take of each.
    spacing : ndarray [shape=(rows,)]
        Least distance of two chosen rows; the same for all rows of a take.
    max_count : int
        Number of rows to choose.

    Examples
    --------
    >>> spaced_rows(np.array([7, 9, 12]), np.zeros(3, dtype=int), np.full(3, 4.0), 5)
    array([0, 2])
    """
    chosen: list[int] = []
    cells: dict[tuple[int, int], list[int]] = {}
    pairs = zip(rows.tolist(), take.tolist(), spacing.tolist(), strict=True)
    for place, (row, number, distance) in enumerate(pairs):
        if len(chosen) == max_count:
            break
        cell = int(row / distance)
        near = (o for c in (cell - 1, cell, cell + 1) for o in cells.get((number, c), ()))
        if all(abs(row - other) >= distance for other in near):
            chosen.append(place)
            cells.setdefault((number, cell), []).append(row)
    return np.array(chosen, dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Neighbours:
    """The k nearest poses of each query and their wanted markers, in root frames.

    Attributes
    ----------
    distance : ndarray [shape=(frames, k), mm]
        Rms distance per viable marker, ascending.
    row : ndarray of int [shape=(frames, k)]
        Rows of the bank.
    take : ndarray of int [shape=(frames, k)]
        Index of the take that each pose comes from.
    pose : ndarray [shape=(frames, k, markers, 3), mm]
        Positions y_i; NaN where the neighbour does not have the marker.
    velocity, acceleration : ndarray [shape=(frames, k, markers, 3), mm]
        ν_i Δt and α_i Δt² of Eqs. (3) and (4), where Δt is the frame step of the query's level.
    """

    distance: NDArray[np.float64]
    row: NDArray[np.intp]
    take: NDArray[np.intp]
    pose: NDArray[np.float64]
    velocity: NDArray[np.float64]
    acceleration: NDArray[np.float64]


class PoseBank:
    """The poses of some takes that can be searched by some viable markers.

    Parameters
    ----------
    takes : sequence of Take
        The recordings.
    root : RootGroup
        The group that defines the root frames. Only poses in which its markers are valid are used.
    viable : ndarray of int [shape=(viable markers,)]
        The markers to search by.
    wanted : ndarray of int [shape=(wanted markers,)]
        Markers that a pose must have too.
    rate : float
        Hz. The rate of the query's level; of each take the level with the nearest rate is used.
    max_poses : int, optional
        Maximum number of poses to search, evenly spaced; by default all.
    way : str, optional
        How they are searched, as of `PoseIndex`.

    Attributes
    ----------
    rows : ndarray of int
        The poses that are searched: rows of the concatenated poses of all takes used.
    rate : float
        As given; recordings sampled more slowly have rates of their own, see `rates`.
    is_mapped : bool
        Whether the poses are changed by a mapping, see `mapped`.

    See Also
    --------
    PoseIndex : The search itself.
    PoseBankCache : Keeps banks for reuse.
    """

    def __init__(
        self,
        takes: Sequence[Take],
        root: RootGroup,
        viable: NDArray[np.intp],
        wanted: NDArray[np.intp],
        rate: float,
        max_poses: int | None = None,
        way: Way | None = None,
    ) -> None:
        needed = np.unique(np.concatenate([root.markers, viable, wanted])).astype(np.intp)
        useful = [i for i, take in enumerate(takes) if take.shown[needed].all()]
        levels = [takes[i].nearest_level(rate) for i in useful]
        lengths = np.array(
            [takes[i].lengths[level] for i, level in zip(useful, levels, strict=True)],
            dtype=np.intp,
        )
        rates = [takes[i].rates[level] for i, level in zip(useful, levels, strict=True)]
        positions = np.empty((int(lengths.sum()), len(needed), 3), dtype=np.float32)
        start = 0
        for i, level, length in zip(useful, levels, lengths, strict=True):
            positions[start : start + length] = takes[i].positions(level, needed)
            start += length
        self._take = np.repeat(np.array(useful, dtype=np.intp), lengths)
        complete = np.empty(len(positions), dtype=bool)
        for at in range(0, len(positions), POSES_PER_BATCH):
            batch = slice(at, at + POSES_PER_BATCH)
            complete[batch] = complete_poses(positions[batch])
        usable = np.zeros_like(complete)  # poses between complete poses of the same take
        usable[1:-1] = (
            complete[:-2] & complete[1:-1] & complete[2:] & (self._take[:-2] == self._take[2:])
        )
        self.rate = rate
        self._usable = usable
        self.rows = np.flatnonzero(usable)
        if max_poses is not None and len(self.rows) > max_poses:
            self.rows = self.rows[evenly_spaced(len(self.rows), max_poses)]
        self._rate_ratio = np.repeat(np.array(rates) / rate, lengths)
        self._viable = viable
        self._needed = needed
        self._wanted_columns = np.searchsorted(needed, wanted)
        self._positions = positions
        self._root = root.among(needed)
        self._index: PoseIndex | None = None
        self._way = way
        self.is_mapped = False

    def mapped(self, mapping: PoseMapping) -> PoseBank:
        """Return a bank of the same poses, changed by a mapping; this one if none is changed."""
        positions = mapping(self._positions, self._take, self.rows, self._needed)
        if positions is None:
            return self
        other = copy.copy(self)
        other._positions, other._index, other.is_mapped = positions, None, True
        return other

    def _indexed(self) -> PoseIndex:
        """Return the index of the poses, made on first use."""
        index = self._index
        if index is None:
            starts = np.flatnonzero(np.diff(self._take[self.rows], prepend=-1))
            self._index = index = PoseIndex(self._local(self._viable), starts, self._way)
        return index

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def poses(self) -> int:
        """Number of rows, those included that are not searched."""
        return len(self._take)

    @property
    def nbytes(self) -> int:
        """Memory in bytes."""
        arrays = (self.rows, self._usable, self._take, self._rate_ratio, self._positions)
        # of the index its poses count, the largest part, whether or not it is made yet
        index = 4 * 3 * len(self._viable) * len(self.rows)
        return sum(array.nbytes for array in arrays) + index

    def _local(self, markers: NDArray[np.intp]) -> NDArray[np.float32]:
        """Return the searched poses of some markers in root frames [shape=(rows, 3m), mm]."""
        local = np.empty((len(self.rows), 3 * len(markers)), dtype=np.float32)
        columns = np.searchsorted(self._needed, markers)
        if len(local) > MAX_BRUTE_FORCE_POSES:
            self._local_compiled(columns, local)
            return local
        for at in range(0, len(local), POSES_PER_BATCH):
            poses = self._in_root_frames(self.rows[at : at + POSES_PER_BATCH], columns)
            local[at : at + POSES_PER_BATCH] = poses.reshape(len(poses), -1)
        return local

    def _local_compiled(self, columns: NDArray[np.intp], local: NDArray[np.float32]) -> None:
        """Do the work of `_local` by a compiled loop."""
        from priorfill.search.kernels import in_root_frames

        root = np.array(self._root.markers, dtype=np.intp)
        shape = self._root.template - self._root.template.mean(axis=0)

        def transform(begin: int, end: int) -> None:
            in_root_frames(self._positions, self.rows, begin, end, root, shape, columns, local)

        run_in_threads(transform, split_range(len(local), len(local) // POSES_PER_THREAD))

    def _in_root_frames(
        self, rows: NDArray[np.intp], columns: NDArray[np.intp]
    ) -> NDArray[np.float64]:
        """Return columns of rows in root frames [shape=(rows, columns, 3), mm]."""
        poses = self._positions[rows]
        frames = self._root.frames(poses)
        moved = poses[:, columns] - frames.origin[:, None, :]
        # written out: thousands of products of small matrices take several times as long
        cosine, sine = frames.rotation[:, :1, 0], frames.rotation[:, 1:2, 0]
        x, y = moved[..., 0].copy(), moved[..., 1]
        moved[..., 0] = x * cosine + y * sine
        moved[..., 1] = y * cosine - x * sine
        return moved

    def wanted(self, rows: NDArray[np.intp]) -> NDArray[np.float64]:
        """Return the wanted markers of rows in root frames [shape=(rows, wanted, 3), mm]."""
        return self._in_root_frames(rows, self._wanted_columns)

    def local(self, rows: NDArray[np.intp], markers: NDArray[np.intp]) -> NDArray[np.float64]:
        """Return markers of rows in root frames [shape=(rows, markers, 3), mm].

        ``markers`` must be among the root, viable and wanted markers.
        """
        return self._in_root_frames(rows, np.searchsorted(self._needed, markers))

    def positions(self, rows: NDArray[np.intp], markers: NDArray[np.intp]) -> NDArray[np.float64]:
        """Return positions, as recorded or mapped [shape=(rows, markers, 3), mm].

        ``markers`` must be among the root, viable and wanted markers.
        """
        columns = np.searchsorted(self._needed, markers)
        return self._positions[np.ix_(rows, columns)].astype(np.float64)

    def squared_distances(
        self, markers: NDArray[np.intp], poses: NDArray[np.float64]
    ) -> NDArray[np.float32]:
        """Return the squared distances of all searched poses from some poses.

        Parameters
        ----------
        markers : ndarray of int
            The markers that are compared; as of `positions`.
        poses : ndarray [shape=(poses, markers, 3), mm]
            In root frames, by the bank's root group.

        Returns
        -------
        ndarray [shape=(rows, poses), mm²]
            Per marker; a row for each of `rows`.
        """
        columns = np.searchsorted(self._needed, markers)
        root = np.array(self._root.markers, dtype=np.intp)
        queries = poses.reshape(len(poses), -1).astype(np.float32)
        square = np.empty((len(self.rows), len(poses)), dtype=np.float32)
        local = np.empty((ROWS_PER_PRODUCT, 3 * len(markers)), dtype=np.float32)
        norms = np.einsum("ij,ij->i", queries, queries)
        for start in range(0, len(self.rows), ROWS_PER_PRODUCT):
            rows = self.rows[start : start + ROWS_PER_PRODUCT]
            part = local[: len(rows)]
            if len(self.rows) > MAX_BRUTE_FORCE_POSES:
                from priorfill.search.kernels import in_root_frames

                shape = self._root.template - self._root.template.mean(axis=0)
                in_root_frames(self._positions, rows, 0, len(rows), root, shape, columns, part)
            else:
                part[:] = self._in_root_frames(rows, columns).reshape(len(rows), -1)
            found = part @ queries.T
            found *= -2.0
            found += norms
            found += np.einsum("ij,ij->i", part, part)[:, None]
            square[start : start + len(rows)] = found
        return square / np.float32(len(markers))

    def take(self, rows: NDArray[np.intp]) -> NDArray[np.intp]:
        """Return the index of the take that each row comes from."""
        return self._take[rows]

    def rates(self, rows: NDArray[np.intp]) -> NDArray[np.float64]:
        """Return the rate (Hz) of the recording that each row comes from."""
        rates: NDArray[np.float64] = self.rate * self._rate_ratio[rows]
        return rates

    def shifted(self, rows: NDArray[np.intp], step: int | NDArray[np.intp]) -> NDArray[np.intp]:
        """Return the rows ``step`` frames later in the same takes, or as given if there is none."""
        other = np.clip(rows + step, 0, len(self._usable) - 1)
        same = self._usable[other] & (self._take[other] == self._take[rows])
        return np.where(same, other, rows)

    def search(
        self, positions: NDArray[np.float64], frames: RootFrames, k: int
    ) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
        """Find the k nearest poses of each query.

        Parameters
        ----------
        positions : ndarray [shape=(frames, all markers, 3), mm]
            The queries; the viable markers are valid in each.
        frames : RootFrames
            The queries' root frames, by the bank's root group.
        k : int
            Number of neighbours.

        Returns
        -------
        distance : ndarray [shape=(frames, k), mm]
            Rms distance per viable marker, ascending.
        rows : ndarray of int [shape=(frames, k)]
            Rows of the bank.

        Raises
        ------
        ValueError
            If the bank is empty.
        """
        if not len(self.rows):
            raise ValueError("the bank has no pose to search; check its length first")
        queries = frames.to_local(positions[:, self._viable])
        distance, found = self._indexed().nearest(queries.reshape(len(queries), -1), k)
        return distance / np.sqrt(len(self._viable)), self.rows[found]

    def distances(self, pose: NDArray[np.float64], frames: RootFrames) -> NDArray[np.float64]:
        """Return the distance of one pose from every row that is searched.

        Parameters
        ----------
        pose : ndarray [shape=(1, markers, 3), mm]
            With all markers of the clip; the viable ones are compared.
        frames : RootFrames
            Its root frame.

        Returns
        -------
        ndarray [shape=(len(rows),), mm]
            Rms distance per viable marker, of each row of `rows`.
        """
        if not len(self.rows):
            return np.empty(0)
        query = frames.to_local(pose[:, self._viable]).reshape(-1)
        square = self._indexed().squared_distances(query).astype(np.float64)
        distance: NDArray[np.float64] = np.sqrt(square / len(self._viable))
        return distance

    def usable_spans(self, rows: NDArray[np.intp], first: int, last: int) -> NDArray[np.bool_]:
        """Return for which rows all from ``first`` to ``last`` after it are usable.

        Usable are complete poses, between complete poses of the same take.
        """
        begin, end = rows + first, rows + last
        inside = (begin >= 0) & (end < len(self._usable))
        begin, end = np.where(inside, begin, 0), np.where(inside, end, 0)
        unusable = np.concatenate([[0], np.cumsum(~self._usable)])
        usable: NDArray[np.bool_] = inside & (unusable[end + 1] == unusable[begin])
        usable &= self._take[begin] == self._take[end]
        return usable

    def nearest(self, positions: NDArray[np.float64], frames: RootFrames, k: int) -> Neighbours:
        """Find the k nearest poses of each query, and their wanted markers with derivatives.

        Parameters and errors are those of `search`.
        """
        distance, found = self.search(positions, frames, k)
        rows = found.ravel()
        shape = (*found.shape, len(self._wanted_columns), 3)
        here = self.wanted(rows)
        before, after = self.wanted(rows - 1), self.wanted(rows + 1)
        # scales frame steps of the take to those of the query
        ratio = self._rate_ratio[rows][:, None, None]
        return Neighbours(
            distance,
            found,
            self._take[found],
            here.reshape(shape),
            (0.5 * ratio * (after - before)).reshape(shape),
            (ratio**2 * (after - 2.0 * here + before)).reshape(shape),
        )


class PoseBankCache:
    """Pose banks of some takes, built on demand; the most recently used ones are kept.

    Parameters
    ----------
    takes : sequence of Take
        The recordings.
    max_bytes : int
        Memory for banks that are kept; the most recently used one is kept whatever its size.
    way : str, optional
        How poses are searched, as of `PoseIndex`.

    See Also
    --------
    PoseBank : A bank.
    """

    def __init__(
        self, takes: Sequence[Take], max_bytes: int = MAX_CACHE_BYTES, way: Way | None = None
    ) -> None:
        self._takes, self._way = takes, way
        self._max_bytes = max_bytes
        self._banks: dict[tuple[object, ...], PoseBank] = {}  # the most recently used last
        self._bytes = 0
        self._lock = threading.Lock()

    def get(
        self,
        root: RootGroup,
        viable: NDArray[np.intp],
        wanted: NDArray[np.intp],
        rate: float,
        max_poses: int | None = None,
        mapping: PoseMapping | None = None,
    ) -> PoseBank:
        """Return a bank; parameters as for `PoseBank` and `PoseBank.mapped`.

        May be called from several threads. There must be only one mapping.
        """
        template, mapped = root.template.tobytes(), mapping is not None
        key = (root.markers, template, viable.tobytes(), wanted.tobytes(), rate, max_poses, mapped)
        with self._lock:
            bank = self._pop(key)
        if bank is None and mapping is not None:
            bank = self.get(root, viable, wanted, rate, max_poses).mapped(mapping)
        elif bank is None:
            bank = PoseBank(self._takes, root, viable, wanted, rate, max_poses, self._way)
        with self._lock:
            self._pop(key)  # another thread may have built it meanwhile
            self._banks[key] = bank
            self._bytes += bank.nbytes
            while self._bytes > self._max_bytes and len(self._banks) > 1:
                self._pop(next(iter(self._banks)))
        return bank

    def _pop(self, key: tuple[object, ...]) -> PoseBank | None:
        bank = self._banks.pop(key, None)
        if bank is not None:
            self._bytes -= bank.nbytes
        return bank
