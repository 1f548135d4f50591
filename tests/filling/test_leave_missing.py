from __future__ import annotations

import numpy as np
import pytest
from gappy import ARM, person, with_gaps

import priorfill as pf
from priorfill.filling.leave_missing import leave_missing
from priorfill.filling.plausibility_options import UNCHECKED

UNBELIEVABLE = pf.FillOptions(plausibility=UNCHECKED)
"""Options under which straight lines through strides are kept."""


@pytest.fixture(scope="module")
def gappy() -> pf.Clip:
    return with_gaps(person(seed=1), (60, 90, ARM), (200, 240, ("LKNE",)))


def test_samples_are_taken_back(gappy):
    result = pf.fill(gappy, method="linear", options=UNBELIEVABLE)
    assert result.complete
    samples = np.zeros_like(result.filled)
    marker = gappy.labels.index("LKNE")
    samples[210:215, marker] = samples[0, marker] = True  # frame 0 is measured
    fewer = leave_missing(result, [gappy], samples, "too far away")
    taken = samples & result.filled
    assert taken.sum() == 5
    np.testing.assert_array_equal(fewer.filled, result.filled & ~samples)
    np.testing.assert_array_equal(fewer.clip.missing, taken)
    kept = ~taken
    np.testing.assert_array_equal(fewer.clip.positions[kept], result.clip.positions[kept])
    (gap,) = (gap for gap in fewer.gaps if gap.label == "LKNE")
    assert [(s.start, s.stop, s.reason) for s in gap.unfilled] == [(210, 215, "too far away")]
    assert gap.filled == 35
    assert not fewer.complete
    assert [g for g in fewer.gaps if g.label != "LKNE"] == [
        g for g in result.gaps if g.label != "LKNE"
    ]


def test_a_rejected_sample_is_as_measured_again(gappy):
    positions = gappy.positions.copy()
    marker = gappy.labels.index("RKNE")
    positions[130:134, marker] += 400  # a spike
    clip = gappy.with_positions(positions)
    result = pf.fill(clip, method="linear", reject_artefacts=True)
    assert result.rejected[130:134, marker].all()
    fewer = leave_missing(result, [clip], result.rejected, "too far away")
    np.testing.assert_array_equal(fewer.clip.positions[130:134, marker], positions[130:134, marker])
    assert not fewer.clip.missing[130:134, marker].any()


def test_nothing_to_take_back(gappy):
    result = pf.fill(gappy, method="linear")
    assert leave_missing(result, [gappy], ~result.filled, "measured") is result
