"""The looks of a prediction: feet on the floor, and no more jitter than what is measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from priorfill.constraints.distance_terms import MAX_CONSTRAINED_SPREAD
from priorfill.constraints.floor import enforce_floor
from priorfill.methods.gpr.prediction import Prediction
from priorfill.methods.task import Task
from priorfill.signal.smoothing import jitter_power, smooth_jitter

__all__ = ["Finish"]


class Finish:
    """Finishes the predictions of one task. They do not depend on each other.

    Parameters
    ----------
    task : Task
        The clip.
    spread : ndarray [shape=(markers, markers), mm]
        How much each distance varies, as `priorfill.geometry.distances.pair_distances` gives it.
    """

    def __init__(self, task: Task, spread: NDArray[np.float64]) -> None:
        self._task = task
        self._spread = spread
        self._shaking: dict[int, float] = {}

    def __call__(self, prediction: Prediction) -> Prediction:
        """Lift a prediction out of the floor, then calm it."""
        lifted = self.enforce_floor(prediction)
        usual = np.array([self._usual(int(marker)) for marker in prediction.piece.markers])
        positions = smooth_jitter(lifted.positions, lifted.expected_rms, usual, self._task.rate)
        return replace(lifted, positions=positions)

    def enforce_floor(self, prediction: Prediction) -> Prediction:
        """Lift a prediction out of the floor."""
        markers, visible = prediction.piece.markers, prediction.piece.visible
        # visible markers that a missing one is firmly tied to; others take no part
        held = visible[
            (self._spread[np.ix_(markers, visible)] < MAX_CONSTRAINED_SPREAD).any(axis=0)
        ]
        frames = slice(prediction.first, prediction.last)
        positions = enforce_floor(
            prediction.positions,
            prediction.expected_rms,
            self._task.positions[frames, held],
            self._spread[np.ix_(markers, np.concatenate([markers, held]))],
            self._task.geometry.floor[markers],
            self._task.rate,
        )
        return replace(prediction, positions=positions)

    def _usual(self, marker: int) -> float:
        """Return how much a marker shakes where it is measured."""
        if marker not in self._shaking:
            self._shaking[marker] = jitter_power(
                self._task.positions[:, marker].astype(np.float64), self._task.rate
            )
        return self._shaking[marker]
