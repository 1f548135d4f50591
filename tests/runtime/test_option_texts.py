"""Frame ranges, durations and names as text."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from priorfill.errors import OptionError
from priorfill.runtime.option_texts import (
    close_or_all,
    parse_duration,
    parse_frames,
    parse_names,
    seconds_of,
)


@pytest.mark.parametrize(
    ("text", "frames"),
    [
        ("92-116", (92, 116)),
        (" 92 : 116 ", (92, 116)),
        ("92\u2013116", (92, 116)),
        ("92", (92, 92)),
        ("92:", (92, None)),
        ("92-", (92, None)),
        (":116", (None, 116)),
        (":", (None, None)),
        ("-5:-2", (-5, -2)),
        ("-5--2", (-5, -2)),
        ("-5-12", (-5, 12)),
        ("7-7", (7, 7)),
    ],
)
def test_frames(text, frames):
    assert parse_frames(text) == frames


@pytest.mark.parametrize(
    "text", ["", "-", "a-b", "1-2-3", "1;2", "116-92", "1.5", "9" * 5000, "\u0663", "0x1-0x2"]
)
def test_no_frames(text):
    with pytest.raises(OptionError):
        parse_frames(text)


def test_a_number_with_a_sign_is_ambiguous():
    with pytest.raises(OptionError, match="write :116 for all frames up to 116, or -116:-116"):
        parse_frames("-116")


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("0.25", 0.25), ("0.25s", 0.25), ("2 S", 2.0), (".5", 0.5), ("10f", 0.1), ("10 F", 0.1)],
)
def test_durations(text, seconds):
    assert seconds_of(parse_duration(text), 100.0) == seconds
    assert seconds_of(text, 100.0) == seconds


@pytest.mark.parametrize("text", ["", "f", "1.5f", "-1", "1e3", "nan", "0,25", "1 min", "9" * 400])
def test_no_durations(text):
    with pytest.raises(OptionError, match="no duration"):
        parse_duration(text)


@given(st.text(max_size=12))
def test_texts_are_read_or_refused(text):
    for parse in (parse_frames, parse_duration, parse_names):
        try:
            parse(text)
        except OptionError as error:
            assert str(error)


def test_names():
    assert parse_names("RKNE, LELB,,RKNE") == ("RKNE", "LELB")
    assert parse_names(["A,B", "C"]) == ("A", "B", "C")
    with pytest.raises(OptionError, match="has no name"):
        parse_names(["A", " , "])


def test_similar_names_come_first():
    names = [f"M{n}" for n in range(100)]
    assert close_or_all("lkne", ["LKNE", "RANK"]) == "did you mean LKNE?"
    assert close_or_all("KNE", ["RKNE", "LKNE", "C7"]) == "did you mean RKNE or LKNE?"
    assert close_or_all("xyz", names).endswith("M39 and 60 more")
