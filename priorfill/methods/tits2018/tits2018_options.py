"""Every constant of the method, with the figure of the published program."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from priorfill.methods.gloersen2016.strategies import Gloersen2016Options

__all__ = ["Tits2018Options", "thinned"]


@dataclass(frozen=True)
class Tits2018Options:
    """Options of Tits et al. 2018; the defaults are those of their program.

    Attributes
    ----------
    presence : float
        Markers seen in less than this share of the frames are neither filled nor used.
    window : float
        Seconds: length of the moving median and mean.
    complete : int
        With more frames that show every marker, distances are judged by these alone.
    distance_rows : int
        Frames that distances are judged by, at most.
    stiff : float
        mm: the global regression uses markers whose distance from the missing one has at most
        this standard deviation, or all where there is none.
    global_rows, local_rows, density_rows : int
        Frames to learn from: of the global regression, of the local models, of the densities
        of distances. See `thinned`.
    spread : float
        Distance, in standard deviations of a feature, at which a frame's say in the
        generalised regression network is half.
    narrow, wide : float
        Quantiles of a distance between which the skeleton constraint keeps it.
    rounds : int
        How often the skeleton constraint goes round the three references.
    pca : Options of `priorfill.methods.gloersen2016`
        Weights and components of the weighted PCA: those of its publication, here too.
    """

    presence: float = 0.3
    window: float = 0.07
    complete: int = 300
    distance_rows: int = 5000
    stiff: float = 50.0
    global_rows: int = 500
    local_rows: int = 1000
    density_rows: int = 500
    spread: float = 0.3
    narrow: float = 0.01
    wide: float = 0.99
    rounds: int = 5
    pca: Gloersen2016Options = field(default_factory=Gloersen2016Options)


def thinned(count: int, most: int) -> NDArray[np.intp]:
    """Choose rows to learn from as the published program does.

    Fewer than ``most`` are all taken; of twice as many and more every n-th, n as large as leaves
    at least ``most``. Between the two the program draws ``most`` at random; here they are spread
    evenly, so that the result is the same every time.

    Parameters
    ----------
    count : int
        How many there are.
    most : int
        How many are enough.

    Returns
    -------
    ndarray of int [shape=(chosen,)]
        In rising order.
    """
    if count < most:
        return np.arange(count)
    if count < 2 * most:
        return spread_evenly(count, most)
    return np.arange(0, count, count // most)


def spread_evenly(count: int, most: int) -> NDArray[np.intp]:
    """Choose at most ``most`` of ``count`` rows, the same distance apart but for rounding."""
    if count <= most:
        return np.arange(count)
    return np.linspace(0, count - 1, most).round().astype(np.intp)
