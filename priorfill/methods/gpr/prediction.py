"""What is predicted for a piece, or why it stays missing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.calibration import BOUND_FACTOR
from priorfill.methods.gpr.gap_segments import Piece
from priorfill.methods.task import Note, Task

__all__ = ["Prediction", "unfilled"]


@dataclass(frozen=True, eq=False)
class Prediction:
    """What is predicted for a piece and a few frames around it.

    Attributes
    ----------
    piece : Piece
        What was asked for.
    first : int
        The first frame predicted; not after the piece's start.
    positions : ndarray [shape=(frames, piece's markers, 3), mm]
        Upright.
    deviation : ndarray [shape=(frames, piece's markers), mm]
        Expected rms Euclidean error.
    complete : bool
        Whether the rows learnt from left nothing to be gained by a second reading.
    how : str
        What it was predicted from.
    takes : tuple of str
        Recordings learnt from.
    own : bool
        Whether it was predicted from the clip's own poses.
    poses : int
        Rows of the largest lesson, or windows of a blackout; 0 where none were learnt from.
    bound_factor : float
        How many times the deviation 90 % of the errors are expected to lie below.
    """

    piece: Piece
    first: int
    positions: NDArray[np.float64]
    expected_rms: NDArray[np.float64]
    complete: bool
    how: str
    takes: tuple[str, ...] = ()
    own: bool = False
    poses: int = 0
    bound_factor: float = BOUND_FACTOR

    @property
    def last(self) -> int:
        """The frame after the last one predicted."""
        return self.first + len(self.positions)

    @property
    def notes(self) -> list[Note]:
        """What is to be said of it, marker by marker."""
        return [
            Note(
                int(m),
                self.piece.start,
                self.piece.stop,
                self.how,
                source_clips=self.takes,
                training_poses=self.poses,
            )
            for m in self.piece.markers
        ]


def unfilled(piece: Piece, task: Task) -> list[Note]:
    """Say why a piece stays missing, marker by marker."""
    if not piece.searchable:
        reason = "fewer than three other markers are visible, and it is not seen beside the gap"
    else:
        reason = "hardly a frame of the clip shows it together with the visible markers, "
        reason += "nor does another recording"
        if all(take.same_subject for take in task.takes):
            reason += ", and there is no database"
        if not task.takes:
            reason += "; give one (--database), or another clip of the same person (--same-subject)"
    return [Note(int(m), piece.start, piece.stop, reason, filled=False) for m in piece.markers]
