"""Lead the pieces of a task through blackouts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.gpr.blackout.database_windows import similar_movements
from priorfill.methods.gpr.blackout.predict_blackout import fill_blackout
from priorfill.methods.gpr.blackout.windows import Recording
from priorfill.methods.gpr.gap_segments import Piece
from priorfill.methods.gpr.options import GPROptions
from priorfill.methods.gpr.pose_search import PoseSearch
from priorfill.methods.gpr.prediction import Prediction
from priorfill.methods.task import Task

__all__ = ["Blackouts"]


class Blackouts:
    """Fills the blackouts of one task.

    Parameters
    ----------
    task : Task
        The clip and the takes to learn from.
    search : PoseSearch
        Of these takes.
    options : GPROptions
        How many stretches of them.
    """

    def __init__(self, task: Task, search: PoseSearch, options: GPROptions) -> None:
        self.task = task
        self._search = search
        self._options = options

    def lead_through(
        self, pieces: Sequence[Piece], completed: NDArray[np.float64]
    ) -> list[Prediction]:
        """Lead pieces through a blackout together.

        Parameters
        ----------
        pieces : sequence of Piece
            Their frames overlap, and no three markers are visible in them.
        completed : ndarray [shape=(frames, markers, 3), mm]
            The clip, filled but for blackouts.

        Returns
        -------
        list of Prediction
            One for each piece, or for some of its markers; for what is seen on neither side, none.
        """
        start, stop = min(p.start for p in pieces), max(p.stop for p in pieces)
        clip = completed
        if any(p.start > start or p.stop < stop for p in pieces):
            clip = completed.copy()
            clip[start:stop] = np.nan
        others, takes = similar_movements(self.task, self._search, self._options, clip, start, stop)
        wanted = np.unique(np.concatenate([p.markers for p in pieces]))
        positions, expected_rms, windows = self._lead(
            [Recording(clip), *others], start, stop, wanted
        )
        how = "similar movements of the clip" if windows else "interpolation over time"
        how += self.task.and_sources(takes, "the database") if windows else ""
        predictions = []
        for piece in pieces:
            inside = slice(piece.start - start, piece.stop - start)
            markers = piece.markers[~np.isnan(positions[inside, piece.markers, 0]).any(axis=0)]
            if len(markers):
                predictions.append(
                    Prediction(
                        replace(piece, markers=markers),
                        piece.start,
                        positions[inside, markers]
                        + _steps(positions[:, markers], completed, piece, start, markers),
                        expected_rms[inside, markers],
                        complete=True,
                        how=how,
                        takes=(self.task.name, *(takes if windows else ())),
                        poses=windows,
                    )
                )
        return predictions

    def _lead(
        self, recordings: Sequence[Recording], start: int, stop: int, wanted: NDArray[np.intp]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
        """Return positions and deviations of all markers, NaN where unknown, and windows used."""
        shape = (stop - start, len(self.task.labels))
        positions, expected_rms = np.full((*shape, 3), np.nan), np.full(shape, np.nan)
        windows = 0
        # markers that are seen on one side only are led on when those seen on both are done
        while len(wanted):
            found = fill_blackout(
                recordings,
                start,
                stop,
                self.task.rate,
                self.task.root_among,
                self.task.contralateral,
                wanted,
            )
            if found is None:
                break
            known = wanted[~np.isnan(found.positions[:, wanted, 0]).any(axis=0)]
            if not len(known):
                break
            positions[:, known] = found.positions[:, known]
            expected_rms[:, known] = found.expected_rms[:, known]
            windows = max(windows, found.windows)
            wanted = np.setdiff1d(wanted, known)
        return positions, expected_rms, windows


def _steps(
    found: NDArray[np.float64],
    completed: NDArray[np.float64],
    piece: Piece,
    start: int,
    markers: NDArray[np.intp],
) -> NDArray[np.float64]:
    """Return what joins what was found from ``start`` on to a shorter piece's own edges."""
    frames = np.arange(piece.start, piece.stop)
    away = []
    for frame in (piece.start - 1, piece.stop):
        step = np.full((len(markers), 3), np.nan)
        if start <= frame < start + len(found):
            step = completed[frame, markers] - found[frame - start]
        away.append(np.where(np.isnan(step), 0.0, step))
    share = (frames - (piece.start - 1)) / (len(frames) + 1)
    joined: NDArray[np.float64] = away[0] + share[:, None, None] * (away[1] - away[0])
    return joined
