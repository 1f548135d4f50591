"""Pieces: what a regression predicts at once.

Gaps of neighbouring markers with the same frames are predicted jointly. Where the visible markers
change inside a gap it is cut into pieces, but only where a piece would otherwise lose markers that
matter to it.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from priorfill.gaps import GapGroup, constant_spans
from priorfill.geometry.clustering import single_linkage

__all__ = ["Piece", "pieces_of"]

JOINT_DISTANCE = 350.0
"""mm; markers missing in the same frames are predicted jointly when a chain of them is no further
apart than this: the markers of a limb are, two limbs are not."""

REACH = 220.0
"""mm; a visible marker matters to a missing one at distance D as exp(-D² / 2 REACH²)."""

FAR_WEIGHT = 0.005
"""What a far marker matters."""

LOST_WEIGHT = 0.1
"""Neighbouring pieces become one if it loses no more than this part of what matters."""

MAX_PIECES = 8
"""A gap is not cut into more pieces than this while `HEAVY_LOSS` is not exceeded."""

HEAVY_LOSS = 0.5
"""More than this part of what matters is never lost to save pieces."""

FEWEST_VISIBLE = 3
"""Visible markers that a piece needs: three points make a frame of reference."""


@dataclass(frozen=True, eq=False)
class Piece:
    """Markers missing together in frames ``start <= frame < stop``, and who is visible.

    Attributes
    ----------
    markers : ndarray of int [shape=(missing markers,)]
        Missing in all of these frames.
    start, stop : int
        Frames of the clip.
    visible : ndarray of int [shape=(visible markers,)]
        Measured in all of these frames.
    """

    markers: NDArray[np.intp]
    start: int
    stop: int
    visible: NDArray[np.intp]

    @property
    def searchable(self) -> bool:
        """Whether enough markers are visible to say anything of the missing ones."""
        return len(self.visible) >= FEWEST_VISIBLE

    def around(
        self, valid: NDArray[np.bool_], visible: NDArray[np.intp], margin: int
    ) -> NDArray[np.intp]:
        """Return its frames and those beside it, as far as some markers are measured.

        Parameters
        ----------
        valid : ndarray of bool [shape=(frames, markers)]
            Which samples of the clip are measured.
        visible : ndarray of int
            The markers that must be.
        margin : int
            Frames on either side at most.
        """
        first, last = self.start, self.stop
        while first > max(0, self.start - margin) and valid[first - 1, visible].all():
            first -= 1
        while last < min(len(valid), self.stop + margin) and valid[last, visible].all():
            last += 1
        return np.arange(first, last)


def _joint_gaps(
    group: GapGroup, distance: NDArray[np.float64]
) -> list[tuple[NDArray[np.intp], int, int]]:
    """Markers, start and stop of gaps that are predicted jointly."""
    together: dict[tuple[int, int], list[int]] = {}
    for gap in group.gaps:
        together.setdefault((gap.start, gap.stop), []).append(gap.marker)
    joint = []
    for (start, stop), markers in together.items():
        chosen = np.array(markers, dtype=np.intp)
        # markers never seen together are far apart for all we know
        limbs = single_linkage(distance[np.ix_(chosen, chosen)], JOINT_DISTANCE)
        joint += [(chosen[limb], start, stop) for limb in limbs]
    return joint


def pieces_of(
    group: GapGroup, valid: NDArray[np.bool_], distance: NDArray[np.float64]
) -> list[Piece]:
    """Cut a gap group into pieces.

    Parameters
    ----------
    group : GapGroup
        What is missing.
    valid : ndarray of bool [shape=(frames, markers)]
        Which samples of the clip are measured.
    distance : ndarray [shape=(markers, markers), mm]
        Rms distance of each pair of markers; infinite where unknown.

    Returns
    -------
    list of Piece
        Every missing sample of the group in exactly one of them, in order of time.
    """
    pieces = []
    for markers, start, stop in _joint_gaps(group, distance):
        seen = valid[start:stop].copy()
        seen[:, markers] = False
        nearest = distance[markers].min(axis=0)
        weight = np.exp(-(nearest**2) / (2.0 * REACH**2)) + FAR_WEIGHT
        spans = [(a, b, seen[a]) for a, b in constant_spans(seen)]
        while len(spans) > 1:
            losses = [_loss(weight, one, other) for (_, _, one), (_, _, other) in pairwise(spans)]
            least = int(np.argmin(losses))
            bearable = LOST_WEIGHT if len(spans) <= MAX_PIECES else HEAVY_LOSS
            if losses[least] > bearable:
                break
            (a, _, one), (_, b, other) = spans[least], spans[least + 1]
            spans[least : least + 2] = [(a, b, one & other)]
        pieces += [
            Piece(markers, start + a, start + b, np.flatnonzero(visible)) for a, b, visible in spans
        ]
    return sorted(pieces, key=lambda piece: (piece.start, piece.markers[0]))


def _loss(weight: NDArray[np.float64], one: NDArray[np.bool_], other: NDArray[np.bool_]) -> float:
    """Return what two spans lose of the weight of their visible markers by becoming one."""
    both = one & other
    if both.sum() < FEWEST_VISIBLE <= max(one.sum(), other.sum()):
        return 1.0
    most = max(weight[one].sum(), weight[other].sum())
    return float(1.0 - weight[both].sum() / most) if most > 0 else 0.0
