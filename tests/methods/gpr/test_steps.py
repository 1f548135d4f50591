"""Each step of the default method has its effect, on clips made for that step.

The clips are small point models in which a fill without the step is wrong by many times the
tolerance.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from gappy import ARM, error, fill_unchecked, person, with_gaps
from scipy.ndimage import gaussian_filter1d

import priorfill as pf
from priorfill.clip import Clip
from priorfill.database import PriorDatabase
from priorfill.energy.solver import solve_exactly
from priorfill.gaps import gap_groups
from priorfill.gp.ensemble import Regression, regress
from priorfill.gp.problem import RegressionProblem
from priorfill.markers.describe import describe
from priorfill.markers.marker_set import MarkerSet
from priorfill.methods.gpr import gpr_fill
from priorfill.methods.gpr.gap_segments import GapSegment
from priorfill.methods.gpr.predict import SegmentPredictor
from priorfill.methods.gpr.prediction import SegmentPrediction
from priorfill.methods.task import Task

RATE = 60.0
NOISE = 0.2
"""mm, of the measurements of the point models."""

LEG = ("RTHI", "RKNE", "RSHN", "RANK", "RHEE", "RTOE", "RMT5")


def smooth(rng: np.random.Generator, frames: int, width: float, columns: int = 3) -> np.ndarray:
    """Random curves that vary over some frames, of variance 1 [shape=(frames, columns)]."""
    curves = gaussian_filter1d(rng.normal(size=(frames, columns)), width, axis=0)
    return curves / curves.std(axis=0)


def cloud(rng: np.random.Generator, frames: int, markers: int) -> np.ndarray:
    """Markers at rest, a metre above the floor [shape=(frames, markers, 3), mm]."""
    places = rng.uniform([-200.0, -200.0, 800.0], [200.0, 200.0, 1200.0], (markers, 3))
    return np.tile(places, (frames, 1, 1))


def measured(rng: np.random.Generator, positions: np.ndarray, labels: tuple[str, ...] = ()) -> Clip:
    noise = rng.normal(0.0, NOISE, positions.shape)
    names = labels or tuple(f"M{i}" for i in range(positions.shape[1]))
    return Clip(positions + noise, names, RATE)


def off(result: pf.Result, truth: Clip) -> float:
    """Mean error (mm) of all missing samples, all of which must be filled."""
    assert result.complete
    return error(result.clip.positions, truth.positions, result.filled)


# --- velocity fusion ---


def integrating(seed: int) -> Clip:
    """Three markers whose velocity, not position, is a function of the other seven."""
    rng = np.random.default_rng(seed)
    positions = cloud(rng, 720, 10)
    shown = smooth(rng, 720, 12.0)
    positions[:, 4:7] += 30.0 * shown[:, None]
    positions[:, 7:] += np.cumsum(100.0 * shown / RATE, axis=0)[:, None]
    return measured(rng, positions)


def test_positions_follow_the_predicted_velocities() -> None:
    found = []
    for seed in range(3):
        truth = integrating(seed)
        clip = with_gaps(truth, (300, 390, truth.labels[7:]))
        moved = np.linalg.norm(truth.positions[300:390, 7:] - truth.positions[299, 7:], axis=2)
        found.append(off(pf.fill(clip), truth) / moved.mean())
    # of the distance covered in the gap; without velocities more than all of it
    assert np.median(found) < 0.35


# --- segment lengths ---


def test_a_segment_that_may_point_anywhere_keeps_its_length() -> None:
    """The mean of the directions a segment may have is shorter than the segment."""
    rng = np.random.default_rng(0)
    frames, length = 600, 250.0
    positions = cloud(rng, frames, 8)
    positions += (smooth(rng, frames, 20.0) * [40.0, 10.0, 30.0])[:, None]
    angles = smooth(rng, frames, 25.0, 2)
    direction = np.stack(
        [
            np.cos(angles[:, 0]),
            np.sin(angles[:, 0]) * np.cos(angles[:, 1]),
            np.sin(angles[:, 0]) * np.sin(angles[:, 1]),
        ],
        axis=1,
    )
    positions[:, 6] = positions[:, 5] + [100.0, 0.0, 0.0]
    positions[:, 7] = positions[:, 6] + length * direction
    truth = measured(rng, positions)
    wrong = []
    for start in (100, 250, 400):
        clip = with_gaps(truth, (start, start + 90, truth.labels[6:]))
        found = pf.fill(clip).clip.positions[start : start + 90]
        wrong.append(np.linalg.norm(found[:, 7] - found[:, 6], axis=1) - length)
    # mm rms; without the step 20 to 120
    assert np.sqrt(np.mean(np.square(wrong))) < 6.0


def test_a_body_keeps_its_shape_in_a_blackout() -> None:
    rng = np.random.default_rng(1)
    turn = smooth(rng, 600, 20.0, 1)[:, 0]
    zero, one = np.zeros(600), np.ones(600)
    rows = [np.cos(turn), np.sin(turn), zero, -np.sin(turn), np.cos(turn), zero, zero, zero, one]
    positions = cloud(rng, 600, 9) @ np.stack(rows, axis=1).reshape(600, 3, 3)
    truth = measured(rng, positions)
    clip = with_gaps(truth, (250, 310, truth.labels))
    apart = [
        np.linalg.norm(x.positions[250:310, 1:] - x.positions[250:310, :-1], axis=2)
        for x in (pf.fill(clip).clip, truth)
    ]
    # mm rms; without the step 18
    assert np.sqrt(np.mean((apart[0] - apart[1]) ** 2)) < 2.0


# --- floor ---


def landing(seed: int, start: int, frames: int, depth: float) -> Clip:
    """A body that hops, its foot with it, and squats in the gap, the foot standing (rest 40 mm)."""
    rng = np.random.default_rng(seed)
    positions = cloud(rng, 600, 10)
    away = np.arange(600) - (start + frames / 2)
    height = 60.0 * smooth(rng, 600, 10.0, 1)[:, 0] * (1.0 - np.exp(-0.5 * (away / 40.0) ** 2))
    squat = depth * np.exp(-0.5 * (away / 8.0) ** 2)
    positions[:, :7, 2] += (height - squat)[:, None]
    positions[:, 7:] = [[0.0, 0.0, 40.0], [60.0, 0.0, 40.0], [0.0, 90.0, 40.0]]
    positions[:, 7:, 2] += np.maximum(height, 0.0)[:, None]
    positions[..., 0] += 20.0 * np.sin(np.arange(600) / RATE)[:, None]
    return measured(rng, positions)


@pytest.mark.parametrize("seed", [0, 2])
def test_feet_stay_above_the_floor(seed: int) -> None:
    start, frames = 300, 60
    truth = landing(seed, start, frames, 150.0)
    result = pf.fill(with_gaps(truth, (start, start + frames, truth.labels[7:])))
    below = 40.0 - result.clip.positions[start : start + frames, 7:, 2]
    # mm; without the step 50 to 100
    assert below.max() < 10.0
    assert off(result, truth) < 15.0


# --- smoothing ---


@pytest.mark.parametrize("label", ["LKNE", "C7"])
def test_a_fill_is_no_rougher_than_its_marker(label: str) -> None:
    """The other markers are noisy, so their regression is, but the marker itself is not."""
    clean = person(rate=100.0)
    marker = clean.labels.index(label)
    positions = clean.positions + np.random.default_rng(1).normal(0, 3.0, clean.positions.shape)
    positions[:, marker] = clean.positions[:, marker]
    clip = with_gaps(clean.with_positions(positions), (150, 250, [label]))
    found = pf.fill(clip).clip.positions

    def roughness(path: np.ndarray) -> float:
        return float(np.sqrt((np.diff(path, 2, axis=0) ** 2).sum(axis=1).mean()))

    # without the step 4 to 5 times as rough
    assert roughness(found[151:249, marker]) < 1.8 * roughness(clean.positions[:, marker])
    assert error(found, clean.positions, clip.missing) < 10.0


# --- lag features ---


@pytest.mark.parametrize("markers", [1, 4])
def test_lags_distinguish_the_way_there_from_the_way_back(markers: int) -> None:
    """The visible pose is the same on both ways, the missing markers' positions are not."""
    rng = np.random.default_rng(5)
    frames = 500
    phase = np.cumsum(0.12 + 0.04 * np.sin(np.arange(frames) / 37.0))
    positions = cloud(rng, frames, 8 + markers)
    positions[:, 6:8, 2] += 100.0 * np.sin(phase)[:, None]
    positions[:, 8:, 0] += 100.0 * np.cos(phase)[:, None]
    truth = measured(rng, positions)
    result = pf.fill(with_gaps(truth, (250, 330, truth.labels[8:])))
    # mm; without lags 20 and 57
    assert off(result, truth) < 8.0


# --- mirror image ---


@lru_cache
def two_sided() -> tuple[Clip, MarkerSet]:
    """Both arms follow their side of the trunk; the left one moves around frame 350 only."""
    rng = np.random.default_rng(0)
    frames, labels, places = 600, [], []
    trunk = rng.uniform(-150.0, 150.0, (4, 3))
    trunk[:, 0] = 40.0 + np.abs(trunk[:, 0])
    arm = [[250.0, 30.0, 0.0], [300.0, 60.0, 10.0], [280.0, 90.0, -50.0]]
    for name, group in (("T", trunk), ("A", np.array(arm))):
        for i, place in enumerate(group):
            for side, sign in (("L", -1.0), ("R", 1.0)):
                labels.append(f"{side}{name}{i}")
                places.append(place * [sign, 1.0, 1.0] + [0.0, 0.0, 1000.0])
    time = np.arange(frames)
    left = np.exp(-0.5 * ((time - 350) / 40.0) ** 4)
    raised = {
        "L": left * np.sin(time / 9.0) ** 2,
        "R": (1.0 - left) * np.sin(time / 11.0) ** 2,
    }
    positions = np.tile(np.array(places), (frames, 1, 1))
    for marker, label in enumerate(labels):
        some = raised[label[0]]
        if label[1] == "T":
            positions[:, marker, 1] += 25.0 * some
        else:
            positions[:, marker, 2] += 300.0 * np.sin(1.5 * some)
            positions[:, marker, 1] += 200.0 * (1.0 - np.cos(1.5 * some))
    names = tuple(labels)
    marker_set = MarkerSet(
        "two",
        names,
        {label: "trunk" if label[1] == "T" else label[0] for label in names},
        dict.fromkeys(names, True),
        {label: ("R" if label[0] == "L" else "L") + label[1:] for label in names},
        ("trunk",),
    )
    return measured(rng, positions, names), marker_set


def test_a_movement_that_only_the_other_side_shows_is_mirrored() -> None:
    truth, marker_set = two_sided()
    arm = [label for label in truth.labels if label.startswith("LA")]
    clip = with_gaps(truth, (290, 410, arm))
    found = off(pf.fill(clip, options=pf.FillOptions(marker_set=marker_set)), truth)
    blind = MarkerSet(
        "one", truth.labels, marker_set.segment, marker_set.reliable, {}, marker_set.root_segments
    )
    # a third of the error without a mirror image
    assert found < 0.6 * off(pf.fill(clip, options=pf.FillOptions(marker_set=blind)), truth)


# --- other recordings ---


@pytest.fixture(scope="module")
def walkers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PriorDatabase]:
    """Three people who walk."""
    place = tmp_path_factory.mktemp("walkers") / "db"
    with PriorDatabase.create(place) as made:
        for body in (11, 12, 13):
            made.add(person(seconds=4.0, rate=30.0, seed=body, body=body))
    with PriorDatabase.open(place) as opened:
        yield opened


def test_other_recordings_help_a_clip_that_shows_little(walkers: PriorDatabase) -> None:
    """One second with a leg; the other recording is of the same subject, the database of others."""
    truth = person(seconds=2.0)
    clip = with_gaps(truth, (40, 100, LEG))
    alone = off(pf.fill(clip), truth)
    assert off(pf.fill(clip, database=walkers), truth) < 0.85 * alone
    assert off(pf.fill(clip, same_subject=[person(seconds=6.0, seed=9)]), truth) < 0.7 * alone


# --- second pass ---


def leg_and_flickering_markers() -> tuple[Clip, Clip]:
    """The truth, and a clip without the leg's middle; others are missing, far from that gap."""
    truth = person(seconds=6.0, rate=30.0)
    others = [label for label in truth.labels if label not in LEG]
    # a marker each is missing nearly all the time
    spans = [*range(0, 64, 8), *range(124, 172, 8)]
    holes = [(s, s + 8, [label]) for s, label in zip(spans, others[-len(spans) :], strict=True)]
    return truth, with_gaps(truth, (75, 115, LEG), *holes)


def test_a_second_pass_learns_from_frames_that_the_first_one_completed() -> None:
    truth, clip = leg_and_flickering_markers()
    leg = clip.missing.copy()
    leg[:75] = leg[115:] = False
    assert error(pf.fill(clip).clip.positions, truth.positions, leg) < 12.0


def test_a_fill_of_some_gaps_learns_from_frames_that_an_earlier_one_completed() -> None:
    truth, clip = leg_and_flickering_markers()
    (group,) = (g for g in gap_groups(clip.missing) if g.start == 75)
    task = Task(clip.positions, clip.labels, clip.rate, describe(clip), (group,))
    passes: list[bool] = []
    predict = SegmentPredictor.predict_batch

    def noted(self: SegmentPredictor, batch: Any, completed: Any) -> Any:
        passes.append(completed is not None)
        return predict(self, batch, completed)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SegmentPredictor, "predict_batch", noted)
        found = gpr_fill.fill(replace(task, completed=truth.positions)).positions
    assert passes == [True], "one pass, with completed frames"
    leg = clip.missing.copy()
    leg[:75] = leg[115:] = False
    assert error(found, truth.positions, leg) < 12.0
    assert np.isnan(found[clip.missing & ~leg]).all(), "no other gap is filled"


# --- interpolation over time ---


def unlike_neighbours(seed: int) -> Clip:
    """Two smooth markers whose positions the eight others do not predict."""
    rng = np.random.default_rng(seed)
    frames = 200
    positions = cloud(np.random.default_rng(3), frames, 10)
    positions[:, :8] += 20.0 * smooth(rng, frames, 6.0, 24).reshape(frames, 8, 3)
    time = np.arange(frames) / RATE + seed
    for marker, turn in ((8, 2.0), (9, 2.6)):
        positions[:, marker, 0] += 150.0 * np.sin(turn * time)
        positions[:, marker, 2] += 100.0 * np.cos(turn * time)
    noise = rng.normal(0.0, 0.05, positions.shape)
    return Clip(positions + noise, tuple(f"M{i}" for i in range(10)), RATE)


def test_interpolation_replaces_other_recordings_but_never_the_clips_own_frames() -> None:
    """A short gap of two markers; only another recording shows one of them in enough frames.

    Both move smoothly and not with the visible markers, so that the expected error of a curve
    through time is below that of either regression.
    """
    truth, other = unlike_neighbours(0), unlike_neighbours(1)
    start, stop, seen = 100, 116, 5
    own, rare = truth.labels[8:]
    clip = with_gaps(
        truth,
        (start, stop, [own, rare]),
        (0, start - seen, [rare]),
        (stop + seen, truth.frames, [rare]),
        # so that no frame shows all ten markers
        (start - seen, start, ["M0"]),
        (stop, stop + seen, ["M0"]),
    )
    kept = [i for i in range(10) if truth.labels[i] != own]
    labels = tuple(truth.labels[i] for i in kept)
    other = Clip(other.positions[:, kept], labels, RATE, name="other")
    regressions = pf.FillOptions(method_options={"short_gaps.max_seconds": 0.0})
    result = pf.fill(clip, same_subject=[other], options=regressions)
    here = {gap.label: gap for gap in result.gaps if (gap.start, gap.stop) == (start, stop)}
    assert here[rare].sources == ("interpolation over time",)
    marker = truth.labels.index(rare)
    away = np.linalg.norm(result.clip.positions - truth.positions, axis=2)[start:stop, marker]
    assert away.max() < 5.0
    assert here[own].sources == ("the clip's own frames",)
    # the regression's expected error is far above that of the interpolation
    assert here[own].expected_rms_mm > 3.0 * here[rare].expected_rms_mm


# --- segments ---


def test_a_gap_is_cut_where_its_best_neighbour_is_missing() -> None:
    """Marker 8 moves with marker 7 alone, which is missing in the middle of its gap."""
    rng = np.random.default_rng(1)
    positions = cloud(rng, 500, 9)
    positions[:, 8] = positions[:, 7] + [30.0, 0.0, 0.0]
    positions[:, 7:] += 80.0 * smooth(rng, 500, 8.0)[:, None]
    truth = measured(rng, positions)
    clip = with_gaps(truth, (200, 320, ["M8"]), (245, 275, ["M7"]))
    away = np.linalg.norm(pf.fill(clip).clip.positions - truth.positions, axis=2)[:, 8]
    seen = np.r_[200:240, 280:320]
    # mm; nothing predicts the middle
    assert away[seen].mean() < 5.0 < away[245:275].mean()


# --- the energy's weights ---


@pytest.mark.parametrize(("expected_rms", "reach"), [(10.0, 0.0377), (0.5, 0.015), (500.0, 0.1)])
def test_an_offset_at_the_edge_decays_as_in_the_closed_form(
    monkeypatch: pytest.MonkeyPatch, expected_rms: float, reach: float
) -> None:
    """A prediction that is off by a constant, in a clip that stands still.

    With weights 1, 2 s² and s⁴ of the three terms, the minimum solves (1 - s² D²)² e = 0 for the
    distance e from the prediction. Position and slope are continuous at the edges, so an offset
    fades as (1 + t / s) exp(-t / s). s grows as the error expected to the power of 0.4, from
    15 ms at 1 mm to 100 ms at most.
    """
    rate, start, stop = 1000.0, 600, 3000
    still = cloud(np.random.default_rng(0), 3600, 6)
    places, clip = still[0], Clip(still, tuple("ABCDEF"), rate)
    shift = np.array([30.0, -20.0, 10.0])

    def predict(self: object, segment: GapSegment, completed: object) -> list[SegmentPrediction]:
        frames = stop - start + 2 * 300
        positions = np.tile(places[0] + shift, (frames, 1, 1))
        return [
            SegmentPrediction(
                segment,
                start - 300,
                positions,
                np.full((frames, 1), expected_rms),
                True,
                "",
                from_own_frames=True,
            )
        ]

    monkeypatch.setattr("priorfill.methods.gpr.predict.SegmentPredictor.predict", predict)
    monkeypatch.setattr("priorfill.methods.gpr.gpr_fill.minimise", solve_exactly)
    found = pf.fill(with_gaps(clip, (start, stop, "A"))).clip.positions[start:stop, 0]
    share = (found - places[0]) @ shift / (shift @ shift)
    time = np.arange(1, stop - start + 1) / rate
    fading = np.zeros(stop - start)
    for since in (time, time[::-1]):
        fading += (1.0 + since / reach) * np.exp(-since / reach)
    # a share of the offset; with another weight of a term it is 0.05 to 0.3
    np.testing.assert_allclose(share, 1.0 - fading, atol=0.02)


# --- samples with too large an expected error ---


def test_samples_with_too_great_an_expected_error_stay_missing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    truth = person()

    def predict(self: object, segment: GapSegment, completed: object) -> list[SegmentPrediction]:
        expected_rms = np.full((60, 1), 900.0)
        expected_rms[20:30] = 1100.0
        path = truth.positions[100:160, segment.markers]
        return [SegmentPrediction(segment, 100, path, expected_rms, True, "", from_own_frames=True)]

    monkeypatch.setattr("priorfill.methods.gpr.predict.SegmentPredictor.predict", predict)
    result = pf.fill(with_gaps(truth, (110, 150, ["LKNE"])))
    marker = truth.labels.index("LKNE")
    expected = np.zeros(truth.frames, dtype=bool)
    expected[110:120] = expected[130:150] = True
    np.testing.assert_array_equal(result.filled[:, marker], expected)
    assert np.isnan(result.clip.positions[120:130, marker]).all()
    (gap,) = result.gaps
    assert [(part.start, part.stop) for part in gap.unfilled] == [(120, 130)]
    assert "1000 mm" in gap.unfilled[0].reason


# --- batches of segments ---


def test_one_regression_predicts_several_gaps_of_a_marker(monkeypatch: pytest.MonkeyPatch) -> None:
    """About as well as one by itself; the poses next to each are training poses."""
    found = []

    def counting(training: Sequence[RegressionProblem], *rest: Any) -> Regression:
        found.append(training[0].train.time)
        return regress(training, *rest)

    monkeypatch.setattr("priorfill.methods.gpr.predict.regress", counting)
    truth = person(seconds=6.0)
    gaps = [(60, 75), (150, 170), (300, 318)]
    together = fill_unchecked(with_gaps(truth, *((a, b, ["LKNE"]) for a, b in gaps)))
    assert len(found) == 1
    marker = truth.labels.index("LKNE")
    for a, b in gaps:
        for frame in (a - 2, a - 1, b, b + 1):
            assert np.isclose(found[0], frame / truth.rate).any()
        alone = fill_unchecked(with_gaps(truth, (a, b, ["LKNE"])))
        errors = [
            np.linalg.norm((one.clip.positions - truth.positions)[a:b, marker], axis=1).mean()
            for one in (together, alone)
        ]
        assert errors[0] < 1.5 * errors[1]


# --- spline nodes ---


def test_frames_between_nodes_are_interpolated(monkeypatch: pytest.MonkeyPatch) -> None:
    """A limb is predicted at 40 Hz, a marker at 60, and all frames for 0.1 s at either edge."""
    counts = []

    def counting(training: Sequence[RegressionProblem], *rest: Any) -> Regression:
        counts.append(len(training[0].query.time))
        return regress(training, *rest)

    monkeypatch.setattr("priorfill.methods.gpr.predict.regress", counting)
    truth = person(seconds=3.0, rate=240.0)
    result = pf.fill(with_gaps(truth, (240, 480, ARM)))
    found = result.clip.positions
    every = 240 // 6 + 2 * 24  # one in six, and the edges
    assert max(counts) < every + 2 * 40  # frames adjacent to the gap
    path = (found - truth.positions)[238:482, [truth.labels.index(x) for x in ARM]]
    # interpolated, not held: no steps from node to node
    assert np.linalg.norm(np.diff(path, axis=0), axis=2).max() < 3.0
    counts.clear()
    pf.fill(with_gaps(truth, (240, 480, ["LKNE"])))
    every = 240 // 4 + 2 * 24
    assert every <= max(counts) < every + 2 * 40
