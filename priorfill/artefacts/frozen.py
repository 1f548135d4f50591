"""Frozen samples: a marker that keeps exactly the same place while its partners move on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.artefacts.reference_markers import ReferenceMarkers, distances
from priorfill.gaps import runs

__all__ = ["Frozen", "frozen_runs"]

FEWEST = 4
"""Equal samples in a row. Measured floats are never equal three times running, coarse integers are:
those are told by the partners."""

MOVED = 5.0
"""mm by which half of the partners must have left their place in the meantime: well above noise and
the sway of someone who stands."""

STRETCHED = 2.0
"""mm by which a distance to a partner must change: a foot that turns about a marker at rest, in
a file of coarse numbers, changes none."""


@dataclass(frozen=True)
class Frozen:
    """Frames ``start <= frame < stop`` in which a marker keeps its place.

    Attributes
    ----------
    marker, start, stop : int
        The marker and the frames.
    partner : int
        The partner that goes farthest meanwhile.
    moved : float
        mm by which it does.
    """

    marker: int
    start: int
    stop: int
    partner: int
    moved: float


def frozen_runs(positions: NDArray[np.float64], partners: ReferenceMarkers) -> list[Frozen]:
    """Return the runs of equal samples that no body makes.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    partners : Partners
        Who judges whom.
    """
    # coordinate by coordinate: a third of the time of all at once
    equal = positions[1:, :, 0] == positions[:-1, :, 0]
    for axis in (1, 2):
        equal &= positions[1:, :, axis] == positions[:-1, :, axis]
    found = []
    for marker in np.flatnonzero(equal.sum(axis=0) >= FEWEST - 1).tolist():
        others = partners.of(marker)
        spans = np.array(list(runs(equal[:, marker])), dtype=np.intp).reshape(-1, 2)
        spans = spans[spans[:, 1] - spans[:, 0] >= FEWEST - 1]
        spans = spans[_partners_leave(positions, others, spans)]
        for start, last in spans.tolist():
            length = distances(positions[start : last + 1], marker, others)
            changed = np.abs(length - length[:1])
            if np.nanmax(changed, initial=0.0) > STRETCHED:
                beside = positions[start : last + 1, others]
                gone = np.nan_to_num(np.sqrt(((beside - beside[:1]) ** 2).sum(axis=2))).max(axis=0)
                judge = int(gone.argmax())
                found.append(
                    Frozen(marker, start, last + 1, int(others[judge]), float(gone[judge]))
                )
    return found


def _partners_leave(
    positions: NDArray[np.float64], others: NDArray[np.intp], spans: NDArray[np.intp]
) -> NDArray[np.bool_]:
    """Return whether half of the partners leave their place in each span (first, last frame)."""
    start, last = spans.T
    away = np.zeros((len(spans), len(others)), dtype=bool)
    here = positions[start[:, None], others]
    for then in (last, (start + last) // 2):  # there and back leaves it in the middle
        gone = ((positions[then[:, None], others] - here) ** 2).sum(axis=2)
        away |= np.nan_to_num(gone) > MOVED**2
    leaves: NDArray[np.bool_] = (2 * away.sum(axis=1) >= len(others)) & away.any(axis=1)
    return leaves
