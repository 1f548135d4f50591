"""Properties of all methods from the literature, on difficult clips."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from gappy import ARM, FOOT, fill_unchecked, person, with_gaps

from priorfill.clip import Clip
from priorfill.errors import MethodError, OptionError
from priorfill.filling.result import Result
from priorfill.methods import METHODS, get_method, resolve

OWN = {"gpr", "neighbours", "baumann2011"}
"""Tested in test_methods.py."""

FIELD = pytest.mark.parametrize("method", sorted(METHODS.keys() - OWN))

WALK = person(rate=30.0)

HARD = {
    "gaps": with_gaps(WALK, (30, 65, ARM), (45, 85, FOOT), (100, 120, ("LKNE",))),
    "dropout": with_gaps(WALK, (0, 120, ("C7",)), (30, 50, ("LELB",))),
    "blackout": with_gaps(WALK, (40, 48, WALK.labels), (0, 2, WALK.labels)),
    "one frame": with_gaps(person(seconds=1 / 60), (0, 1, ("C7",))),
    "three frames": with_gaps(person(seconds=3 / 60), (1, 2, ("C7", "LKNE"))),
    "one marker": Clip(
        np.where(np.arange(50)[:, None, None] // 9 % 2, np.nan, WALK.positions[:50, :1]),
        ("LFHD",),
        30.0,
    ),
    "nothing": WALK.with_positions(np.full_like(WALK.positions, np.nan)),
    "nothing missing": WALK,
    "still": with_gaps(
        WALK.with_positions(np.repeat(WALK.positions[:1], WALK.frames, axis=0)), (30, 65, ARM)
    ),
    "one place": with_gaps(
        WALK.with_positions(np.repeat(WALK.positions[:, :1], 41, axis=1)), (30, 50, ARM)
    ),
    "no frame complete": with_gaps(
        WALK, *((3 * i, 3 * i + 4, (label,)) for i, label in enumerate(WALK.labels))
    ),
}


@cache
def filled(method: str, name: str) -> Result:
    """The fill of a difficult clip."""
    return fill_unchecked(HARD[name], method=method)


def check(clip: Clip, result: Result) -> None:
    """Properties of any result."""
    measured = ~clip.missing
    assert result.clip.positions[measured].tobytes() == clip.positions[measured].tobytes()
    np.testing.assert_array_equal(result.clip.missing, clip.missing & ~result.filled)
    for gap in result.gaps:
        assert bool(gap.sources) == (gap.filled > 0)
        assert sum(part.stop - part.start for part in gap.unfilled) == gap.frames - gap.filled
        assert all("no finite position" not in part.reason for part in gap.unfilled)


@FIELD
@pytest.mark.parametrize("name", HARD)
def test_hard_clips(method, name):
    try:
        result = filled(method, name)
    except MethodError as error:
        assert "\n" not in str(error)
        assert name != "gaps"
        return
    check(HARD[name], result)


NEEDS_MORE = {"li", "lpr", "lgrnn", "glr", "wpca", "pma"}
"""Methods that need four markers."""


@FIELD
def test_a_method_that_could_work_gives_a_reason_for_each_gap(method):
    if method in NEEDS_MORE:
        with pytest.raises(MethodError, match=r"^nobody: .*\w"):
            fill_unchecked(replace(HARD["nothing"], name="nobody"), method=method)
        return
    for name in ("nothing", "dropout", "blackout"):
        result = filled(method, name)
        assert result.complete == (not result.clip.missing.any())
        assert all(part.reason for gap in result.gaps for part in gap.unfilled)


@FIELD
def test_nothing_flies_away(method):
    result = filled(method, "gaps")
    off = np.linalg.norm(result.clip.positions - WALK.positions, axis=2)
    assert result.filled.any()
    assert np.nanmax(off) < 1000


@FIELD
def test_the_same_again(method):
    one = filled(method, "gaps")
    two = fill_unchecked(HARD["gaps"], method=method)
    np.testing.assert_array_equal(one.clip.positions, two.clip.positions)


def test_each_method_has_a_summary_and_a_source():
    for name, entry in METHODS.items():
        assert callable(get_method(name))
        assert entry.summary
        assert entry.source


def test_unknown_methods():
    assert resolve("auto") == "gpr"
    with pytest.raises(OptionError, match=r"'splien'; did you mean spline\?$"):
        resolve("splien")
    with pytest.raises(OptionError, match=r"'zzz'; use one of auto, gpr, .* spline, "):
        resolve("zzz")
