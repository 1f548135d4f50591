"""Gap filters: markers, frames, the longest gap, the clip's ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from gappy import ARM, person, with_gaps
from hypothesis import given, settings
from hypothesis import strategies as st

from priorfill.cli import main
from priorfill.clip import Clip
from priorfill.errors import OptionError
from priorfill.filling.fill_clip import fill
from priorfill.filling.fill_options import FillOptions
from priorfill.filling.gap_filter import GapFilter, matching_markers
from priorfill.filling.plausibility_options import UNCHECKED
from priorfill.formats import read, write

UNBELIEVABLE = FillOptions(plausibility=UNCHECKED)
"""Options under which straight lines through strides are kept."""

GAPS = ((0, 20, ("LKNE",)), (60, 150, ARM), (80, 90, ("RKNE", "C7")), (230, 240, ("C7",)))


def clip(first_frame: int = 0) -> Clip:
    return replace(with_gaps(person(), *GAPS), first_frame=first_frame)


def filled_of(gap_filter: GapFilter, first_frame: int = 0) -> np.ndarray:
    return fill(
        clip(first_frame), method="linear", gap_filter=gap_filter, options=UNBELIEVABLE
    ).filled


def column(label: str) -> int:
    return person().labels.index(label)


def test_everything_by_default():
    np.testing.assert_array_equal(filled_of(GapFilter()), clip().missing)


def test_markers():
    filled = filled_of(GapFilter(markers=("L*", "C7")))
    named = np.array([label.startswith("L") or label == "C7" for label in person().labels])
    np.testing.assert_array_equal(filled, clip().missing & named)


def test_longer_gaps_are_left_alone_as_a_whole():
    result = fill(clip(), method="linear", options=UNBELIEVABLE, gap_filter=GapFilter(max_gap=0.5))
    for gap in result.gaps:
        assert gap.filled == (gap.frames if gap.frames <= 30 else 0)
    assert result.complete
    (left,) = next(gap for gap in result.gaps if gap.label == "LFIN").unfilled
    assert (left.start, left.stop, left.requested) == (60, 150, False)
    assert "longer than 0.5 s" in left.reason


def test_the_longest_gap_in_frames():
    for frames in (10, 20):
        result = fill(
            clip(),
            method="linear",
            options=UNBELIEVABLE,
            gap_filter=GapFilter(max_gap=f"{frames}f"),
        )
        for gap in result.gaps:
            assert gap.filled == (gap.frames if gap.frames <= frames else 0)


def test_markers_in_any_case():
    exact = filled_of(GapFilter(markers=("LKNE", "LWR*")))
    np.testing.assert_array_equal(filled_of(GapFilter(markers=("lkne", "lWr*"))), exact)
    # a label that matches exactly takes precedence over one that differs in case
    both = replace(clip(), labels=tuple("lkne" if x == "C7" else x for x in clip().labels))
    (marker,) = matching_markers(both, "lkne")
    assert both.labels[marker] == "lkne"


def test_edges():
    filled = filled_of(GapFilter(skip_edges=True))
    assert not filled[:60].any()
    assert not filled[200:].any()
    assert filled[60:150].sum() == 90 * len(ARM) + 20


def test_frames_are_numbered_as_in_the_file():
    filled = filled_of(GapFilter(frames=(1070, 1084)), first_frame=1001)
    missing = clip().missing
    missing[:69] = missing[84:] = False
    np.testing.assert_array_equal(filled, missing)
    np.testing.assert_array_equal(
        filled_of(GapFilter(frames=(None, 84))), clip().missing & (np.arange(240) < 85)[:, None]
    )


@given(
    st.integers(-5, 250),
    st.integers(-5, 250),
    st.floats(0.01, 2.0),
    st.booleans(),
    st.sets(st.sampled_from([*ARM, "C7", "RKNE"]), min_size=1),
)
@settings(max_examples=20, deadline=None)
def test_what_is_left_alone_stays_missing_with_a_reason(first, last, max_gap, skip_edges, markers):
    if first > last or last < 0 or first > 239:
        return
    gap_filter = GapFilter(tuple(sorted(markers)), (first, last), max_gap, skip_edges)
    result = fill(clip(), method="linear", options=UNBELIEVABLE, gap_filter=gap_filter)
    alone = np.zeros_like(result.filled)
    for gap, reason in gap_filter.left_alone(clip()):
        assert reason
        alone[gap.start : gap.stop, gap.marker] = True
    np.testing.assert_array_equal(result.filled, clip().missing & ~alone)
    assert result.complete


def test_failure_of_a_method_differs_from_being_left_alone():
    both = with_gaps(person(), (0, 240, ("C7",)), (100, 120, ("LKNE",)))
    result = fill(both, method="linear", gap_filter=GapFilter(frames=(110, None)))
    assert not result.complete
    (gap,) = [gap for gap in result.gaps if gap.label == "C7"]
    assert [(part.start, part.stop, part.requested) for part in gap.unfilled] == [
        (0, 110, False),
        (110, 240, True),
    ]


def test_the_rest_is_filled_as_without_a_filter():
    whole = fill(clip())
    part = fill(clip(), gap_filter=GapFilter(markers=("LWR*",)))
    np.testing.assert_array_equal(
        part.clip.positions[part.filled], whole.clip.positions[part.filled]
    )


@pytest.mark.parametrize(
    ("fields", "word"),
    [
        ({"markers": ("LKNEE",)}, r"'LKNEE'; did you mean LKNE"),
        ({"max_gap": "0f"}, "max_gap.* is 0f; it must be above 0"),
        ({"max_gap": "ten"}, "write seconds, as 0.25"),
        ({"frames": (241, 300)}, "0-239"),
        ({"frames": (20, 10)}, "20-10"),
        ({"frames": "10-20"}, r"^`frames` is '10-20'; give the first and the last frame, as \(92"),
        ({"frames": (10,)}, "give the first and the last frame"),
        ({"markers": "RKNE,LELB"}, r"it must be a tuple, as \('RKNE', 'LELB'\)$"),
        ({"max_gap": 0.0}, "above 0"),
        ({"max_gap": float("nan")}, "nan"),
    ],
)
def test_invalid_filters(fields, word):
    with pytest.raises(OptionError, match=word):
        fill(clip(), method="linear", options=UNBELIEVABLE, gap_filter=GapFilter(**fields))


def test_the_command_line(here):
    write("gaps.c3d", clip(first_frame=1))
    run = CliRunner().invoke
    common = ["fill", "gaps.c3d", "-o", "out.c3d", "-m", "linear", "--overwrite"]
    result = run(main, [*common, "--max-gap", "0.5", "--skip-edges", "--frames", "60:"])
    assert result.exit_code == 0, result.output
    assert "filled 20 samples with linear; 2 of 2 gaps complete, 8 left alone" in result.stdout
    assert "left alone: 540 samples of 6 markers" in result.stderr
    assert "unfilled" not in result.stderr
    assert read("out.c3d").missing.sum() == clip().missing.sum() - 20
    for frames in ("61-81", "61:81"):
        ranged = run(main, [*common, "--frames", frames, "--markers", "lkne,lfin", "--markers=C7"])
        assert "filled 22 samples" in ranged.stdout, ranged.output
    believed = [*common, "-m", "r2"]  # a straight line is not, at the end of the clip
    in_frames = run(main, [*believed, "--max-gap", "10f"])
    in_seconds = run(main, [*believed, "--max-gap", f"{10 / person().rate}s"])
    assert in_frames.stdout == in_seconds.stdout
    assert "filled 30 samples with r2; 3 of 3 gaps complete, 7 left alone" in in_frames.stdout
