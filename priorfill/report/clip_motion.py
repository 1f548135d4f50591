"""How the markers of a filled clip move where they are measured, to compare fills with it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.distances import norms
from priorfill.geometry.floor_heights import floor_heights
from priorfill.geometry.step_lengths import greatest_step, step_lengths

__all__ = ["ClipMotion", "RigidPartner"]

STEP_SECONDS = 0.01
"""s. Time step of speeds and jumps; the noise of shorter ones hides the motion."""

NEIGHBOURS = 5
"""Markers nearest to a marker that show how its part of the body moves at a time."""

AROUND_SECONDS = 0.1
"""s. Neighbours move at the same time if they do so within this time."""

MIN_COMMON = 30
"""Frames that must show both markers of a rigid pair."""

MAX_PARTNERS = 4
"""Markers of the same segment that a marker is compared with, the most rigid ones."""

MAX_LENGTH_SPREAD = 8.0
"""mm. Greatest standard deviation of the distance of a rigid pair. Skin over muscles moves markers
of one segment by as much."""

MAX_SAMPLED = 200
"""Frames from which the nearest markers are found."""


@dataclass(frozen=True)
class RigidPartner:
    """A marker at a nearly constant distance.

    Attributes
    ----------
    marker : int
        The marker.
    low, high, mean : float
        The smallest, greatest and mean measured distance (mm).
    """

    marker: int
    low: float
    high: float
    mean: float


@dataclass(frozen=True, eq=False)
class ClipMotion:
    """Measured motion of the markers of one subject.

    Attributes
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        Upright, measured and filled; NaN where missing.
    measured : ndarray of bool [shape=(frames, markers)]
        Measured samples that are not in doubt.
    filled : ndarray of bool [shape=(frames, markers)]
        Filled samples.
    segment : tuple of str
        The segment of each marker.
    contralateral : ndarray of int [shape=(markers,)]
        The contralateral marker of each marker; -1 where there is none.
    rate : float
        Hz.
    """

    positions: NDArray[np.float64]
    measured: NDArray[np.bool_]
    filled: NDArray[np.bool_]
    segment: tuple[str, ...]
    contralateral: NDArray[np.intp]
    rate: float

    @cached_property
    def step(self) -> int:
        """Frames of a time step."""
        return max(round(STEP_SECONDS * self.rate), 1)

    @cached_property
    def floor(self) -> NDArray[np.float64]:
        """Height at which the floor stops each marker (mm); minus infinity where unknown."""
        seen = np.where(self.measured[..., None], self.positions, np.nan)
        return floor_heights(seen, self.contralateral)

    def measured_path(self, marker: int) -> NDArray[np.float64]:
        """Return the measured positions of a marker [shape=(frames, 3), mm]; NaN elsewhere."""
        path = self.positions[:, marker].copy()
        path[~self.measured[:, marker]] = np.nan
        return path

    def greatest(self, marker: int, order: int) -> float:
        """Return the greatest measured step (order 1) or change of it (2) of a marker.

        Parameters
        ----------
        marker : int
            The marker; its contralateral marker counts as well.
        order : int
            1 or 2.

        Returns
        -------
        float
            mm in a time step; infinite where too little is measured.
        """
        pair = (marker, int(self.contralateral[marker]))
        found = [self._greatest(one, order) for one in pair if one >= 0]
        return max((one for one in found if not math.isnan(one)), default=math.inf)

    @cached_property
    def _greatest_of(self) -> dict[tuple[int, int], float]:
        return {}

    def _greatest(self, marker: int, order: int) -> float:
        """Return the greatest measured step of a marker alone (mm); NaN where it is unknown."""
        if (marker, order) not in self._greatest_of:
            self._greatest_of[marker, order] = greatest_step(
                step_lengths(self.measured_path(marker), self.step, order)
            )
        return self._greatest_of[marker, order]

    def around(self, marker: int, start: int, stop: int, order: int) -> float:
        """Return the second greatest of the greatest steps of neighbours in some frames.

        The fastest of them may have a wrong label.

        Parameters
        ----------
        marker : int
            The marker.
        start, stop : int
            Frames, to which `AROUND_SECONDS` are added on both sides.
        order : int
            As for `greatest`.

        Returns
        -------
        float
            mm in a time step; 0 where fewer than two neighbours are measured.
        """
        reach = max(round(AROUND_SECONDS * self.rate), self.step)
        frames = slice(max(start - reach, 0), stop + reach)
        fastest = []
        for other in self._nearest(marker):
            path = self.positions[frames, other].copy()
            path[~self.measured[frames, other]] = np.nan
            steps = step_lengths(path, self.step, order)
            if not np.isnan(steps).all():
                fastest.append(float(np.nanmax(steps)))
        return sorted(fastest)[-2] if len(fastest) > 1 else 0.0

    def _nearest(self, marker: int) -> list[int]:
        """Return the markers nearest to a marker, by their median distance where both are known."""
        if marker not in self._nearest_of:
            sample = self.positions[:: max(1, len(self.positions) // MAX_SAMPLED)]
            apart = norms(sample - sample[:, marker : marker + 1])
            known = ~np.isnan(apart)
            count = known.sum(axis=0)
            mean = np.where(known, apart, 0.0).sum(axis=0) / np.maximum(count, 1)
            mean[count == 0] = np.inf
            mean[marker] = np.inf
            order = np.argsort(mean, kind="stable")[:NEIGHBOURS]
            self._nearest_of[marker] = [int(one) for one in order if np.isfinite(mean[one])]
        return self._nearest_of[marker]

    @cached_property
    def _nearest_of(self) -> dict[int, list[int]]:
        return {}

    def nearest_distance(self, marker: int, start: int, stop: int) -> tuple[float, int]:
        """Return the smallest mean distance (mm) from another marker in some frames, and which.

        Parameters
        ----------
        marker : int
            The marker.
        start, stop : int
            Frames.
        """
        path = self.positions[start:stop, marker]
        best = (math.inf, -1)
        for other in self._nearest(marker):
            apart = norms(path - self.positions[start:stop, other])
            apart = apart[~np.isnan(apart)]
            if len(apart):
                best = min(best, (float(apart.mean()), other))
        return best

    def partners(self, marker: int) -> tuple[RigidPartner, ...]:
        """Return the markers at a nearly constant measured distance from a marker.

        Parameters
        ----------
        marker : int
            The marker.
        """
        if marker not in self._partners_of:
            self._partners_of[marker] = tuple(self._find_partners(marker))
        return self._partners_of[marker]

    @cached_property
    def _partners_of(self) -> dict[int, tuple[RigidPartner, ...]]:
        return {}

    def _find_partners(self, marker: int) -> list[RigidPartner]:
        path = self.measured_path(marker)
        found = []
        for other in self._members.get(self.segment[marker], ()):
            if other == marker:
                continue
            length = norms(path - self.measured_path(other))
            length = length[~np.isnan(length)]
            if len(length) >= MIN_COMMON and length.std() < MAX_LENGTH_SPREAD:
                low, high = float(length.min()), float(length.max())
                partner = RigidPartner(other, low, high, float(length.mean()))
                found.append((float(length.std()), other, partner))
        return [partner for _, _, partner in sorted(found)[:MAX_PARTNERS]]

    @cached_property
    def _members(self) -> dict[str, list[int]]:
        """Markers of each segment."""
        members: dict[str, list[int]] = {}
        for marker, name in enumerate(self.segment):
            if name:
                members.setdefault(name, []).append(marker)
        return members

    def steps(self, marker: int, start: int, stop: int, order: int) -> NDArray[np.float64]:
        """Return the steps (order 1) or their changes (2) of a marker around some frames.

        Parameters
        ----------
        marker : int
            The marker.
        start, stop : int
            Frames; the steps that begin, pass or end in them are returned.
        order : int
            1 or 2.

        Returns
        -------
        ndarray [shape=(steps,), mm]
            Only those whose ends are all known.
        """
        reach = order * self.step
        path = self.positions[max(start - reach, 0) : stop + reach, marker]
        steps = step_lengths(path, self.step, order)
        return np.asarray(steps[~np.isnan(steps)])
