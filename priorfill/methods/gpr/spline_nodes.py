"""Knots: the frames of a limb's piece that are predicted; curves lead through the frames between.

Bodies move little above 10 Hz, and what is told of a limb is off by centimetres. So its frames
need not all be predicted: a curve through predictions that are as dense as movement asks for is as
good, and a clip of a higher rate takes no longer. Right at the edges, where the seam is, every
frame is predicted, and so is every frame of a single marker, of which a tenth of a millimetre is
known.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from priorfill.gp.ensemble import Regression
from priorfill.methods.gpr.gap_segments import Piece

__all__ = ["between", "knots"]

KNOT_RATE = 40.0
"""Hz. Least rate of the knots: of a movement of 8 Hz a cubic spline through them misses less than a
part in a hundred. On cases of limbs and segments errors were the same as with all frames, but for
0.7 % at most, as often better as worse."""

EDGE = 0.1
"""s. So far to either side of a piece's first and last frame all frames are knots."""


def knots(
    frames: NDArray[np.intp], piece: Piece, rate: float
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Choose the frames that are predicted.

    Parameters
    ----------
    frames : ndarray of int
        Those of the piece, and some beside it.
    piece : Piece
        What is missing.
    rate : float
        Hz.

    Returns
    -------
    chosen : ndarray of int
        The first and the last of the frames among them.
    even : ndarray of bool [shape=(chosen,)]
        Which of them are in the piece, and evenly spread over it.
    """
    step = max(1, int(rate / KNOT_RATE)) if len(piece.markers) > 1 else 1
    edge = int(np.ceil(EDGE * rate))
    inside = (frames >= piece.start) & (frames < piece.stop)
    spread = inside & ((frames - piece.start) % step == 0)
    chosen = spread | (frames < piece.start + edge) | (frames >= piece.stop - edge)
    return frames[chosen], spread[chosen]


def between(found: Regression, chosen: NDArray[np.intp]) -> Regression:
    """Lead curves through what is predicted of knots.

    Parameters
    ----------
    found : Regression
        Of the knots.
    chosen : ndarray of int
        Their frames.

    Returns
    -------
    Regression
        Of every frame from the first knot to the last; of the knots what was found.
    """
    frames = np.arange(chosen[0], chosen[-1] + 1)
    if len(frames) == len(chosen):
        return found
    at = chosen - chosen[0]

    def curve(values: NDArray[np.float64]) -> NDArray[np.float64]:
        led: NDArray[np.float64] = CubicSpline(chosen, values)(frames)
        led[at] = values
        return led

    def line(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack([np.interp(frames, chosen, column) for column in values.T], axis=1)

    motion = found.motion
    if motion is not None:
        motion = replace(
            motion, velocity=curve(motion.velocity), expected_rms=line(motion.expected_rms)
        )
    return replace(
        found,
        positions=curve(found.positions),
        expected_rms=line(found.expected_rms),
        motion=motion,
    )
