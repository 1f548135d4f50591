"""Pairs of markers on the left and right side of the body."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from priorfill.markers.marker_set import MarkerSet

__all__ = ["contralateral_markers"]


def contralateral_markers(labels: Sequence[str], marker_set: MarkerSet) -> NDArray[np.intp]:
    """Return the partner of each marker on the other side of the body [shape=(markers,)].

    A marker in the middle is its own; -1 for those that have none among the labels.
    """
    index = {label: i for i, label in enumerate(labels)}
    found = (index.get(marker_set.mirror.get(label, ""), -1) for label in labels)
    return np.fromiter(found, dtype=np.intp, count=len(labels))
