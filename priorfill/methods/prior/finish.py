"""The looks of a prediction: feet on the floor, and no more jitter than what is measured."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from priorfill.calm import calm, shaking
from priorfill.floor import floor_heights, lift
from priorfill.methods.prior.prediction import Prediction
from priorfill.methods.task import Task
from priorfill.springs import STIFF

__all__ = ["Finish"]


class Finish:
    """Finishes the predictions of one task. They do not depend on each other.

    Parameters
    ----------
    task : Task
        The clip.
    spread : ndarray [shape=(markers, markers), mm]
        How much each distance varies, as `priorfill.distances.pair_distances` gives it.
    """

    def __init__(self, task: Task, spread: NDArray[np.float64]) -> None:
        self._task = task
        self._spread = spread
        self._shaking: dict[int, float] = {}

    def __call__(self, prediction: Prediction) -> Prediction:
        """Lift a prediction out of the floor, then calm it."""
        lifted = self.lift(prediction)
        usual = np.array([self._usual(int(marker)) for marker in prediction.piece.markers])
        positions = calm(lifted.positions, lifted.deviation, usual, self._task.rate)
        return replace(lifted, positions=positions)

    def lift(self, prediction: Prediction) -> Prediction:
        """Lift a prediction out of the floor."""
        markers, visible = prediction.piece.markers, prediction.piece.visible
        # visible markers that a missing one is firmly tied to; others take no part
        held = visible[(self._spread[np.ix_(markers, visible)] < STIFF).any(axis=0)]
        frames = slice(prediction.first, prediction.last)
        positions = lift(
            prediction.positions,
            prediction.deviation,
            self._task.positions[frames, held],
            self._spread[np.ix_(markers, np.concatenate([markers, held]))],
            self._floor[markers],
            self._task.rate,
        )
        return replace(prediction, positions=positions)

    @cached_property
    def _floor(self) -> NDArray[np.float64]:
        """Where the floor stops each marker (mm)."""
        return floor_heights(self._task.positions, self._task.partner)

    def _usual(self, marker: int) -> float:
        """Return how much a marker shakes where it is measured."""
        if marker not in self._shaking:
            self._shaking[marker] = shaking(
                self._task.positions[:, marker].astype(np.float64), self._task.rate
            )
        return self._shaking[marker]
