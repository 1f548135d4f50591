"""The energy methods on synthetic clips: what is filled, and reasons for what is not."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import naive
import numpy as np
import pytest
from gappy import (
    ARM,
    AS_ESTIMATED,
    FOOT,
    WITH_ENDS,
    error,
    fill_unchecked,
    person,
    straight,
    with_gaps,
)

from priorfill.clip import Clip
from priorfill.database import PriorDatabase
from priorfill.energy.solver import DescentOptions, minimise, solve_exactly
from priorfill.energy.terms import energy
from priorfill.filling.fill_clip import fill
from priorfill.filling.gap_filter import GapFilter
from priorfill.filling.result import Result
from priorfill.geometry.axes import from_upright
from priorfill.methods import METHODS
from priorfill.methods.baumann2011 import neighbour_votes
from priorfill.methods.gpr import gpr_fill

METHOD = pytest.mark.parametrize("method", ["baumann2011", "neighbours", "gpr"])

GAPS = {
    "single": [(100, 130, ("LKNE",))],
    "limb": [(80, 170, ARM)],
    "overlapping": [(70, 160, ARM), (100, 190, FOOT), (120, 135, ("C7",)), (150, 175, ("STRN",))],
    "start": [(0, 40, ("RWRA", "RFIN"))],
    "end": [(200, 240, ("LANK", "LHEE"))],
    "moments": [(50, 51, ("LFHD",)), (90, 92, ("RSHN",)), (91, 94, ("RKNE",))],
}


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> PriorDatabase:
    """Two other subjects walking."""
    place = tmp_path_factory.mktemp("priors") / "db"
    with PriorDatabase.create(place) as made:
        for body in (11, 12):
            made.add(person(seconds=6.0, seed=body, body=body))
    with PriorDatabase.open(place) as opened:
        yield opened


def fill_by(method: str, clip: Clip, database: PriorDatabase | None = None) -> Result:
    """Fill a clip, ends included. Only the default method must give plausible fills."""
    options = WITH_ENDS if method == "gpr" else AS_ESTIMATED
    return fill(clip, method=method, database=database, options=options)


@cache
def filled(method: str, name: str) -> Result:
    """A fill of one kind of gaps."""
    return fill_by(method, with_gaps(person(), *GAPS[name]))


def check(clip: Clip, result: Result) -> None:
    """Properties of any result."""
    missing = clip.missing
    np.testing.assert_array_equal(result.clip.positions[~missing], clip.positions[~missing])
    assert not (result.filled & ~missing).any()
    np.testing.assert_array_equal(result.clip.missing, missing & ~result.filled)
    assert np.isfinite(result.clip.positions[result.filled]).all()
    assert np.isfinite(result.expected_rms_mm[result.filled]).all()
    assert (result.expected_rms_mm[result.filled] >= 0).all()
    assert np.isnan(result.expected_rms_mm[~result.filled]).all()
    for gap in result.gaps:
        assert gap.sources or gap.filled == 0
        assert sum(p.stop - p.start for p in gap.unfilled) == gap.frames - gap.filled
        assert all(p.reason for p in gap.unfilled)
        assert "no finite position" not in " ".join(p.reason for p in gap.unfilled)


@METHOD
@pytest.mark.parametrize("name", GAPS)
def test_gaps_of_all_kinds(method, name):
    clip = with_gaps(person(), *GAPS[name])
    result = filled(method, name)
    check(clip, result)
    assert result.complete
    truth = person().positions
    found = error(result.clip.positions, truth, result.filled)
    line = error(straight(clip), truth, result.filled)
    if method == "gpr":
        assert found < (1.0 if name == "moments" else 0.5 * line)
    # no fill diverges, wherever the gap is
    off = np.linalg.norm(result.clip.positions - truth, axis=2)
    assert off.max() < (100 if method == "gpr" else 600)


def test_the_seam_has_no_jump():
    found = filled("gpr", "overlapping").clip.positions
    step = np.linalg.norm(np.diff(found - person().positions, axis=0), axis=2)
    assert step.max() < 15.0


@METHOD
def test_dropout(method, database):
    # C7 is its own mirror image, which does not show it either
    clip = with_gaps(person(), (0, 240, ("C7",)), (60, 100, ("LELB",)))
    alone = fill_by(method, clip)
    check(clip, alone)
    (gap,) = [g for g in alone.gaps if g.label == "C7"]
    assert gap.filled == 0
    assert [(p.start, p.stop) for p in gap.unfilled] == [(0, 240)]
    assert "database" in gap.unfilled[0].reason or "no prior pose" in gap.unfilled[0].reason
    helped = fill_by(method, clip, database=database)
    check(clip, helped)
    assert helped.complete
    off = error(helped.clip.positions, person().positions, clip.missing)
    assert off < (40 if method == "gpr" else 120)
    (gap,) = [g for g in helped.gaps if g.label == "C7"]
    assert set(gap.source_clips) <= {record.name for record in database.clips()}
    assert gap.source_clips


@METHOD
def test_blackout(method):
    truth = person(rate=30.0)
    everything = truth.labels
    short = with_gaps(truth, (50, 60, everything))
    result = fill_by(method, short)
    check(short, result)
    if method == "gpr":
        assert result.complete
        assert error(result.clip.positions, truth.positions, result.filled) < 30
        assert {how for gap in result.gaps for how in gap.sources} == {
            "similar movements of the clip"
        }
    long = with_gaps(truth, (40, 80, everything), (0, 3, everything))
    result = fill_by(method, long)
    check(long, result)
    assert result.filled.any() == result.complete == (method == "gpr")
    assert len(result.gaps) == 2 * len(everything)


@METHOD
def test_limb_gap_into_a_blackout(method):
    clip = with_gaps(person(), (60, 150, ARM), (100, 115, person().labels))
    result = fill_by(method, clip)
    check(clip, result)
    assert result.filled[60:100][:, clip.missing[60]].all()
    assert result.complete == (method == "gpr")


@METHOD
def test_an_unknown_marker_set(method):
    names = tuple(f"M{i:02d}" for i in range(1, 42))
    truth = replace(person(), labels=names)
    clip = with_gaps(truth, (80, 170, [names[person().labels.index(x)] for x in ARM]))
    result = fill_by(method, clip)
    check(clip, result)
    assert result.complete
    if method == "gpr":
        line = error(straight(clip), truth.positions, result.filled)
        assert error(result.clip.positions, truth.positions, result.filled) < 0.5 * line


@METHOD
@pytest.mark.parametrize("frames", [1, 2, 3, 20])
def test_short_clips(method, frames, database):
    clip = replace(person(), positions=person().positions[:frames])
    middle = frames // 2
    clip = with_gaps(clip, (middle, middle + 1, ("LKNE",)), (0, frames, ("C7",)))
    for priors in (None, database):
        result = fill_by(method, clip, database=priors)
        check(clip, result)
        if priors is not None:
            assert result.complete


@METHOD
def test_no_frame_is_complete(method):
    truth = person(rate=30.0)
    gaps = [(8 * i, 8 * i + 8, (label,)) for i, label in enumerate(truth.labels[:15])]
    clip = with_gaps(truth, *gaps)
    assert clip.missing.any(axis=1).all()
    result = fill_by(method, clip)
    check(clip, result)
    assert result.complete
    if method == "gpr":
        assert error(result.clip.positions, truth.positions, result.filled) < 15


@METHOD
@pytest.mark.parametrize("markers", [1, 2, 3])
def test_few_markers(method, markers):
    clip = replace(
        person(), positions=person().positions[:, :markers], labels=person().labels[:markers]
    )
    clip = with_gaps(clip, (100, 110, clip.labels[:1]))
    result = fill_by(method, clip)
    check(clip, result)


@METHOD
def test_nothing_is_measured(method, database):
    clip = replace(person(), positions=np.full((30, 41, 3), np.nan))
    for priors in (None, database):
        result = fill_by(method, clip, database=priors)
        check(clip, result)
        assert not result.filled.any()


@METHOD
def test_a_clip_that_stands_still(method):
    still = replace(person(), positions=np.repeat(person().positions[:1], 120, axis=0))
    clip = with_gaps(still, (30, 80, ARM), (0, 10, ("LKNE",)), (110, 120, ("LKNE",)))
    result = fill_by(method, clip)
    check(clip, result)
    assert result.complete
    np.testing.assert_allclose(result.clip.positions, still.positions, atol=0.1)


@METHOD
def test_all_markers_in_one_place(method):
    positions = np.repeat(person().positions[:, :1], 41, axis=1)
    clip = with_gaps(replace(person(), positions=positions), (100, 130, ARM))
    result = fill_by(method, clip)
    check(clip, result)


@METHOD
@pytest.mark.parametrize("rate", [20.0, 500.0])
def test_frame_rates(method, rate):
    truth = person(rate=rate, seconds=3.0)
    clip = with_gaps(truth, (round(1.0 * rate), round(1.4 * rate), ("LKNE", "LTHI")))
    result = fill_by(method, clip)
    check(clip, result)
    assert result.complete
    if method == "gpr":
        assert error(result.clip.positions, truth.positions, result.filled) < 15


@METHOD
def test_filling_turns_and_moves_with_the_clip(method, database):
    gaps = [(35, 80, ARM[:2]), (50, 95, FOOT[:2]), (60, 68, ("C7",)), (0, 120, ("RKNE",))]
    clip = with_gaps(person(rate=30.0), *gaps, (112, 117, clip_labels()))
    angle, shift = 2.2, np.array([1500.0, -2600.0, 0.0])
    moved = clip.with_positions(naive.turned(clip.positions, angle, shift))
    for priors in (None, database):
        one = fill_by(method, clip, database=priors)
        two = fill_by(method, moved, database=priors)
        np.testing.assert_array_equal(one.filled, two.filled)
        assert one.filled.any()
        np.testing.assert_allclose(
            two.clip.positions, naive.turned(one.clip.positions, angle, shift), atol=1e-3
        )
        np.testing.assert_allclose(two.expected_rms_mm, one.expected_rms_mm, atol=1e-3)


def clip_labels() -> tuple[str, ...]:
    """All markers but the one that is missing anyway."""
    return tuple(label for label in person().labels if label != "RKNE")


@METHOD
def test_filling_does_not_depend_on_the_axes(method, database):
    clip = with_gaps(person(rate=30.0), (40, 85, ARM), (0, 120, ("RKNE",)))
    one = fill_by(method, clip, database=database).clip.positions
    for up in ("+Y", "-X"):
        turned = replace(clip, positions=from_upright(clip.positions, up), up=up)
        two = fill_by(method, turned, database=database).clip.positions
        np.testing.assert_allclose(two, from_upright(one, up), atol=1e-3)


def test_expected_error_of_the_published_method_is_the_spread_of_positions(database):
    """It does not depend on the rate: displacements per frame are not included."""
    clip = with_gaps(person(), *GAPS["limb"])
    one = fill_unchecked(clip, method="baumann2011", database=database)
    slow = fill_unchecked(replace(clip, rate=1.0), method="baumann2011", database=database)
    inside = one.filled
    ratio = np.median(slow.expected_rms_mm[inside]) / np.median(one.expected_rms_mm[inside])
    assert 0.5 < ratio < 2.0


def problems(monkeypatch, method, clip):
    """The problems (positions, free, prior) that a method gives to its solver."""
    seen = []

    def record(positions, free, prior):
        seen.append((positions.copy(), free.copy(), prior))
        return minimise(positions, free, prior)

    for module in (gpr_fill, neighbour_votes):
        monkeypatch.setattr(module, "minimise", record)
    fill_by(method, clip)
    return seen


def check_descent(found):
    assert found
    for positions, free, prior in found:
        exact = solve_exactly(positions, free, prior)
        descent = minimise(positions, free, prior, DescentOptions(tolerance=1e-12))
        # a prediction that fits the measured samples has almost no energy, so a relative tolerance
        # of the energy is too strict; the positions are compared instead
        assert descent.energy <= exact.energy * (1 + 1e-5) + 1e-8
        off = np.linalg.norm(descent.positions - exact.positions, axis=2)[free]
        assert off.max() < 0.1
        assert energy(exact.positions, prior) <= energy(positions, prior) * (1 + 1e-9)


@METHOD
def test_descent_reaches_the_exact_minimum_on_synthetic_clips(method, monkeypatch):
    clip = with_gaps(person(), *GAPS["overlapping"], *GAPS["start"], *GAPS["end"])
    check_descent(problems(monkeypatch, method, clip))


@pytest.mark.realdata
@METHOD
def test_descent_reaches_the_exact_minimum_on_a_recording(method, monkeypatch, data):
    from priorfill.formats import read

    clip = read(data / "cmu" / "127_07.c3d")
    clip = with_gaps(clip, (40, 100, [x for x in ARM if x in clip.labels]), (70, 120, ("RANK",)))
    check_descent(problems(monkeypatch, method, clip))


def test_flickering_markers_are_filled_with_any_database(database):
    """Half of all samples are missing at random: few frames show any four markers together."""
    rng = np.random.default_rng(0)
    markers = 12  # a piece of work for each gap: all 41 would take ten times as long
    whole = person(seconds=0.6)
    whole = replace(whole, positions=whole.positions[:, :markers], labels=whole.labels[:markers])
    hidden = rng.random(whole.missing.shape) < 0.5
    clip = whole.with_positions(np.where(hidden[..., None], np.nan, whole.positions))
    for priors in (None, database):
        result = fill(clip, database=priors)
        check(clip, result)
        # at the clip's ends nothing can be interpolated
        assert result.filled[10:-10].sum() > 0.95 * hidden[10:-10].sum()
        inside = result.filled.copy()
        inside[:10] = inside[-10:] = False
        assert error(result.clip.positions, whole.positions, inside) < error(
            straight(clip), whole.positions, inside
        )


def test_lag_features_determine_a_limb():
    """The visible pose is the same in both directions, but the missing limb is not."""
    rng = np.random.default_rng(5)
    frames = 600
    phase = np.cumsum(0.12 + 0.04 * np.sin(np.arange(frames) / 37.0))
    positions = np.tile(rng.uniform(-200.0, 200.0, (12, 3)), (frames, 1, 1))
    positions[:, 6:8, 2] += 100.0 * np.sin(phase)[:, None]
    positions[:, 8:, 0] += 100.0 * np.cos(phase)[:, None]
    labels = tuple(f"M{i}" for i in range(12))
    whole = Clip(positions + rng.normal(0.0, 0.2, positions.shape), labels, 60.0)
    clip = with_gaps(whole, (250, 330, labels[8:]))
    result = fill(clip)
    check(clip, result)
    assert error(result.clip.positions, whole.positions, clip.missing) < 10.0


def test_a_database_with_some_of_the_markers_helps_with_those(tmp_path):
    """The nearest visible markers are not in the database; others are."""
    other = person(seconds=6.0, seed=11, body=11)
    lacking = [other.labels.index(x) for x in ("RTHI", "RSHN", "LTHI")]
    kept = [i for i in range(41) if i not in lacking]
    with PriorDatabase.create(tmp_path / "db") as made:
        made.add(
            replace(
                other,
                positions=other.positions[:, kept],
                labels=tuple(other.labels[i] for i in kept),
            )
        )
    clip = with_gaps(person(), (0, 117, ("RKNE",)), (122, 240, ("RKNE",)))
    result = fill(clip, database=tmp_path / "db")
    assert result.complete
    assert error(result.clip.positions, person().positions, result.filled) < 60


def test_other_walkers_help_a_short_clip(tmp_path):
    """Two seconds of walking with a leg missing for one; four other subjects walk."""
    leg = ("LTHI", "LKNE", "LSHN", "LANK", "LHEE", "LTOE", "LMT5")
    whole = person(seconds=2.0)
    clip = with_gaps(whole, (40, 95, leg))
    with PriorDatabase.create(tmp_path / "db") as made:
        for body in (11, 12, 13, 14):
            made.add(person(seconds=4.0, seed=body, body=body))
    alone, helped = fill(clip), fill(clip, database=tmp_path / "db")
    check(clip, helped)
    off = [error(r.clip.positions, whole.positions, clip.missing) for r in (alone, helped)]
    assert off[1] < off[0]
    assert any("database" in how for gap in helped.gaps for how in gap.sources)
    assert all(len(gap.source_clips) > 1 for gap in helped.gaps)


def test_other_movements_do_no_harm(tmp_path):
    """Squats do not predict an arm in walking."""
    clip = with_gaps(person(seconds=6.0), (100, 190, ARM))
    with PriorDatabase.create(tmp_path / "db") as made:
        for body in (11, 12):
            made.add(person("squatting", seconds=6.0, seed=body, body=body))
    alone, misled = fill(clip), fill(clip, database=tmp_path / "db")
    truth = person(seconds=6.0).positions
    off = [error(r.clip.positions, truth, clip.missing) for r in (alone, misled)]
    assert off[1] < 1.05 * off[0]


def test_a_database_without_the_missing_limb_changes_nothing(tmp_path):
    other = person(seconds=6.0, seed=11, body=11)
    kept = [i for i, label in enumerate(other.labels) if label not in ARM]
    with PriorDatabase.create(tmp_path / "db") as made:
        made.add(
            replace(
                other,
                positions=other.positions[:, kept],
                labels=tuple(other.labels[i] for i in kept),
            )
        )
    clip = with_gaps(person(), (80, 170, ARM))
    alone, same = fill(clip), fill(clip, database=tmp_path / "db")
    np.testing.assert_array_equal(alone.clip.positions, same.clip.positions)


def test_markers_that_coincide_with_visible_ones():
    positions = np.repeat(person().positions[:, :1], 5, axis=1)
    clip = with_gaps(
        replace(person(), positions=positions, labels=person().labels[:5]),
        (100, 130, person().labels[2:3]),
    )
    result = fill(clip)
    check(clip, result)
    np.testing.assert_allclose(result.clip.positions, positions, atol=0.1)


@pytest.mark.parametrize("method", sorted(METHODS))
def test_nothing_is_asked_for(method):
    """A clip whose gaps are all left alone has missing samples but no gap group."""
    clip = with_gaps(person(), (60, 90, ("LKNE", "LANK")))
    result = fill(clip, method=method, gap_filter=GapFilter(max_gap=0.1))
    assert not result.filled.any()
    np.testing.assert_array_equal(result.clip.missing, clip.missing)
