"""Blackouts: no marker is visible, or fewer than three."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from gappy import ARM, AS_ESTIMATED, FOOT, WITH_ENDS, error, person, with_gaps
from scipy.interpolate import CubicSpline

from priorfill.clip import Clip
from priorfill.database import PriorDatabase
from priorfill.errors import OptionError
from priorfill.filling.fill_clip import fill
from priorfill.filling.fill_options import FillOptions
from priorfill.filling.result import Result
from priorfill.geometry.root_frames import RootGroup, root_group
from priorfill.methods.gpr.blackout.curves import (
    decaying_velocity_curves,
    gaussian_process_curves,
)
from priorfill.methods.gpr.blackout.options import BlackoutOptions
from priorfill.methods.gpr.blackout.predict_blackout import predict_blackout
from priorfill.methods.gpr.blackout.windows import MirrorImage, WindowSources

TRUTH = person(seconds=6.0)
SLOW = person(seconds=8.0, rate=30.0)
"""A longer one at half the rate, which halves the time of long blackouts."""
ALL = TRUTH.labels
TWO = ((180, 216, ALL), (335, 361, ALL))
"""A blackout in the middle, and one at the end."""


@pytest.fixture(scope="module")
def two_filled() -> Result:
    return fill(with_gaps(TRUTH, *TWO), options=WITH_ENDS)


def off(result: Result, truth: Clip = TRUTH) -> np.ndarray:
    """Errors of the filled samples."""
    return np.linalg.norm(result.clip.positions - truth.positions, axis=2)[result.filled]


def splines(clip: Clip) -> np.ndarray:
    positions = clip.positions.copy()
    frames = np.arange(clip.frames)
    for marker in range(positions.shape[1]):
        known = ~clip.missing[:, marker]
        positions[:, marker] = CubicSpline(frames[known], positions[known, marker])(frames)
    return positions


@pytest.mark.parametrize(
    ("seconds", "truth"), [(0.1, TRUTH), (0.3, TRUTH), (0.6, SLOW), (1.0, SLOW)]
)
def test_better_than_a_cubic_spline(seconds: float, truth: Clip) -> None:
    ours, theirs = [], []
    for begin in (1.7, 3.8):
        start = round(begin * truth.rate)
        clip = with_gaps(truth, (start, start + round(seconds * truth.rate), ALL))
        result = fill(clip, options=AS_ESTIMATED)  # a foot that collapses is not believed
        assert result.complete
        ours.append(off(result, truth).mean())
        theirs.append(error(splines(clip), truth.positions, clip.missing))
    assert np.mean(ours) < 0.85 * np.mean(theirs)


@pytest.mark.parametrize(("start", "stop"), [(0, 1), (0, 24), (320, 361), (359, 361), (0, 60)])
def test_at_the_ends(start: int, stop: int) -> None:
    clip = with_gaps(TRUTH, (start, stop, ALL))
    result = fill(clip, options=WITH_ENDS)
    assert result.complete
    edge = TRUTH.positions[stop if start == 0 else start - 1]
    held = np.linalg.norm(TRUTH.positions[start:stop] - edge, axis=2).mean()
    assert off(result).mean() < 0.5 * held


def test_several_near_each_other() -> None:
    clip = with_gaps(TRUTH, (200, 220, ALL), (223, 240, ALL), (243, 250, ALL))
    result = fill(clip)
    assert result.complete
    assert off(result).max() < 120


def test_with_other_gaps_nearby() -> None:
    gaps = [(180, 230, ARM), (205, 270, FOOT), (60, 90, ARM), (300, 320, FOOT), (0, 361, ["T10"])]
    clip = with_gaps(TRUTH, (200, 220, ALL), *gaps)
    result = fill(clip)
    left = clip.missing & ~result.filled
    assert not np.delete(left, ALL.index("T10"), axis=1).any()
    assert off(result).max() < 150


def test_ragged_edges_are_joined() -> None:
    rng = np.random.default_rng(0)
    # gaps begin and end in three frames each
    gaps = [(200 - rng.integers(3), 220 + rng.integers(3), [label]) for label in ALL]
    result = fill(with_gaps(TRUTH, *gaps))
    assert result.complete
    wrong = np.nan_to_num(result.clip.positions - TRUTH.positions)
    assert np.linalg.norm(np.diff(wrong, axis=0), axis=2).max() < 20


def test_one_visible_marker() -> None:
    clip = with_gaps(TRUTH, (200, 224, ALL[1:]))
    result = fill(clip)
    assert result.complete
    assert off(result).mean() < 40


def test_edges_have_no_jump(two_filled: Result) -> None:
    steps = np.linalg.norm(np.diff(two_filled.clip.positions - TRUTH.positions, axis=0), axis=2)
    # the recording itself has a millimetre of noise
    assert steps[[179, 215, 334]].max() < 8.0
    assert steps[[179, 215, 334]].mean() < 2.5
    assert steps.max() < 15.0


def test_expected_error() -> None:
    within = []
    for starts in ((20, 110), (80, 170)):
        result = fill(with_gaps(SLOW, *((start, start + 18, ALL) for start in starts)))
        for start in starts:
            expected = result.expected_rms_mm[start : start + 18].mean(axis=1)
            assert 4 < expected.argmax() < 14
            assert expected[[0, -1]].max() < 0.3 * expected.max()
        within.append(off(result, SLOW) < 1.6 * result.expected_rms_mm[result.filled])
    assert 0.8 < np.mean(within) <= 1.0


def test_expected_error_grows_toward_an_end() -> None:
    result = fill(with_gaps(TRUTH, (310, 361, ALL)), options=WITH_ENDS)
    expected = result.expected_rms_mm[310:].mean(axis=1)
    assert expected[-1] > 4 * expected[5]


def test_a_clip_too_short_for_windows() -> None:
    clip = person(seconds=1.0)
    result = fill(with_gaps(clip, (20, 44, ALL)))
    assert result.complete
    assert {source for gap in result.gaps for source in gap.sources} == {"interpolation over time"}
    middle = np.linalg.norm(result.clip.positions - clip.positions, axis=2)[20:44]
    assert middle.mean() < 2 * result.expected_rms_mm[20:44].mean()


def test_other_people_who_walk(tmp_path: Path) -> None:
    clip = person(seconds=2.5, rate=30.0)
    gappy = with_gaps(clip, (25, 50, ALL))
    with PriorDatabase.create(tmp_path / "db") as made:
        for body in (11, 12, 13):
            made.add(person(seconds=8.0, rate=30.0, seed=body, body=body))
    alone, helped = fill(gappy), fill(gappy, database=tmp_path / "db")
    assert helped.complete
    truth = clip.positions
    assert {source for gap in helped.gaps for source in gap.sources} == {
        "similar movements of the clip and the database"
    }
    assert all(gap.source_clips for gap in helped.gaps)
    assert error(helped.clip.positions, truth, helped.filled) < 0.8 * error(
        alone.clip.positions, truth, alone.filled
    )


def test_a_clip_without_samples_is_left_missing() -> None:
    clip = with_gaps(person(seconds=2.0), (0, 121, ALL))
    result = fill(clip)
    assert not result.filled.any()
    assert all("fewer than three" in p.reason for gap in result.gaps for p in gap.unfilled)


def test_samples_with_a_very_large_expected_error_are_left_missing() -> None:
    clip = with_gaps(person(seconds=6.0, rate=30.0), (20, 180, ALL))
    result = fill(clip, options=WITH_ENDS)
    assert result.filled[20:25].all()
    assert not result.filled[-1].any()
    assert {p.reason for gap in result.gaps for p in gap.unfilled} != set()


def test_same_bits_from_run_to_run(two_filled: Result) -> None:
    again = fill(with_gaps(TRUTH, *TWO), options=WITH_ENDS)
    assert two_filled.clip.positions.tobytes() == again.clip.positions.tobytes()
    assert two_filled.expected_rms_mm.tobytes() == again.expected_rms_mm.tobytes()


def test_moves_and_turns_with_the_clip(two_filled: Result) -> None:
    angle = 0.7
    turn = np.array(
        [[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    there = TRUTH.with_positions(TRUTH.positions @ turn + [900.0, -400.0, 30.0])
    moved = fill(with_gaps(there, *TWO), options=WITH_ENDS)
    wanted = two_filled.clip.positions @ turn + [900.0, -400.0, 30.0]
    # the solver stops at 1 % of the energy
    np.testing.assert_allclose(moved.clip.positions, wanted, atol=0.5)
    np.testing.assert_allclose(moved.expected_rms_mm, two_filled.expected_rms_mm, rtol=0.02)


def test_unknown_labels() -> None:
    clip = replace(TRUTH, labels=tuple(f"M{i:02d}" for i in range(len(ALL))))
    result = fill(with_gaps(clip, (200, 236, clip.labels)))
    assert result.complete
    assert off(result).mean() < 60


def predicted(positions: np.ndarray, start: int, stop: int) -> np.ndarray:
    markers = positions.shape[1]

    def root(among: np.ndarray) -> RootGroup | None:
        return root_group(positions, [int(m) for m in among])

    image = MirrorImage(np.full(markers, -1, dtype=np.intp), 0.95)  # no marker has a counterpart
    found = predict_blackout(
        WindowSources(positions),
        start,
        stop,
        100.0,
        root,
        image,
        np.arange(markers),
        BlackoutOptions(),
    )
    assert found is not None
    assert np.isfinite(found.expected_rms).all()
    return found.positions


@pytest.mark.parametrize("power", [0, 1, 2])
@pytest.mark.parametrize("frames", [10, 40, 90])
def test_simple_curves_are_followed_exactly(power: int, frames: int) -> None:
    rng = np.random.default_rng(power)
    time = np.arange(400)[:, None, None] / 100.0
    truth = rng.normal(0, 500, (1, 6, 3)) + rng.normal(0, 300, (1, 6, 3)) * time**power
    gappy = truth.copy()
    gappy[150 : 150 + frames] = np.nan
    np.testing.assert_allclose(
        predicted(gappy, 150, 150 + frames), truth[150 : 150 + frames], atol=1.0
    )


def test_curves_continue_lines_and_constants() -> None:
    options = BlackoutOptions()
    known = np.array([-3, -2, -1, 10, 11, 12]) / 100.0
    line = 5.0 + 3.0 * known
    requested = np.arange(10) / 100.0
    for curve in gaussian_process_curves(options.curve_processes, known, requested):
        np.testing.assert_allclose(curve.marker_weights @ line, 5.0 + 3.0 * requested, atol=1e-6)
    for sign in (1.0, -1.0):
        times = (np.sort(sign * time) for time in (known[:3], requested))
        for curve in decaying_velocity_curves(*times, options):
            np.testing.assert_allclose(curve.marker_weights @ np.ones(3), 1.0, atol=1e-9)
            if curve.mean_weights is not None:
                np.testing.assert_allclose(curve.mean_weights @ np.ones(3), 0.0, atol=1e-9)


def test_markers_that_appear_one_group_after_another() -> None:
    half, rest = ALL[:20], ALL[20:]
    gaps = [(0, 10, ALL), (10, 22, half), (22, 30, rest), (10, 22, rest[2:]), (22, 30, half[2:])]
    result = fill(with_gaps(TRUTH, *gaps), options=WITH_ENDS)
    assert result.complete


@pytest.mark.parametrize(
    ("name", "value"),
    [("edge_seconds", 0.0), ("nearest_share", 1.5), ("search_markers", 2), ("min_speed", -1.0)],
)
def test_options_out_of_range_are_refused(name: str, value: float) -> None:
    with pytest.raises(OptionError, match=f"BlackoutOptions.{name} is"):
        BlackoutOptions(**{name: value})  # type: ignore[arg-type]


def test_no_more_windows_are_used_than_the_options_allow() -> None:
    clip = with_gaps(SLOW, (100, 112, ALL))
    options = FillOptions(method_options={"blackout.max_windows": 10})
    few, many = fill(clip, options=options), fill(clip)
    # of the clip and of its mirror image
    assert few.gaps[0].training_poses == 20 < many.gaps[0].training_poses


# --- frames between blackouts ---


def between(*shown: int, frames: int = 60, markers: int = 13) -> tuple[Clip, Clip]:
    """A walk of some markers, and the same with only some of its frames."""
    clip = person(rate=100.0, seconds=frames / 100.0)
    truth = Clip(clip.positions[:, :markers], clip.labels[:markers], clip.rate)
    gappy = np.full_like(truth.positions, np.nan)
    gappy[list(shown)] = truth.positions[list(shown)]
    return truth, truth.with_positions(gappy)


def test_every_second_frame() -> None:
    truth, clip = between(*range(0, 60, 2))
    result = fill(clip)
    inside = clip.missing.copy()
    inside[-1] = False  # at the end there is nothing to interpolate
    assert result.filled[inside].all()
    assert error(result.clip.positions, truth.positions, inside) < 0.4
    assert 0.0 < result.expected_rms_mm[inside].max() < 2.0


def test_a_single_frame_is_an_edge_of_both_blackouts() -> None:
    truth, clip = between(*range(20), 30, *range(41, 60))
    result = fill(clip)
    assert result.complete
    off = np.linalg.norm(result.clip.positions - truth.positions, axis=2)
    assert off[[29, 31]].mean() < 2.0  # next to the single frame
    assert off[20:41].max() < 30.0


def test_single_frames_alone() -> None:
    truth, clip = between(10, 25, 40)
    result = fill(clip)
    assert result.filled[10:41].sum() == clip.missing[10:41].sum()
    off = np.linalg.norm(result.clip.positions - truth.positions, axis=2)
    inside = clip.missing & (np.arange(60) > 10)[:, None] & (np.arange(60) < 40)[:, None]
    ratio = off[inside] / result.expected_rms_mm[inside]
    assert 0.02 < np.sqrt((ratio**2).mean()) < 1.5


def test_few_markers_with_scattered_gaps_are_interpolated_over_time() -> None:
    rng = np.random.default_rng(0)
    truth, clip = between(*range(60), markers=3)
    gappy = truth.positions.copy()
    gappy[rng.random(gappy.shape[:2]) < 0.3] = np.nan
    gappy[[0, -1]] = truth.positions[[0, -1]]
    clip = truth.with_positions(gappy)
    result = fill(clip)
    assert result.complete
    assert error(result.clip.positions, truth.positions, clip.missing) < 1.0


def test_long_blackouts_between_single_frames_are_left_with_a_reason() -> None:
    _, clip = between(5, 95, frames=100)
    reasons = {span.reason for gap in fill(clip).gaps for span in gap.unfilled}
    assert any("too little of it next to the gap of 0.89 s" in reason for reason in reasons)


def test_single_samples_are_joined_where_there_is_too_little_to_learn_from() -> None:
    clip = person(rate=100.0, seconds=0.04)
    missing = np.zeros((4, 6), dtype=bool)
    missing[[0, 0, 1, 1, 2, 2], [1, 5, 0, 3, 2, 4]] = True
    missing[3, :5] = True
    gappy = np.where(missing[..., None], np.nan, clip.positions[:, :6])
    result = fill(Clip(gappy, tuple("ABCDEF"), clip.rate))
    assert result.filled[1, [0, 3]].all()
    sources = {s for gap in result.gaps for s in gap.sources}
    assert sources == {"interpolation over time"}
    assert (error(result.clip.positions, clip.positions[:, :6], result.filled)) < 20.0
