"""Predict the markers of one task that its clip hardly shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.poses import sample_complete_poses
from priorfill.methods.gpr.dropout.donors import IMAGE_ROWS, Witnesses, said_by
from priorfill.methods.gpr.dropout.predict_from_donors import VIEWS, predict_by_all, testify
from priorfill.methods.gpr.dropout.subject_kernel import KINDS
from priorfill.methods.gpr.dropout.subjects import OWN
from priorfill.methods.gpr.gap_segments import FEWEST_VISIBLE
from priorfill.methods.task import Task

__all__ = ["Dropouts", "Told"]

STAND_INS = 5
"""Visible markers nearby, at most, that stand in for the missing one to find out how well it is
predicted where there is no other body to tell."""

UNTOLD = 100.0
"""mm. Expected error where nothing tells it."""


@dataclass(frozen=True, eq=False)
class Told:
    """What witnesses say of missing markers.

    Attributes
    ----------
    positions : ndarray [shape=(poses, missing markers, 3), mm]
        Upright.
    deviation : ndarray [shape=(poses, missing markers), mm]
        Expected rms Euclidean error.
    how : str
        Which witnesses.
    takes : tuple of str
        Recordings learnt from.
    poses : int
        Of all witnesses.
    """

    positions: NDArray[np.float64]
    expected_rms: NDArray[np.float64]
    how: str
    takes: tuple[str, ...]
    poses: int


class Dropouts:
    """Predicts the markers of one task that its clip hardly shows.

    Parameters
    ----------
    task : Task
        The clip and the takes to learn from.
    """

    def __init__(self, task: Task) -> None:
        self.task = task
        self._witnesses = Witnesses(task)

    def nearest_visible(
        self, markers: NDArray[np.intp], visible: NDArray[np.intp]
    ) -> NDArray[np.intp]:
        """Choose the visible markers to predict by; see `Witnesses.nearest_visible`."""
        return self._witnesses.nearest_visible(markers, visible)

    def predict(
        self,
        markers: NDArray[np.intp],
        visible: NDArray[np.intp],
        frames: NDArray[np.intp],
    ) -> Told | None:
        """Predict missing markers from witnesses; None where there is none.

        Parameters
        ----------
        markers : ndarray of int
            What is missing.
        visible : ndarray of int
            The markers to predict by, from `nearest_visible`.
        frames : ndarray of int
            Frames of the clip in which those are seen.
        """
        if len(visible) < FEWEST_VISIBLE:
            return None
        witnesses, ties = self._witnesses.speaking_for(markers, visible)
        if not witnesses:
            return None
        query = self.task.positions[np.ix_(frames, visible)]
        bodies = {w.body for w in witnesses}
        # with a single body left out, nobody would be left to tell how far off it is
        judged = len(bodies) > 1
        errors = None if judged else self._stand_in_errors(markers, visible, OWN not in bodies)
        positions, expected_rms = testify(witnesses, query, ties, errors)
        return Told(
            positions,
            expected_rms,
            said_by(witnesses),
            tuple(dict.fromkeys(name for w in witnesses for name in w.takes)),
            sum(len(w.visible) for w in witnesses),
        )

    def _stand_in_errors(
        self, markers: NDArray[np.intp], visible: NDArray[np.intp], stranger: bool
    ) -> NDArray[np.float64]:
        """Return the error (mm) of each member for visible markers nearby.

        They are predicted as the missing ones are: from the same frames, companions, and in the
        mirror; or from a stranger who is the only witness.
        """
        bodies = self._witnesses.bodies
        frames, same_body = self._witnesses.shown(markers), sorted(bodies.same_body)
        squares = []
        for marker in visible[:STAND_INS]:
            alone, others = np.array([marker]), visible[visible != marker]
            if len(others) < FEWEST_VISIBLE:
                continue
            if stranger:
                speaking = self._witnesses.speaking_for(alone, others)[0]
                found = [w for w in speaking if w.body != OWN]
            else:
                found = self._witnesses.own(same_body, alone, others, frames)
            if all(w.mirrored for w in found) and bodies.contralateral[marker] == marker:
                continue  # a marker in the middle is its own image
            truth = self.task.positions[:, np.concatenate([others, alone])]
            truth = sample_complete_poses(truth, IMAGE_ROWS)
            if found and len(truth):
                ties = self._witnesses.ties(alone, others)
                told = predict_by_all(found, truth[:, :-1], ties, UNTOLD)
                off = told.positions[:, :, 0] - truth[:, -1]
                squares.append((off**2).sum(axis=2).mean(axis=1))
        if not squares:
            return np.full(len(VIEWS) * len(KINDS), UNTOLD)
        errors: NDArray[np.float64] = np.sqrt(np.mean(squares, axis=0))
        return errors
