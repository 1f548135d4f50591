"""Mirror images."""

from __future__ import annotations

import numpy as np
from gappy import person

from priorfill.geometry.mirror import mirrored
from priorfill.markers.discover import discover
from priorfill.markers.left_right import contralateral_markers

LABELS = ("LANK", "RANK", "LKNE", "T10")


def test_contralateral_markers_by_their_labels() -> None:
    marker_set = discover(np.random.default_rng(0).normal(size=(20, 4, 3)), LABELS)
    assert contralateral_markers(LABELS, marker_set).tolist()[:3] == [1, 0, -1]


def test_image_of_the_image() -> None:
    clip = person()
    contralateral = contralateral_markers(clip.labels, discover(clip.positions, clip.labels))
    image = mirrored(clip.positions, contralateral)
    left, right = clip.labels.index("LELB"), clip.labels.index("RELB")
    np.testing.assert_array_equal(image[:, left], clip.positions[:, right] * [-1.0, 1.0, 1.0])
    assert np.isnan(image[:, contralateral < 0]).all()
    paired = contralateral >= 0
    again = mirrored(image, contralateral)
    np.testing.assert_array_equal(again[:, paired], clip.positions[:, paired])
