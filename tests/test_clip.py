"""A clip keeps positions in one layout of memory, so that sums over them give the same bits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import priorfill as pf
from priorfill.errors import ClipError, OptionError

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


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"rate": None}, "the frame rate is None Hz"),
        ({"rate": "100"}, "the frame rate is '100' Hz"),
        ({"rate": 0}, "the frame rate is 0 Hz"),
        ({"first_frame": 1.5}, "the first frame is 1.5"),
    ],
)
def test_fields_of_a_wrong_type_are_refused(changed: dict[str, Any], message: str) -> None:
    with pytest.raises(ClipError, match=message):
        pf.Clip(POSITIONS, LABELS, **{"rate": 100.0, **changed})


def test_what_is_no_clip_is_refused() -> None:
    for given in ("walk.c3d", [None]):
        with pytest.raises(OptionError, match=r"`clip` has .* which is no clip"):
            pf.fill(given)
    with pytest.raises(OptionError, match="`same_subject` has 5"):
        pf.fill(pf.Clip(POSITIONS, LABELS, 100.0), same_subject=[5])
