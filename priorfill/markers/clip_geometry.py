"""The geometry of one clip, computed once: validity, distances, marker set, mirror pairs, floor."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.distances import MIN_COMMON_POSES, PairStatistics, pair_statistics
from priorfill.geometry.floor_heights import floor_heights
from priorfill.markers.describe import describe_markers
from priorfill.markers.left_right import contralateral_markers
from priorfill.markers.marker_set import MarkerSet

__all__ = ["ClipGeometry"]


@dataclass(frozen=True, eq=False)
class ClipGeometry:
    """Properties of a clip's markers that follow from their positions, each computed on first use.

    Attributes
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        Upright, NaN where missing.
    labels : tuple of str
        The markers.
    definition : MarkerSet or None
        Definition of the marker set; None if it is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> positions = np.zeros((10, 2, 3))
    >>> positions[:, 1, 0] = 300.0
    >>> ClipGeometry(positions, ("LKNE", "RKNE")).distance[0, 1]
    np.float64(300.0)
    """

    positions: NDArray[np.float64]
    labels: tuple[str, ...]
    definition: MarkerSet | None = None

    @cached_property
    def valid(self) -> NDArray[np.bool_]:
        """Which samples are measured [shape=(frames, markers)]."""
        return ~np.isnan(self.positions[..., 0])

    def completed(self, positions: NDArray[np.float64]) -> ClipGeometry:
        """Return the geometry of the clip with some missing samples filled.

        Distances, pairs and floor are those of the measured samples.

        Parameters
        ----------
        positions : ndarray [shape=(frames, markers, 3), mm]
            Of the clip; measured samples unchanged.
        """
        other = ClipGeometry(positions, self.labels, self.definition)
        for name in ("pairs", "_distances", "marker_set", "contralateral", "floor"):
            other.__dict__[name] = getattr(self, name)  # where cached properties keep their value
        return other

    @cached_property
    def pairs(self) -> PairStatistics:
        """Statistics of the distance of each pair of markers."""
        return pair_statistics(self.positions)

    @cached_property
    def _distances(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return self.pairs.of_common(MIN_COMMON_POSES)

    @property
    def distance(self) -> NDArray[np.float64]:
        """Rms distance of each pair [shape=(markers, markers), mm]; infinite where unknown."""
        return self._distances[0]

    @property
    def spread(self) -> NDArray[np.float64]:
        """Standard deviation of these distances [shape=(markers, markers), mm]."""
        return self._distances[1]

    @cached_property
    def marker_set(self) -> MarkerSet:
        """Segments, reliability and mirror pairs of all the clip's markers."""
        return describe_markers(self.labels, self.positions, self.definition, lambda: self.pairs)

    @cached_property
    def contralateral(self) -> NDArray[np.intp]:
        """Each marker's contralateral marker [shape=(markers,)]; -1 where there is none."""
        return contralateral_markers(self.labels, self.marker_set)

    @cached_property
    def floor(self) -> NDArray[np.float64]:
        """Height at which the floor stops each marker [shape=(markers,), mm]."""
        return floor_heights(self.positions, self.contralateral)
