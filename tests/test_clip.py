"""A clip keeps positions in one layout of memory, so that sums over them give the same bits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import priorfill as pf
from priorfill.errors import ArgumentTypeError, ClipError, OptionError
from priorfill.interop import from_arrays

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
        with pytest.raises(OptionError, match=r"`clip` is of type .*; give a Clip"):
            pf.fill(given)
    with pytest.raises(OptionError, match="`same_subject` is of type int"):
        pf.fill(pf.Clip(POSITIONS, LABELS, 100.0), same_subject=[5])


@pytest.mark.parametrize(
    ("positions", "reason"),
    [
        ("x", "could not convert string"),
        ([[[1, 2, 3], [1, 2]]], "inhomogeneous"),
        (np.zeros((2, 2, 3), dtype=complex), "complex128"),
        (np.zeros((2, 2, 3), dtype="datetime64[s]"), "datetime64"),
        ({"LTOE": 3}, "dict"),
    ],
)
def test_positions_that_are_no_numbers(positions: object, reason: str):
    """NumPy would drop imaginary parts with a warning, and take times for millimetres."""
    with pytest.raises(ArgumentTypeError, match=f"no real numbers.*{reason}.*; give") as caught:
        pf.Clip(positions, ("a", "b"), 100.0)
    assert isinstance(caught.value, TypeError)
    assert "\n" not in str(caught.value)


def test_labels_that_are_no_names():
    zeros = np.zeros((2, 2, 3))
    with pytest.raises(TypeError, match="`labels` is of type str; give a list of texts"):
        pf.Clip(zeros, "ab", 100.0)
    with pytest.raises(TypeError, match=r"`labels` has one of type int \(number 2\)"):
        pf.Clip(zeros, ("a", 2), 100.0)
    for empty in ("", "  "):
        with pytest.raises(ClipError, match="marker 2 of 2 has an empty label"):
            pf.Clip(zeros, ("a", empty), 100.0)
    assert from_arrays(zeros, [1, 2], 100.0, unit="mm").labels == ("1", "2")


def test_a_first_frame_beyond_64_bits():
    with pytest.raises(ClipError, match="the first frame is 1000"):
        pf.Clip(np.zeros((2, 1, 3)), ("a",), 100.0, first_frame=10**30)
