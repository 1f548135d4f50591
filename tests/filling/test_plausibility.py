"""What is left missing: ends that show too little, implausible positions, large errors."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from gappy import ARM, person, with_gaps

import priorfill as pf
from priorfill.cli import main
from priorfill.errors import OptionError
from priorfill.filling.believable_fill import _to_repeat
from priorfill.filling.plausibility import CRITERIA, FLOOR, JUMP, LENGTH, SPEED, PlausibilityCheck
from priorfill.filling.plausibility_options import UNCHECKED, PlausibilityOptions
from priorfill.filling.seen_clip import SeenClip, doubtful_samples
from priorfill.filling.visible_range import OUTSIDE_VISIBLE
from priorfill.gaps import Gap, gap_groups
from priorfill.gp.calibration import MEAN_FACTOR
from priorfill.markers.clip_geometry import ClipGeometry
from priorfill.markers.definitions import recognise
from priorfill.methods.task import Estimate

LABELS = person().labels
FEW = [label for label in LABELS if label not in ("LASI", "RASI", "LFWT", "RFWT")][2:]
GAP = (60, 80, ("LTOE",))


def ends() -> pf.Clip:
    """Two markers are visible in the first 12 frames, none in the last 6."""
    return with_gaps(person(), (0, 12, LABELS[2:]), (234, 240, LABELS))


@pytest.mark.parametrize("method", ["gpr", "linear"])
def test_ends_with_fewer_than_three_markers_stay_missing(method):
    result = pf.fill(ends(), method=method)
    assert result.clip.missing[:12, 2:].all()
    assert result.clip.missing[234:].all()
    assert not result.clip.missing[12:234].any()
    assert not result.complete
    reasons = {span.reason for gap in result.gaps for span in gap.unfilled}
    assert reasons == {OUTSIDE_VISIBLE}


def test_ends_are_extrapolated_on_request(here):
    seconds = 4 / person().rate
    options = pf.FillOptions(extrapolate=seconds, plausibility=UNCHECKED)
    result = pf.fill(ends(), method="linear", options=options)
    filled = np.flatnonzero(result.filled[:, 5])
    assert filled.tolist() == [8, 9, 10, 11, 234, 235, 236, 237]
    again = pf.fill(ends(), **result.provenance.fill_arguments())
    np.testing.assert_array_equal(again.filled, result.filled)
    pf.write("gaps.c3d", ends())
    line = ["fill", "gaps.c3d", "-o", "out.c3d", "-m", "linear", "--json"]
    facts = json.loads(CliRunner().invoke(main, [*line, "--extrapolate", str(seconds)]).stdout)
    gap = next(gap for gap in facts["gaps"] if gap["marker"] == LABELS[5])
    assert [(one["reason"], one["last_frame"]) for one in gap["unfilled"]][:1] == [
        (OUTSIDE_VISIBLE.replace("`extrapolate`", "--extrapolate"), 8)
    ]


def test_two_markers_are_filled_where_both_are_visible():
    clip = replace(
        with_gaps(person(), (50, 60, LABELS[:1]), (0, 9, LABELS[:1])),
        positions=with_gaps(person(), (50, 60, LABELS[:1]), (0, 9, LABELS[:1])).positions[:, :2],
        labels=LABELS[:2],
    )
    result = pf.fill(clip, method="linear")
    assert np.flatnonzero(result.filled[:, 0]).tolist() == list(range(50, 60))


def test_a_greatest_error_leaves_samples_missing(here):
    clip = with_gaps(person(), (60, 130, ARM), (150, 155, ("C7",)))
    every = pf.fill(clip)
    mean = MEAN_FACTOR * every.expected_rms_mm
    ordered = np.sort(mean[every.filled])
    middle = len(ordered) // 2
    # between two samples, as files round positions, and with them the expected errors
    limit = float(ordered[middle - 1 : middle + 1].mean())
    result = pf.fill(clip, options=pf.FillOptions(max_error=limit))
    np.testing.assert_array_equal(result.filled, every.filled & (mean <= limit))
    spans = [span for gap in result.gaps for span in gap.unfilled]
    assert {span.reason for span in spans} == {
        f"its expected mean error exceeds the limit of {limit:g} mm"
    }
    assert all(limit < span.expected_mean_error_mm <= np.nanmax(mean) + 1e-9 for span in spans)
    pf.write("gaps.c3d", clip)
    line = ["fill", "gaps.c3d", "-o", "out.c3d", "--json", "--max-error", str(limit)]
    done = CliRunner().invoke(main, line)
    assert done.exit_code == 3, done.output
    facts = json.loads(done.stdout)
    assert facts["filled_samples"] == int(result.filled.sum())
    worst = [one["expected_mean_error_mm"] for gap in facts["gaps"] for one in gap["unfilled"]]
    assert min(worst) > limit


def test_an_unknown_error_does_not_pass():
    clip = with_gaps(person(), (60, 80, ("C7",)))
    options = pf.FillOptions(max_error=1000.0, estimate_errors=False)
    (gap,) = pf.fill(clip, method="linear", options=options).gaps
    assert gap.filled == 0
    assert "unknown" in gap.unfilled[0].reason


@pytest.mark.parametrize("method", ["linear", "spline", "rigid"])
def test_every_method_states_its_errors(method):
    clip = with_gaps(person(), (60, 75, ("LFHD",)), (100, 130, ("C7",)), (150, 165, ("LSHO",)))
    result = pf.fill(clip, method=method)
    truth = person().positions
    off = np.linalg.norm(result.clip.positions - truth, axis=2)[result.filled]
    assert result.filled.any()
    assert np.isfinite(result.expected_rms_mm[result.filled]).all()
    assert (off <= result.error_bound_90_mm[result.filled]).mean() > 0.8
    assert np.median(result.error_bound_90_mm[result.filled]) < 8 * np.median(off) + 5


def check(**options: float) -> PlausibilityCheck:
    clip = with_gaps(person(), GAP)
    geometry = ClipGeometry(clip.positions, LABELS, recognise(LABELS))
    return PlausibilityCheck(geometry, clip.rate, PlausibilityOptions(**options))


def failures(change: np.ndarray, bound: float = 0.0, **options: float) -> dict[str, list[int]]:
    """The frames that fail each criterion where the truth is changed in the gap."""
    positions = person().positions.copy()
    marker = LABELS.index("LTOE")
    positions[GAP[0] : GAP[1], marker] += change
    stated = np.zeros(positions.shape[:2])
    found = check(**options).failures(positions, stated, stated + bound)
    assert all(not mask[:, :marker].any() for mask in found.values())
    return {name: np.flatnonzero(mask[:, marker]).tolist() for name, mask in found.items()}


def smooth(size: float, direction: int) -> np.ndarray:
    change = np.zeros((GAP[1] - GAP[0], 3))
    change[:, direction] = size * np.sin(np.linspace(0.0, np.pi, len(change))) ** 2
    return change


def test_the_truth_is_plausible():
    assert failures(np.zeros(3)) == {}


def test_each_criterion_finds_its_fault():
    assert set(failures(smooth(-400.0, 2))) == {LENGTH}  # a stair, if errors are that small
    assert {FLOOR, LENGTH} <= set(failures(smooth(-400.0, 2), 51.0))
    assert set(failures(smooth(200.0, 0))) == {LENGTH}
    spike = np.zeros((20, 3))
    spike[9, 1] = 30.0
    assert set(failures(spike)) == {JUMP}
    spike[9, 1] = 900.0
    assert {SPEED, JUMP, LENGTH} <= set(failures(spike, 51.0))
    assert SPEED not in failures(spike, 49.0)
    assert set(failures(np.array([0.0, 40.0, 0.0]))) == {JUMP}


def test_a_vague_fill_is_no_faster_than_its_own_marker_allows():
    clip = with_gaps(person(), GAP)
    measured = clip.positions.copy()
    measured[:, LABELS.index("RTOE")] *= 3.0
    geometry = ClipGeometry(measured, LABELS, recognise(LABELS))
    positions = person().positions.copy()
    toe = LABELS.index("LTOE")
    own = np.linalg.norm(np.diff(positions[:, toe], axis=0), axis=1).max()
    positions[GAP[0] + 9, toe, 1] += 3.0 * own
    for bound, vague in ((240.0, False), (260.0, True)):
        stated = np.full(positions.shape[:2], bound)
        found = PlausibilityCheck(geometry, clip.rate, PlausibilityOptions()).failures(
            positions, np.zeros_like(stated), stated
        )
        assert (SPEED in found) == vague
    assert found[SPEED][GAP[0] + 8 : GAP[0] + 11, toe].all()


def test_each_criterion_can_be_switched_off():
    off = {
        "max_below_floor": math.inf,
        "max_speed_ratio": math.inf,
        "max_jump_ratio": math.inf,
        "max_length_error": math.inf,
    }
    for name in off:
        found = failures(smooth(-900.0, 2), **{name: math.inf})
        assert len(found) >= 1
    assert failures(smooth(-900.0, 2), **off) == {}
    assert check(**off).options == UNCHECKED


def test_a_stated_error_is_believed_up_to_a_limit():
    positions = person().positions.copy()
    marker = LABELS.index("LTOE")
    positions[GAP[0] : GAP[1], marker] += smooth(120.0, 0)
    stated = np.full(positions.shape[:2], 60.0)
    assert LENGTH not in check().failures(positions, stated, 2 * stated)
    positions[GAP[0] : GAP[1], marker] += smooth(200.0, 0)
    assert LENGTH in check().failures(positions, 100 * stated, 200 * stated)


def test_a_fill_below_the_floor_is_not_written(monkeypatch):
    def sunk(task, progress=None):
        estimate = Estimate(task.positions.copy(), np.full(task.positions.shape[:2], 900.0))
        missing = ~task.valid
        estimate.positions[missing] = person().positions[missing]
        estimate.positions[66:72, LABELS.index("LTOE"), 2] -= 300.0
        return estimate

    monkeypatch.setattr("priorfill.filling.run_settings.get_method", lambda name: sunk)
    result = pf.fill(with_gaps(person(), GAP), method="gpr")
    (gap,) = result.gaps
    assert 0 < gap.filled < gap.frames
    assert not result.filled[66:72].any()
    assert gap.unfilled[0].reason == CRITERIA[FLOOR]


def test_a_fill_that_no_repetition_saves_keeps_its_reason():
    """Without the samples next to it, nothing of the marker would be left to fill from."""
    positions = person().positions[100:130].copy()
    positions[16:, 5, 0] += 400.0
    positions[14:16, 5] = np.nan
    positions[:12, 5] = positions[18:, 5] = np.nan
    options = pf.FillOptions(plausibility=PlausibilityOptions(hide_doubtful=False))
    gap_filter = pf.GapFilter(frames=(14, 15))
    clip = pf.Clip(positions, LABELS, person().rate, first_frame=0)
    result = pf.fill(clip, method="linear", gap_filter=gap_filter, options=options)
    (span,) = (span for gap in result.gaps for span in gap.unfilled if span.requested)
    assert span.reason in CRITERIA.values()
    assert result.doubtful is None or not result.doubtful.any()


def test_nothing_is_too_fast_where_no_motion_is_measured():
    positions = person().positions[100:106].copy()
    positions[4:, 5, 0] += 400.0
    positions[2:4, 5] = np.nan
    result = pf.fill(pf.Clip(positions, LABELS, person().rate), method="linear")
    assert result.complete


def test_samples_in_doubt_are_neither_learnt_from_nor_changed():
    clip = with_gaps(person(), (60, 90, ("LELB",)))
    elbow = LABELS.index("LELB")
    positions = clip.positions.copy()
    positions[90:96, elbow, 2] += 250.0  # a wrong label next to the gap
    positions[30, elbow, 2] += 250.0
    result = pf.fill(clip.with_positions(positions))
    assert result.doubtful is not None
    assert np.flatnonzero(result.doubtful[:, elbow]).tolist() == [30, *range(90, 96)]
    np.testing.assert_array_equal(result.clip.positions[90:96, elbow], positions[90:96, elbow])
    off = np.linalg.norm(result.clip.positions - person().positions, axis=2)[60:89, elbow]
    assert off.max() < 25.0  # NaN fails
    (note,) = result.notes
    assert note.startswith("7 measured samples in doubt are written as measured")
    assert note.endswith("(frames: LELB 30, 90-95)")
    options = pf.FillOptions(plausibility=replace(UNCHECKED, hide_doubtful=False))
    trusting = pf.fill(clip.with_positions(positions), options=options)
    worse = np.linalg.norm(trusting.clip.positions - person().positions, axis=2)[60:90, elbow]
    assert worse.max() > 2 * off.max()
    assert trusting.doubtful is None


def seen_with(*spikes: tuple[int, int, str, float]) -> tuple[SeenClip, np.ndarray]:
    """What methods see of a clip with spikes (frames, marker, mm), and what is hidden of it."""
    clip = with_gaps(person(), (60, 90, ("LELB",)))
    positions = clip.positions.copy()
    for start, stop, label, size in spikes:
        positions[start:stop, LABELS.index(label), 2] += size
    clip = clip.with_positions(positions)
    hidden = doubtful_samples(clip, pf.find_artefacts(clip), PlausibilityOptions())
    return SeenClip(clip, hidden, recognise(LABELS)), hidden


def test_short_runs_in_doubt_are_interpolated():
    seen, hidden = seen_with((130, 136, "C7", 120.0))
    marker = LABELS.index("C7")
    assert np.flatnonzero(hidden[:, marker]).tolist() == list(range(130, 136))
    path = seen.geometry.positions[:, marker]
    off = np.linalg.norm(path - person().positions[:, marker], axis=1)
    assert off[130:136].max() < 5.0  # NaN fails
    longer = replace(seen, interpolate_seconds=0.05)
    assert np.isnan(longer.geometry.positions[130:136, marker]).all()


def test_runs_in_doubt_next_to_a_gap_stay_hidden():
    seen, hidden = seen_with((90, 96, "LELB", 250.0))
    marker = LABELS.index("LELB")
    assert np.flatnonzero(hidden[:, marker]).tolist() == list(range(90, 96))
    assert np.isnan(seen.geometry.positions[60:96, marker]).all()


def test_small_spikes_count_only_near_a_gap():
    elbow, neck = LABELS.index("LELB"), LABELS.index("C7")
    _, hidden = seen_with((99, 101, "LELB", 30.0), (180, 182, "C7", 30.0), (30, 32, "C7", 60.0))
    assert np.flatnonzero(hidden[:, elbow]).tolist() == [99, 100]
    assert np.flatnonzero(hidden[:, neck]).tolist() == [30, 31]


def test_long_spikes_count_only_near_a_gap():
    clip = with_gaps(person(), (60, 90, ("LELB",)))
    far, near, short = (
        pf.Artefact("spike", ("LELB",), start, stop, 130.0, "LFRM", 160.0, 100.0, 3.0)
        for start, stop in ((150, 163), (95, 108), (180, 192))
    )
    hidden = doubtful_samples(clip, [far, near, short], PlausibilityOptions())
    frames = np.flatnonzero(hidden[:, LABELS.index("LELB")])
    assert frames.tolist() == [*range(95, 108), *range(180, 192)]


def test_an_object_in_another_place_after_a_gap_is_not_hidden():
    clip = person()
    rng = np.random.default_rng(3)
    waist = clip.positions[:, LABELS.index("LFWT")]
    objects = waist[:, None] + [[60.0, 40.0, 80.0], [90.0, 0.0, 60.0], [70.0, 90.0, 0.0]]
    objects += rng.normal(scale=0.3, size=objects.shape)
    objects[120:] += [700.0, 100.0, -200.0]
    objects[110:130] = np.nan
    both = pf.Clip(
        np.concatenate([clip.positions, objects], axis=1), (*LABELS, "P1", "P2", "P3"), clip.rate
    )
    found = [
        pf.Artefact("mislabelled", (label,), 0, 110, 700.0, "LFWT", 900.0, 100.0, 2.0)
        for label in ("P1", "P2", "P3")
    ]
    short = pf.Artefact("mislabelled", ("P1",), 90, 110, 700.0, "LFWT", 900.0, 100.0, 2.0)
    assert not doubtful_samples(both, found, PlausibilityOptions()).any()
    assert doubtful_samples(both, [short], PlausibilityOptions()).sum() == 20


def test_notes_tell_samples_in_doubt_from_those_left_out_of_a_repetition(monkeypatch):
    clip = with_gaps(person(), (60, 90, ("LELB",)))
    positions = clip.positions.copy()
    elbow, neck = LABELS.index("LELB"), LABELS.index("C7")
    positions[130:136, neck, 2] += 120.0
    edge = slice(86, 94)

    def poor(task, progress=None):
        """Wrong at the end of the gap, unless the samples after it are hidden."""
        found = np.where(task.valid[..., None], task.positions, person().positions)
        if task.valid[90, elbow]:
            found[80:90, elbow] += np.linspace(0.0, 900.0, 10)[:, None]
        return Estimate(found, np.full(task.valid.shape, 100.0))

    monkeypatch.setattr("priorfill.filling.run_settings.get_method", lambda name: poor)
    result = pf.fill(clip.with_positions(positions), method="gpr")
    assert result.doubtful is not None
    assert result.doubtful[edge, elbow].any()
    doubt, left_out = result.notes
    assert doubt.startswith("6 measured samples in doubt")
    assert doubt.endswith("(frames: C7 130-135)")
    assert "left out when these were repeated" in left_out
    assert "LELB" in left_out


def test_only_what_fails_is_filled_again(monkeypatch):
    """The hand's gap fails; of the others in the same gap group, the short one is filled again."""
    clip = with_gaps(person(), (60, 90, ("LELB",)), (70, 120, ("RKNE",)), (75, 80, ("RTOE",)))
    elbow, knee = LABELS.index("LELB"), LABELS.index("RKNE")
    tasks = []

    def poor(task, progress=None):
        """Wrong at the end of the elbow's gap, unless the samples after it are hidden."""
        tasks.append(task)
        found = np.where(task.valid[..., None], task.positions, person().positions)
        if task.valid[90, elbow]:
            found[80:90, elbow] += np.linspace(0.0, 900.0, 10)[:, None]
        return Estimate(found, np.full(task.valid.shape, 100.0))

    monkeypatch.setattr("priorfill.filling.run_settings.get_method", lambda name: poor)
    result = pf.fill(clip, method="gpr")
    first, again = tasks
    assert first.completed is None
    assert {gap.marker for group in first.groups for gap in group.gaps} >= {elbow, knee}
    repeated = {LABELS[gap.marker] for group in again.groups for gap in group.gaps}
    assert repeated == {"LELB", "RTOE"}
    known = again.completed
    assert np.isnan(known[85, elbow]).all(), "what failed completes no pose"
    assert np.allclose(known[100, knee], person().positions[100, knee])
    assert result.filled[60:90, elbow].all() and result.filled[70:120, knee].all()


def test_a_single_neighbour_shows_no_speed():
    """Of the hand, only the finger is measured in the gap, and jumps like the fill."""
    hand = ("LWRA", "LWRB", "LFRM", "LELB", "LUPA", "LSHO")
    positions = with_gaps(person(), (60, 90, hand)).positions.copy()
    filled = person().positions.copy()
    moved = slice(70, 80)
    for label in ("LWRA", "LFIN"):
        filled[moved, LABELS.index(label), 0] += 600.0
    positions[moved, LABELS.index("LFIN"), 0] += 600.0
    found = {}
    for several in (False, True):
        if several:  # another marker of the hand is measured, too
            positions[60:90, LABELS.index("LWRB")] = filled[60:90, LABELS.index("LWRB")]
            positions[moved, LABELS.index("LWRB"), 0] += 600.0
        geometry = ClipGeometry(positions.copy(), LABELS, recognise(LABELS))
        options = PlausibilityOptions(neighbour_distance=200.0)
        checked = PlausibilityCheck(geometry, person().rate, options)
        stated = np.zeros(filled.shape[:2])
        failing = checked.failures(filled, stated, stated + 51.0)
        found[several] = failing.get(SPEED, stated > 0)[:, LABELS.index("LWRA")]
    assert found[False][[69, 70, 79, 80]].all()
    assert not found[True].any()


def test_a_fill_ends_before_a_sample_in_doubt_that_it_cannot_join():
    clip = with_gaps(person(), (60, 90, ("LELB",)))
    positions = clip.positions.copy()
    elbow = LABELS.index("LELB")
    positions[90:96, elbow, 2] += 400.0
    result = pf.fill(clip.with_positions(positions))
    assert np.flatnonzero(result.filled[:, elbow]).tolist() == list(range(60, 89))
    (gap,) = result.gaps
    (span,) = gap.unfilled
    assert (span.start, span.stop) == (89, 90)
    assert "in doubt" in span.reason


@pytest.mark.parametrize(
    ("options", "word"), [({"extrapolate": -1.0}, "extrapolate"), ({"max_error": 0.0}, "above 0")]
)
def test_invalid_options(options, word):
    with pytest.raises(OptionError, match=word):
        pf.FillOptions(**options)


@pytest.mark.parametrize("every", [2, 3])
@pytest.mark.parametrize("method", ["gpr", "linear"])
def test_fills_between_lone_frames_are_believed(method, every):
    whole = person(seconds=0.7)
    positions = whole.positions.copy()
    blank = np.arange(len(positions)) % every != 0
    positions[blank] = np.nan
    result = pf.fill(replace(whole, positions=positions), method=method)
    last = np.flatnonzero(~blank)[-1]
    assert not result.clip.missing[: last + 1].any()


def test_gaps_without_suspects_are_not_repeated():
    missing = np.zeros((100, 3), dtype=bool)
    missing[10:60] = True
    missing[40:45, 2] = False
    suspects = np.zeros_like(missing)
    suspects[60:62, 0] = True
    missing |= suspects
    task = SimpleNamespace(rate=100.0, groups=tuple(gap_groups(missing)))
    repeated = [gap for group in _to_repeat(task, suspects) for gap in group.gaps]
    assert set(repeated) == {Gap(10, 62, 0), Gap(45, 60, 2)}
