"""Warnings: each is given for what it names, with its figure, and not for what is right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import priorfill as pf
from priorfill.filling.provenance import DatabaseState, SourceClip
from priorfill.report.gap_warnings import gap_warnings
from priorfill.report.warning_options import WarningOptions
from priorfill.synthetic import synthesise

QUICK = pf.FillOptions(estimate_errors=False)
MARKER, START, STOP = "LKNE", 60, 90
SKIN = 23.0
"""mm. Height that brings a rigid distance a little out of its measured range."""


@pytest.fixture(scope="module")
def walk() -> pf.Clip:
    """A recording of a walk without gaps."""
    return synthesise("walking", seconds=2.0, rate=100.0)


def filled_with(
    walk: pf.Clip, change: np.ndarray, marker: str = MARKER, frames: slice = slice(START, STOP)
) -> pf.Result:
    """A fill of one gap by the true positions and a change [shape=(frames, 3), mm]."""
    column = walk.labels.index(marker)
    positions = walk.positions.copy()
    positions[frames, column] = np.nan
    result = pf.fill(walk.with_positions(positions), method="linear", options=QUICK)
    filled = walk.positions.copy()
    filled[frames, column] += change
    mask = np.zeros_like(result.filled)
    mask[frames, column] = True
    (gap,) = result.gaps
    gap = replace(gap, filled=gap.frames, unfilled=())
    return replace(result, clip=walk.with_positions(filled), filled=mask, gaps=(gap,))


def kinds(result: pf.Result, **options: float) -> dict[str, str]:
    """The warnings about the one gap: text by kind."""
    (found,) = gap_warnings(result, options=WarningOptions(**options))
    return {one.kind: one.text for one in found if one.kind != "unknown_error"}


def shift(*vector: float) -> np.ndarray:
    return np.tile(vector, (STOP - START, 1))


def test_the_true_positions_give_no_warning(walk: pf.Clip) -> None:
    assert kinds(filled_with(walk, shift(0, 0, 0))) == {}


def test_jump(walk: pf.Clip) -> None:
    text = kinds(filled_with(walk, shift(30.0, 0, 0)))["jump"]
    assert f"frame {walk.first_frame + START}" in text or f"frame {walk.first_frame + STOP}" in text
    assert "Jumps by 3" in text


def test_speed(walk: pf.Clip) -> None:
    change = shift(0.0, 0.0, 0.0)
    change[10:] += np.linspace(0.0, 2500.0, STOP - START - 10)[:, None] * [1.0, 0.0, 0.0]
    assert "m/s" in kinds(filled_with(walk, change))["speed"]


def test_length(walk: pf.Clip) -> None:
    change = np.sin(np.linspace(0, np.pi, STOP - START))[:, None] * [0.0, 0.0, 60.0]
    found = kinds(filled_with(walk, change))
    assert "mm from LTHI" in found["length"] or "mm from" in found["length"]
    assert "%" in found["length"]
    assert "length" not in kinds(filled_with(walk, change / 20.0))


def test_skin_that_moves_a_little_farther_gives_no_warning_of_length(walk: pf.Clip) -> None:
    change = np.sin(np.linspace(0, np.pi, STOP - START))[:, None] * [0.0, 0.0, SKIN]
    result = filled_with(walk, change)
    assert "length" in kinds(result, length_error=10.0, length_share=0.05)
    assert "length" not in kinds(result)


def test_floor(walk: pf.Clip) -> None:
    change = np.sin(np.linspace(0, np.pi, STOP - START))[:, None] * [0.0, 0.0, -150.0]
    assert "below the floor" in kinds(filled_with(walk, change, "RHEE"))["floor"]


def test_extrapolated(walk: pf.Clip) -> None:
    result = filled_with(walk, np.zeros((20, 3)), frames=slice(0, 20))
    assert "0.20 s before its first measured sample" in kinds(result)["extrapolated"]
    fast = replace(walk, rate=240.0)  # one frame is not 0.00 s
    result = filled_with(fast, np.zeros((1, 3)), frames=slice(0, 1))
    assert "Up to 0.004 s before" in kinds(result)["extrapolated"]


@pytest.mark.parametrize(("bound", "given"), [(20.0, False), (70.0, True)])
def test_wide_bound(walk: pf.Clip, bound: float, given: bool) -> None:
    result = filled_with(walk, shift(0, 0, 0))
    gaps = tuple(replace(gap, error_bound_90_mm=bound) for gap in result.gaps)
    found = kinds(replace(result, gaps=gaps))
    assert ("wide_bound" in found) == given
    assert not given or "70 mm" in found["wide_bound"]
    assert "wide_bound" not in kinds(replace(result, gaps=gaps), wide_bound=100.0)


def test_unknown_error(walk: pf.Clip) -> None:
    (found,) = gap_warnings(filled_with(walk, shift(0, 0, 0)))
    assert [one.kind for one in found] == ["unknown_error"]


def test_true_errors_beyond_the_bound(walk: pf.Clip) -> None:
    result = filled_with(walk, shift(0, 0, 0))
    bound = np.where(result.filled, 5.0, np.nan)
    errors = np.array([1.0] * 10 + [9.0] * 20)
    (found,) = gap_warnings(replace(result, error_bound_90_mm=bound), {0: errors})
    assert "beyond the 90 % bound in 67 % of the frames, up to 9 mm" in found[0].text
    (found,) = gap_warnings(replace(result, error_bound_90_mm=bound), {0: errors / 3.0})
    assert "beyond_bound" not in {one.kind for one in found}


def test_nothing_alike_in_the_database(walk: pf.Clip) -> None:
    positions = walk.positions.copy()
    limb = [walk.labels.index(label) for label in ("LKNE", "LANK", "LHEE")]
    positions[START : START + 60, limb] = np.nan
    result = pf.fill(walk.with_positions(positions), method="linear", options=QUICK)
    gaps = tuple(
        replace(gap, filled=gap.frames, training_poses=100, source_clips=(walk.name, "kick"))
        for gap in result.gaps
    )
    state = DatabaseState("priors", 1, 30.0, 3, 8, "abc")
    used = (SourceClip("kick", "Anna", "def"),)
    for database, clips, given in ((state, (), True), (state, used, False), (None, (), False)):
        provenance = replace(result.provenance, database=database, source_clips=clips)
        for found in gap_warnings(replace(result, gaps=gaps, provenance=provenance)):
            assert ("no_similar" in {one.kind for one in found}) == given
