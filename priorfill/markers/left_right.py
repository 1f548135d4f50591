"""Pairs of markers on the left and the right side of the body."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from priorfill.markers.marker_set import MarkerSet

__all__ = ["contralateral_markers"]


def contralateral_markers(labels: Sequence[str], marker_set: MarkerSet) -> NDArray[np.intp]:
    """Return the contralateral marker of each marker.

    Parameters
    ----------
    labels : sequence of str
        The markers.
    marker_set : MarkerSet
        With mirror pairs under these labels.

    Returns
    -------
    ndarray of int [shape=(markers,)]
        Indices into ``labels``. A midline marker is its own; -1 for markers without one.

    See Also
    --------
    priorfill.geometry.mirror.mirrored : Mirror images of poses.
    """
    index = {label: i for i, label in enumerate(labels)}
    found = (index.get(marker_set.mirror.get(label, ""), -1) for label in labels)
    return np.fromiter(found, dtype=np.intp, count=len(labels))
