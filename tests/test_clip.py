"""A clip keeps positions in one layout of memory, so that sums over them give the same bits."""

from __future__ import annotations

import numpy as np
import pytest

import priorfill as pf

POSITIONS = np.random.default_rng(0).normal(size=(20, 3, 3))
LABELS = ("A", "B", "C")


@pytest.mark.parametrize("writeable", [True, False])
def test_layout_of_the_positions_given_does_not_matter(writeable: bool) -> None:
    given = np.asfortranarray(POSITIONS)
    given.flags.writeable = writeable
    clip = pf.Clip(given, LABELS, 100.0)
    assert clip.positions.flags.c_contiguous
    np.testing.assert_array_equal(clip.positions, POSITIONS)


def test_immutable_positions_are_not_copied() -> None:
    given = POSITIONS.copy()
    given.flags.writeable = False
    assert pf.Clip(given, LABELS, 100.0).positions is given
