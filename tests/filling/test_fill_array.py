"""Arrays: dropped samples are filled and flagged, and what is measured keeps its bits."""

from __future__ import annotations

import numpy as np
import pytest
from text_files import LABELS, standing

import priorfill as pf
from priorfill.errors import ClipError, MultipleSubjectsError, OptionError

METRES = (standing(40) / 1000).astype(np.float32)


def confident() -> np.ndarray:
    confidence = np.full((40, 6), 0.9)
    confidence[10:14, 2] = 0.2
    return confidence


def filled(positions: object = METRES, **changes: object) -> pf.FilledArray:
    arguments = {"method": "linear", "unit": "m", **changes}
    return pf.fill_array(positions, arguments.pop("labels", LABELS), 100.0, **arguments)


def test_samples_of_low_confidence_are_replaced_and_all_others_keep_their_bits() -> None:
    positions, confidence = METRES.copy(), confident()
    positions[10:14, 2] += 0.3
    positions[20:23, 4] = np.nan
    confidence[20:23, 4] = np.nan  # of a missing sample it does not matter
    before = positions.copy()
    done = filled(positions, confidence=confidence, min_confidence=0.6)
    assert np.array_equal(positions, before, equal_nan=True)
    expected = np.zeros((40, 6), dtype=bool)
    expected[10:14, 2] = True
    assert np.array_equal(done.dropped, expected)
    expected[20:23, 4] = True
    assert np.array_equal(done.filled, expected)
    assert done.positions.dtype == np.float32
    assert np.array_equal(done.positions[~expected], before[~expected])
    assert np.abs(done.positions - METRES).max() < 0.02
    known = np.isfinite(done.expected_mean_error)
    assert np.array_equal(known, expected)
    assert (done.error_bound_90[expected] > done.expected_mean_error[expected]).all()
    assert done.error_bound_90[expected].max() < 0.1  # in metres
    assert not done.missing.any()
    note = "4 of 237 measured samples have a confidence below 0.6 and are dropped (LKNE 4)."
    assert note in done.notes
    assert "7 samples filled, 4 of 4 dropped ones, 90 % bounds up to 0.0" in repr(done)
    assert [gap.label for gap in done.result.gaps] == ["LKNE", "C7"]


def test_dropped_samples_that_are_not_filled_are_missing() -> None:
    confidence = confident()
    confidence[0:4, 3] = 0.1
    gaps = pf.GapFilter(max_gap="3f")
    done = filled(confidence=confidence, min_confidence=0.6, gap_filter=gaps)
    assert done.dropped.sum() == 8
    assert done.filled.sum() == 0
    assert np.array_equal(done.missing, done.dropped)
    assert "8 dropped samples could not be filled and are NaN." in done.notes
    assert "0 of 8 dropped ones, 8 still missing" in repr(done)


def test_measured_coordinates_of_incomplete_samples_stay() -> None:
    positions = METRES.copy()
    positions[15, 3, 2] = np.nan
    done = filled(positions)
    assert done.filled.sum() == 1
    assert np.array_equal(done.positions[15, 3, :2], METRES[15, 3, :2])
    assert abs(done.positions[15, 3, 2] - METRES[15, 3, 2]) < 0.01


def test_zeros_are_missing_but_for_an_origin() -> None:
    positions = METRES - METRES[:, 4:5]
    positions[7:9, 1] = 0.0
    done = filled(positions)
    assert np.array_equal(np.argwhere(done.filled), [[7, 1], [8, 1]])
    assert (done.positions[:, 4] == 0).all()
    assert "2 samples at (0, 0, 0) are taken as missing." in done.notes


def test_unknown_confidences_are_low() -> None:
    confidence = confident()
    confidence[30, 0] = np.nan
    done = filled(confidence=confidence, min_confidence=0.6)
    assert done.dropped[30, 0]
    assert "1 of 240 measured samples has an unknown confidence (NaN)" in done.notes[1]
    masked = np.ma.masked_array(confident(), mask=np.isnan(confidence))
    assert filled(confidence=masked, min_confidence=0.6).dropped[30, 0]


def test_any_array() -> None:
    """Masked, read-only, integer, transposed in memory, or a list."""
    positions = np.round(standing(40)).astype(int)
    mask = np.zeros(positions.shape, dtype=bool)
    mask[10:12, 2] = True
    expected = filled(np.where(mask, np.nan, positions), unit="mm")
    masked = np.ma.masked_array(positions, mask=mask)
    floats = np.asfortranarray(np.where(mask, np.nan, positions))
    floats.setflags(write=False)
    for one in (masked, floats, floats.tolist()):
        done = filled(one, unit="mm")
        assert np.array_equal(done.positions, expected.positions)
        assert done.filled.sum() == 2


def test_labels_may_have_the_prefix_of_one_subject() -> None:
    done = filled(labels=[f"Ann:{label}" for label in LABELS])
    assert done.result.clip.labels == LABELS
    with pytest.raises(MultipleSubjectsError, match="holds 2 subjects"):
        filled(labels=[f"{'AB'[k % 2]}:{label}" for k, label in enumerate(LABELS)])


def test_what_is_assumed_is_noted() -> None:
    done = filled(METRES, unit=None)
    assert done.unit == "m"
    assert any("No unit is stated; m is assumed" in note for note in done.notes)
    turned = filled(METRES[..., [0, 2, 1]], up="Y")
    assert turned.result.clip.up == "+Y"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"confidence": confident()}, r"without a threshold.*2 % below 0.3, 2 % below 0.6, 2 %"),
        ({"min_confidence": 0.5}, "given without `confidence`"),
        ({"confidence": confident(), "min_confidence": 60}, "above 0 and at most 1"),
        ({"confidence": confident() * 100, "min_confidence": 0.6}, "LTOE in frame 0 is 90;"),
        ({"confidence": confident() - 1, "min_confidence": 0.6}, "within 0 and 1"),
        ({"confidence": confident() * np.nan, "min_confidence": 0.6}, "NaN for all measured"),
        ({"confidence": confident().T, "min_confidence": 0.6}, "here .40, 6., .*transpose it"),
        ({"confidence": np.ones(40), "min_confidence": 0.6}, "value of each frame with numpy"),
        ({"confidence": np.ones(6), "min_confidence": 0.6}, "value of each marker with numpy"),
        ({"confidence": np.ones((40, 6, 3)), "min_confidence": 0.6}, r"\(40, 6, 3\)"),
        ({"confidence": "high", "min_confidence": 0.6}, "no array of numbers"),
    ],
)
def test_unusable_confidences(changes: dict[str, object], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        filled(**changes)


@pytest.mark.parametrize(
    ("positions", "changes", "message"),
    [
        (METRES[..., :2], {}, "positions are two-dimensional, as in images"),
        (METRES.reshape(40, 18), {}, r"shape \(40, 18\); \(frames, markers, 3\) is needed"),
        (METRES, {"labels": LABELS[:5]}, "6 markers but 5 labels"),
        (METRES, {"labels": "LTOE"}, "labels are one text"),
        (METRES, {"labels": ["a"] * 6}, "label a occurs 6 times"),
        ([["a"]], {}, "no array of numbers"),
        (METRES * 1j, {}, "no array of numbers .they are complex."),
        (METRES * np.inf, {}, "an infinite coordinate in frame 0"),
        (METRES * np.nan, {"name": "mouse"}, "mouse: has no sample; there is nothing"),
        (
            METRES,
            {"confidence": confident(), "min_confidence": 0.95},
            "no sample with a confidence of at least 0.95",
        ),
    ],
)
def test_unusable_arrays(positions: object, changes: dict[str, object], message: str) -> None:
    with pytest.raises(ClipError, match=message):
        filled(positions, **changes)


def test_overrides_are_for_files() -> None:
    with pytest.raises(TypeError, match="unexpected keyword argument 'overrides'"):
        filled(overrides=None)
