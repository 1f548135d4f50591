"""Pieces of any length to learn from: of the clip, and of windows of the database."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.li2020.li2020_options import Li2020Options
from priorfill.methods.li2020.training_windows import choose_windows
from priorfill.methods.task import Task
from priorfill.signal.resample import resample

__all__ = ["PieceSources", "stretch"]

Array = NDArray[np.float64]


def stretch(start: int, stop: int, frames: int, options: Li2020Options) -> tuple[int, int]:
    """Return the frames of a gap with the frames around it that are used, inside the clip."""
    context = max(options.min_context_frames, round(options.context * (stop - start)))
    return max(start - context, 0), min(stop + context, frames)


class PieceSources:
    """Sources of pieces, at the rate of the clip.

    Parameters
    ----------
    task : Task
        The clip, and the takes from which windows are chosen.
    markers : ndarray of int
        Markers of the pieces, in the clip's order; windows show all of them.
    options : Li2020Options
        Choice of windows, and distance of pieces.

    Attributes
    ----------
    takes : tuple of str
        Names of the recordings, without the clip.
    """

    def __init__(self, task: Task, markers: NDArray[np.intp], options: Li2020Options) -> None:
        clip = task.positions[:, markers]
        chosen = choose_windows(clip, task.rate, task.takes, markers, options)
        self._stride = options.stride
        self._sources = [
            clip,
            *(resample(window.positions, window.rate, task.rate) for window in chosen),
        ]
        self.takes = tuple(dict.fromkeys(window.name for window in chosen))

    def pieces(self, length: int) -> Iterator[Array]:
        """Yield the pieces of a length [shape=(length, markers, 3), mm], with their gaps."""
        stride = max(1, int(self._stride * length))
        for positions in self._sources:
            for start in range(0, len(positions) - length + 1, stride):
                yield positions[start : start + length]
