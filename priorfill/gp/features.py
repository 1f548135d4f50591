"""Features of poses: alignment, weights of the visible markers, and lagged positions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.root_frames import RootFrames, heading_frames, rigid_frames
from priorfill.runtime.elementary import exp

__all__ = ["Alignment", "LagFeature", "MarkerWeights"]

MIN_ALIGNMENT_WEIGHT = 1e-3
"""Added to the weight of each visible marker in the alignment, which a few near markers, perhaps
on a line, could leave undetermined."""


@dataclass(frozen=True, eq=False)
class MarkerWeights:
    """Weights of the visible markers.

    Attributes
    ----------
    alignment : ndarray [shape=(visible markers,)]
        In the least-squares alignment.
    features : ndarray [shape=(visible markers,)]
        Factor of a marker's coordinates among the features.
    """

    alignment: NDArray[np.float64]
    features: NDArray[np.float64]


@dataclass(frozen=True)
class Alignment:
    """How poses are aligned, and how visible markers are weighted.

    Attributes
    ----------
    frame : {"rigid", "heading"}
        Whether poses are aligned by the rotation of the visible markers or by their heading alone.
    length_scale : float
        mm. A visible marker at the distance D from the missing ones has the weight
        exp(-D² / 2 length_scale²).
    min_weight : float
        Added to the weight of each marker's coordinates among the features.
    rigidity_scale : float or None
        mm. Standard deviation of the distance to the missing markers at which a marker has half of
        that weight in the alignment. None: rigidity is not used.
    """

    frame: Literal["rigid", "heading"]
    length_scale: float
    min_weight: float
    rigidity_scale: float | None = None

    def marker_weights(
        self, distance: NDArray[np.float64], spread: NDArray[np.float64]
    ) -> MarkerWeights:
        """Return the weights of visible markers.

        Parameters
        ----------
        distance, spread : ndarray [shape=(visible markers,), mm]
            Rms distance of each marker to the nearest missing one, and its standard deviation.

        Examples
        --------
        >>> import numpy as np
        >>> alignment = Alignment("rigid", length_scale=200.0, min_weight=0.0, rigidity_scale=10.0)
        >>> distance, spread = np.array([0.0, 200.0, 200.0]), np.array([0.0, 0.0, 10.0])
        >>> alignment.marker_weights(distance, spread).features.round(3)
        array([1.   , 0.607, 0.429])
        """
        near = exp(-(distance**2) / (2.0 * self.length_scale**2))
        rigidity = np.ones_like(near)
        if self.rigidity_scale is not None:
            rigidity = 1.0 / (1.0 + (spread / self.rigidity_scale) ** 2)
        return MarkerWeights(
            near * rigidity + MIN_ALIGNMENT_WEIGHT, near * np.sqrt(rigidity) + self.min_weight
        )

    def root_frames(
        self,
        poses: NDArray[np.float64],
        template: NDArray[np.float64],
        weights: MarkerWeights,
    ) -> RootFrames:
        """Align poses with a template.

        Parameters
        ----------
        poses : ndarray [shape=(poses, visible markers, 3), mm]
            Upright, complete.
        template : ndarray [shape=(visible markers, 3), mm]
            The pose that they are aligned with.
        weights : MarkerWeights
            Of the visible markers.
        """
        align = rigid_frames if self.frame == "rigid" else heading_frames
        return align(poses, template, weights.alignment)


@dataclass(frozen=True)
class LagFeature:
    """The visible markers a short time before and after a pose, as additional features.

    Attributes
    ----------
    seconds : float
        The lag: how long before and after.
    weight : float
        Factor of these features; that of the pose itself is 1.
    velocity : bool
        Whether the displacement from before to after is the feature; otherwise both positions are.
    """

    seconds: float
    weight: float
    velocity: bool = False
