"""Banks of poses: the takes' poses in the root frames of one search and level.

A bank knows for each pose where it comes from, so that whatever the search finds can be read
off together with the poses one frame before and after: that gives the neighbours' velocities
and accelerations without storing them.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.poses import complete_poses, evenly_spaced
from priorfill.geometry.root_frames import RootFrames, RootGroup
from priorfill.runtime.threads import in_threads, parts
from priorfill.search.index import FEW, POSES_A_THREAD, PoseIndex
from priorfill.search.takes import Take

__all__ = ["Banks", "Neighbours", "PoseBank"]

ROOM = 2**29
"""Bytes of banks kept for another use: in a clip whose markers flicker every gap needs banks of
its own, and a bank holds a part of the whole database."""


BLOCK = 2**12
"""Poses brought into root frames at a time: with double precision they take about a megabyte."""


@dataclass(frozen=True, eq=False)
class Neighbours:
    """What the k nearest poses of each query say of the wanted markers, in root frames.

    Attributes
    ----------
    distance : ndarray [shape=(frames, k), mm]
        Rms distance a viable marker, ascending.
    row : ndarray of int [shape=(frames, k)]
        The bank's row of each.
    take : ndarray of int [shape=(frames, k)]
        Index of the take that each comes from.
    pose : ndarray [shape=(frames, k, markers, 3), mm]
        Positions y_i; NaN where the neighbour does not have the marker.
    velocity, acceleration : ndarray [shape=(frames, k, markers, 3), mm]
        ν_i Δt and α_i Δt², for the Δt of the query's level.
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
        Where to look.
    root : RootGroup
        The group that gives the root frames; its markers are valid in every pose used.
    viable : ndarray of int [shape=(viable markers,)]
        The markers to search by.
    wanted : ndarray of int [shape=(wanted markers,)]
        The markers that a pose must have to be of use.
    rate : float
        The rate of the query's level, Hz: each take gives its level of the nearest rate.
    most : int, optional
        How many poses to search at most, evenly spread; by default all.

    Attributes
    ----------
    rows : ndarray of int
        The poses that are searched, among those of all the takes one after the other.
    rate : float
        As given; recordings sampled more slowly have a rate of their own, see `rates`.
    """

    def __init__(
        self,
        takes: Sequence[Take],
        root: RootGroup,
        viable: NDArray[np.intp],
        wanted: NDArray[np.intp],
        rate: float,
        most: int | None = None,
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
        known = np.empty(len(positions), dtype=bool)
        for at in range(0, len(positions), BLOCK):
            known[at : at + BLOCK] = complete_poses(positions[at : at + BLOCK])
        inner = np.zeros_like(known)  # poses with a pose of the same take on either side
        inner[1:-1] = known[:-2] & known[1:-1] & known[2:] & (self._take[:-2] == self._take[2:])
        self.rate = rate
        self._inner = inner
        self.rows = np.flatnonzero(inner)
        if most is not None and len(self.rows) > most:
            self.rows = self.rows[evenly_spaced(len(self.rows), most)]
        self._rate_ratio = np.repeat(np.array(rates) / rate, lengths)
        self._viable = viable
        self._needed = needed
        self._wanted_columns = np.searchsorted(needed, wanted)
        self._positions = positions
        self._root = root.among(needed)
        self._index: PoseIndex | None = None
        if len(self.rows):
            starts = np.flatnonzero(np.diff(self._take[self.rows], prepend=-1))
            self._index = PoseIndex(self._local(viable), starts)

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def nbytes(self) -> int:
        """Memory that it takes."""
        arrays = (self.rows, self._inner, self._take, self._rate_ratio, self._positions)
        index = self._index.nbytes if self._index is not None else 0
        return sum(array.nbytes for array in arrays) + index

    def _local(self, markers: NDArray[np.intp]) -> NDArray[np.float32]:
        """Return the searched poses of some markers in root frames [shape=(rows, 3m), mm]."""
        local = np.empty((len(self.rows), 3 * len(markers)), dtype=np.float32)
        columns = np.searchsorted(self._needed, markers)
        if len(local) > FEW:
            self._local_compiled(columns, local)
            return local
        for at in range(0, len(local), BLOCK):
            poses = self._in_root_frames(self.rows[at : at + BLOCK], columns)
            local[at : at + BLOCK] = poses.reshape(len(poses), -1)
        return local

    def _local_compiled(self, columns: NDArray[np.intp], local: NDArray[np.float32]) -> None:
        """Write columns of all searched poses as `_in_root_frames` returns them."""
        from priorfill.search.kernels import in_root_frames

        root = np.array(self._root.markers, dtype=np.intp)
        shape = self._root.template - self._root.template.mean(axis=0)

        def bring(begin: int, end: int) -> None:
            in_root_frames(self._positions, self.rows, begin, end, root, shape, columns, local)

        in_threads(bring, parts(len(local), len(local) // POSES_A_THREAD))

    def _in_root_frames(
        self, rows: NDArray[np.intp], columns: NDArray[np.intp]
    ) -> NDArray[np.float64]:
        """Return columns of rows in root frames [shape=(rows, columns, 3), mm]."""
        poses = self._positions[rows]
        frames = self._root.frames(poses)
        moved = poses[:, columns] - frames.origin[:, None, :]
        # by hand: thousands of products of small matrices take several times as long
        cosine, sine = frames.rotation[:, :1, 0], frames.rotation[:, 1:2, 0]
        x, y = moved[..., 0].copy(), moved[..., 1]
        moved[..., 0] = x * cosine + y * sine
        moved[..., 1] = y * cosine - x * sine
        return moved

    def wanted(self, rows: NDArray[np.intp]) -> NDArray[np.float64]:
        """Return the wanted markers of rows in root frames [shape=(rows, wanted, 3), mm]."""
        return self._in_root_frames(rows, self._wanted_columns)

    def positions(self, rows: NDArray[np.intp], markers: NDArray[np.intp]) -> NDArray[np.float64]:
        """Positions of rows, as recorded [shape=(rows, markers, 3), mm].

        ``markers`` are among the root, viable and wanted ones.
        """
        columns = np.searchsorted(self._needed, markers)
        return self._positions[np.ix_(rows, columns)].astype(np.float64)

    def take(self, rows: NDArray[np.intp]) -> NDArray[np.intp]:
        """Index of the take that each row comes from."""
        return self._take[rows]

    def rates(self, rows: NDArray[np.intp]) -> NDArray[np.float64]:
        """Frames per second (Hz) of what each row comes from."""
        rates: NDArray[np.float64] = self.rate * self._rate_ratio[rows]
        return rates

    def moved(self, rows: NDArray[np.intp], step: int | NDArray[np.intp]) -> NDArray[np.intp]:
        """Rows of the same takes so many frames later; the same ones where there is none."""
        other = np.clip(rows + step, 0, len(self._inner) - 1)
        same = self._inner[other] & (self._take[other] == self._take[rows])
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
            How many neighbours.

        Returns
        -------
        distance : ndarray [shape=(frames, k), mm]
            Rms distance a viable marker, ascending.
        rows : ndarray of int [shape=(frames, k)]
            The bank's row of each.

        Raises
        ------
        ValueError
            Where the bank is empty.
        """
        if self._index is None:
            raise ValueError("the bank has no pose; ask for its length first")
        queries = frames.to_local(positions[:, self._viable])
        distance, found = self._index.nearest(queries.reshape(len(queries), -1), k)
        return distance / np.sqrt(len(self._viable)), self.rows[found]

    def nearest(self, positions: NDArray[np.float64], frames: RootFrames, k: int) -> Neighbours:
        """Find the k nearest poses of each query and read off the wanted markers.

        Parameters and errors are those of `search`.
        """
        distance, found = self.search(positions, frames, k)
        rows = found.ravel()
        shape = (*found.shape, len(self._wanted_columns), 3)
        here = self.wanted(rows)
        before, after = self.wanted(rows - 1), self.wanted(rows + 1)
        # a take sampled at another rate makes longer or shorter steps
        ratio = self._rate_ratio[rows][:, None, None]
        return Neighbours(
            distance,
            found,
            self._take[found],
            here.reshape(shape),
            (0.5 * ratio * (after - before)).reshape(shape),
            (ratio**2 * (after - 2.0 * here + before)).reshape(shape),
        )


class Banks:
    """Banks of some takes, made when asked for; the last ones used are kept while there is room.

    Parameters
    ----------
    takes : sequence of Take
        Where the banks look.
    room : int
        Bytes to keep; the bank used last is kept whatever its size.
    """

    def __init__(self, takes: Sequence[Take], room: int = ROOM) -> None:
        self._takes = takes
        self._room = room
        self._kept: dict[tuple[object, ...], PoseBank] = {}  # the last used last
        self._size = 0
        self._lock = threading.Lock()

    def get(
        self,
        root: RootGroup,
        viable: NDArray[np.intp],
        wanted: NDArray[np.intp],
        rate: float,
        most: int | None = None,
    ) -> PoseBank:
        """Return a bank; parameters as for `PoseBank`. May be called from several threads."""
        template = root.template.tobytes()
        key = (root.markers, template, viable.tobytes(), wanted.tobytes(), rate, most)
        with self._lock:
            bank = self._take_out(key)
        if bank is None:
            bank = PoseBank(self._takes, root, viable, wanted, rate, most)
        with self._lock:
            self._take_out(key)  # another thread may have made it meanwhile
            self._kept[key] = bank
            self._size += bank.nbytes
            while self._size > self._room and len(self._kept) > 1:
                self._take_out(next(iter(self._kept)))
        return bank

    def _take_out(self, key: tuple[object, ...]) -> PoseBank | None:
        bank = self._kept.pop(key, None)
        if bank is not None:
            self._size -= bank.nbytes
        return bank
