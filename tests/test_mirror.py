"""Mirror images."""

from __future__ import annotations

import numpy as np
from gappy import person

from priorfill.markerset import discover
from priorfill.mirror import mirrored, partners

LABELS = ("LANK", "RANK", "LKNE", "T10")


def test_partners_by_their_labels() -> None:
    marker_set = discover(np.random.default_rng(0).normal(size=(20, 4, 3)), LABELS)
    assert partners(LABELS, marker_set).tolist()[:3] == [1, 0, -1]


def test_image_of_the_image() -> None:
    clip = person()
    partner = partners(clip.labels, discover(clip.positions, clip.labels))
    image = mirrored(clip.positions, partner)
    left, right = clip.labels.index("LELB"), clip.labels.index("RELB")
    np.testing.assert_array_equal(image[:, left], clip.positions[:, right] * [-1.0, 1.0, 1.0])
    assert np.isnan(image[:, partner < 0]).all()
    paired = partner >= 0
    again = mirrored(image, partner)
    np.testing.assert_array_equal(again[:, paired], clip.positions[:, paired])
