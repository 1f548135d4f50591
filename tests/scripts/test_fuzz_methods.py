"""A few of scripts/checks/fuzz_methods.py: odd clips are filled, or a reason is given."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from scripted import load_script

from priorfill.errors import MethodError
from priorfill.filling.fill_clip import fill as fill_clip
from priorfill.methods import METHODS

fuzz = load_script("fuzz_methods")

SMALL = 500
"""Samples of a clip in this test; the script alone fills larger ones."""


def small_clips(count: int) -> list[int]:
    """Numbers of the first clips that are small."""
    numbers = []
    number = 0
    while len(numbers) < count:
        if fuzz.make_clips(5, number)[0].missing.size <= SMALL:
            numbers.append(number)
        number += 1
    return numbers


def test_each_method_on_odd_clips():
    ends: Counter[str] = Counter()
    for number, method in zip(small_clips(len(METHODS)), METHODS, strict=True):
        end, _ = fuzz.run_case(fuzz.Case(5, number, method))
        ends[end] += 1
    assert ends["filled"] + ends["partly filled"] > 5


@pytest.mark.parametrize(
    ("seed", "number", "method"),
    [
        (1, 126, "gpr"),  # no marker near another one, and a donor that stands still
        (2, 305, "pca-frames"),  # nothing is asked for
    ],
)
def test_degenerate_clips(seed, number, method):
    fuzz.run_case(fuzz.Case(seed, number, method))


def test_a_seed_makes_the_same_clips():
    one, other = (fuzz.make_clips(5, 3)[0] for _ in range(2))
    np.testing.assert_array_equal(one.positions, other.positions)
    assert one.rate == other.rate
    shapes = {fuzz.make_clips(5, number)[0].positions.shape for number in range(20)}
    assert len(shapes) > 15


def test_faults_are_seen(monkeypatch):
    def fill(*args, **options):
        raise ValueError("x")

    monkeypatch.setattr(fuzz, "fill", fill)
    with pytest.raises(ValueError, match=r"^x$"):
        fuzz.run_case(fuzz.Case(5, 1, "linear"))


def test_refused_clips_are_no_fault(monkeypatch):
    def fill(*args, **options):
        raise MethodError("clip: has too few markers; use another method")

    monkeypatch.setattr(fuzz, "fill", fill)
    assert fuzz.run_case(fuzz.Case(5, 1, "linear"))[0] == "refused"


def changed(result, name, value):
    array = getattr(result, name).copy()
    array[np.argwhere(result.filled)[0][0], np.argwhere(result.filled)[0][1]] = value
    return replace(result, **{name: array})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: changed(r, "expected_rms_mm", np.inf), "infinite"),
        (lambda r: changed(r, "expected_rms_mm", -1.0), "negative"),
        (lambda r: changed(r, "filled", False), "not filled has a position"),
        (lambda r: replace(r, gaps=()), "reasons"),
        (
            lambda r: replace(r, clip=r.clip.with_positions(r.clip.positions + 1.0)),
            "measured sample",
        ),
    ],
)
def test_wrong_results_are_seen(monkeypatch, change, message):
    number = next(
        n for n in small_clips(20) if fuzz.run_case(fuzz.Case(5, n, "linear"))[0] == "partly filled"
    )
    monkeypatch.setattr(fuzz, "fill", lambda *args, **kwargs: change(fill_clip(*args, **kwargs)))
    with pytest.raises(AssertionError, match=message):
        fuzz.run_case(fuzz.Case(5, number, "linear"))
