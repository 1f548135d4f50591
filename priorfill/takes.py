"""Takes: the recordings that a fill may learn from, in the clip's own order of markers.

A take is a recording of the prior database, or the clip that is being filled itself. Every one
is brought into the same shape: upright, mm, one column for each marker of the clip, NaN where
the take does not have it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from priorfill.markerset import MarkerSet, same_markers
from priorfill.resample import Level, pyramid

if TYPE_CHECKING:
    from priorfill.database import PriorDatabase

__all__ = ["Take", "own_take", "takes_from"]


@dataclass(frozen=True, eq=False)
class Take:
    """A recording that a fill may learn from.

    Attributes
    ----------
    name : str
        What it is called in reports.
    subject : str
        Whose motion it is; empty if unknown.
    levels : tuple of Level
        Its resolutions, finest first; positions [shape=(frames, markers, 3), mm], upright, in
        the clip's order of markers.
    own : bool
        Whether it is the clip that is being filled.
    """

    name: str
    subject: str
    levels: tuple[Level, ...] = field(repr=False)
    own: bool = False

    def nearest_level(self, rate: float) -> Level:
        """Return the resolution whose rate is nearest to ``rate`` (Hz) as a ratio."""
        return min(self.levels, key=lambda level: abs(np.log(level.rate / rate)))


def own_take(
    positions: NDArray[np.float64], rate: float, levels: int, name: str, subject: str
) -> Take:
    """Make a take of the clip itself; its gaps stay missing.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        The clip, upright.
    rate : float
        Its rate, Hz.
    levels : int
        How many resolutions.
    name, subject : str
        Of the clip.
    """
    return Take(name, subject, tuple(pyramid(positions, rate, levels)), own=True)


def takes_from(
    database: PriorDatabase, labels: Sequence[str], marker_set: MarkerSet | None = None
) -> tuple[Take, ...]:
    """Make a take of each clip of a database that has at least one of a clip's markers.

    Parameters
    ----------
    database : PriorDatabase
        Opened.
    labels : sequence of str
        The clip's labels, in its order.
    marker_set : MarkerSet, optional
        Definition whose other spellings count too.

    Returns
    -------
    tuple of Take
        In the database's order. Positions are float32.
    """
    takes = []
    for record in database.clips():
        shared, there = same_markers(labels, record.labels, marker_set)
        if not shared:
            continue
        levels = []
        for number in range(database.levels):
            stored = database.positions(record, number)
            positions: NDArray[Any] = np.full(
                (len(stored), len(labels), 3), np.nan, dtype=np.float32
            )
            positions[:, shared] = stored[:, there]
            levels.append(Level(positions, database.rate / 2**number, 2**number))
        takes.append(Take(record.name, record.subject, tuple(levels)))
    return tuple(takes)
