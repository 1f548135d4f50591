"""Paths of markers in the frames of their nearest rigid neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.root_frames import rigid_frames
from priorfill.methods.gpr.short_gaps.options import ShortGapOptions
from priorfill.runtime.elementary import exp

__all__ = ["LocalPaths"]

MIN_NEIGHBOUR_WEIGHT = 1e-3
"""Added to the weights of the neighbours, in units of the greatest: a few near ones, perhaps on a
line, could leave the rotation undetermined."""

MIN_NEIGHBOURS = 3
"""Three points define a frame of reference."""

_Floats = NDArray[np.float64]
_Ints = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class LocalPaths:
    """Frames of reference of markers' neighbours, at some samples.

    Attributes
    ----------
    keys : ndarray of int [shape=(samples,)]
        ``marker * frames + frame`` of each sample, ascending, with the number of frames of the
        clip.
    frames : int
        That number.
    origin : ndarray [shape=(samples, 3), mm]
    rotation : ndarray [shape=(samples, 3, 3)]
        NaN where a neighbour is missing.
    """

    keys: _Ints
    frames: int
    origin: _Floats
    rotation: _Floats

    @classmethod
    def of(
        cls,
        poses: tuple[_Ints, _Floats],
        keys: _Ints,
        frames: int,
        geometry: tuple[_Floats, _Floats],
        options: ShortGapOptions,
    ) -> LocalPaths:
        """Estimate the frames of reference.

        Parameters
        ----------
        poses : ndarray of int [shape=(poses,)], ndarray [shape=(poses, markers, 3), mm]
            All frames that the keys need, ascending, and the clip in them; NaN where missing.
        keys : ndarray of int
            See `LocalPaths`.
        frames : int
            Of the clip.
        geometry : pair of ndarray [shape=(markers, markers), mm]
            Rms distance and spread of each pair of markers.
        options : ShortGapOptions
            Number and weights of the neighbours.
        """
        numbers, positions = poses
        origin = np.full((len(keys), 3), np.nan)
        rotation = np.full((len(keys), 3, 3), np.nan)
        markers = np.unique(keys // frames)
        edges = np.searchsorted(keys, np.append(markers, markers[-1:] + 1) * frames)
        for marker, start, stop in zip(markers, edges[:-1], edges[1:], strict=True):
            neighbours, weights = _neighbours(int(marker), *geometry, options)
            if len(neighbours) < MIN_NEIGHBOURS:
                continue
            rows = np.searchsorted(numbers, keys[start:stop] % frames)
            points = positions[rows[:, None], neighbours]
            complete = np.flatnonzero(np.isfinite(points).all(axis=(1, 2)))
            if not len(complete):
                continue
            template = points[complete[len(complete) // 2]]
            found = rigid_frames(points[complete], template, weights)
            origin[start + complete] = found.origin
            rotation[start + complete] = found.rotation
        return cls(keys, frames, origin, rotation)

    def at(self, markers: _Ints, frames: _Ints) -> tuple[_Floats, _Floats]:
        """Return origins and rotations of markers [shape=(gaps,)] in frames [shape=(gaps, n)]."""
        place = np.searchsorted(self.keys, markers[:, None] * self.frames + frames)
        return self.origin[place], self.rotation[place]


def _neighbours(
    marker: int, distance: _Floats, spread: _Floats, options: ShortGapOptions
) -> tuple[_Ints, _Floats]:
    """Return the best neighbours of a marker, and their weights."""
    usable = np.isfinite(distance[marker]) & np.isfinite(spread[marker])
    usable[marker] = False
    candidates = np.flatnonzero(usable)
    near = exp(-(distance[marker, candidates] ** 2) / (2.0 * options.length_scale**2))
    weights = near / (1.0 + (spread[marker, candidates] / options.rigidity_scale) ** 2)
    order = np.argsort(-weights, kind="stable")[: options.neighbours]
    order = order[weights[order] > 0.0]
    chosen = weights[order]
    return candidates[order], chosen + MIN_NEIGHBOUR_WEIGHT * chosen.max(initial=0.0)
