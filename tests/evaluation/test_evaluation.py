"""Evaluation: protocols, measures, comparisons, files, and resuming."""

from __future__ import annotations

import csv
import json
import math
import os
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from gappy import person, with_gaps
from hypothesis import given
from hypothesis import strategies as st

import priorfill as pf
from priorfill import evaluation as package
from priorfill import methods as registry
from priorfill.clip import Clip, Source
from priorfill.errors import (
    ClipError,
    EvaluationError,
    MethodError,
    OptionError,
    OutputError,
)
from priorfill.evaluation import (
    EvaluationOptions,
    evaluate,
    evaluation_results,
    gap_case,
    make_protocol,
    plots,
    runner,
)
from priorfill.evaluation.body_parts import parts_of
from priorfill.evaluation.gap_generator import GapGenerator, measured_in
from priorfill.evaluation.joint_angles import angles, joint_errors
from priorfill.evaluation.metrics import MEASURES, measure, summarise
from priorfill.evaluation.outcome_store import OutcomeStore
from priorfill.evaluation.protocols import (
    PROTOCOLS,
    GapMask,
    SkippedCase,
    draw_for,
    groups_of,
)
from priorfill.evaluation.summary_tables import (
    LENGTHS,
    compare,
    length_class,
    pairs,
)
from priorfill.filling.result import UnfilledSpan
from priorfill.gaps import Gap, find_gaps
from priorfill.markers.describe import describe
from priorfill.methods import MethodEntry
from priorfill.methods.task import Estimate, Task


def broken() -> Clip:
    """A clip with gaps of its own."""
    clip = person(seconds=10.0)
    return with_gaps(clip, (200, 260, clip.labels[:10]), (0, 600, ["LELB"]))


def unknown(clip: Clip) -> Clip:
    """The clip with labels of no known marker set."""
    return replace(clip, labels=tuple(f"M{i:02d}" for i in range(len(clip.labels))))


def cuts(name: str, clip: Clip, seed: int = 0, **options: object) -> list[GapMask]:
    made = make_protocol(name, **options).cases(clip, parts_of(clip), draw_for(seed, name, "c"))
    found = list(made)
    assert all(isinstance(one, GapMask) for one in found), found
    return [one for one in found if isinstance(one, GapMask)]


def refusals(name: str, clip: Clip, **options: object) -> list[SkippedCase]:
    made = make_protocol(name, **options).cases(clip, parts_of(clip), draw_for(0, name, "c"))
    return [one for one in made if isinstance(one, SkippedCase)]


# protocols


@pytest.mark.parametrize("clip", [broken(), unknown(broken())], ids=["known", "unknown"])
@pytest.mark.parametrize("name", [name for name in PROTOCOLS if name != "like"])
def test_only_measured_samples_are_removed(name: str, clip: Clip) -> None:
    made = make_protocol(name).cases(clip, parts_of(clip), draw_for(0, name, clip.name))
    found = [one for one in made if isinstance(one, GapMask)]
    assert found
    for one in found:
        assert one.mask.any()
        assert not (one.mask & clip.missing).any()
        if name != "frames":  # adjacent samples are measured, so the gap is not extended
            touched = np.zeros_like(one.mask)
            touched[1:] |= one.mask[:-1]
            touched[:-1] |= one.mask[1:]
            assert not (touched & clip.missing).any()


@pytest.mark.parametrize("name", [name for name in PROTOCOLS if name != "like"])
def test_same_seed_same_gaps(name: str) -> None:
    clip = person(seconds=8.0)
    first, again, other = (cuts(name, clip, seed) for seed in (1, 1, 2))
    assert all((a.mask == b.mask).all() for a, b in zip(first, again, strict=True))
    assert any((a.mask != b.mask).any() for a, b in zip(first, other, strict=True))


def test_random_gaps_are_as_many_and_as_long_as_asked() -> None:
    clip = person(seconds=12.0)
    for one in cuts("random", clip, copies=4):
        assert 0.03 <= one.mask.mean() < 0.09 + 2.0 * clip.rate / one.mask.size
        assert one.mask.sum(axis=1).max() <= 7
    one = cuts("random", clip, copies=1, number=(5, 5), seconds=(0.2, 0.3), max_missing=2)[0]
    gaps = find_gaps(one.mask)
    assert len(gaps) == 5
    assert all(0.18 <= gap.frames / clip.rate <= 0.32 for gap in gaps)
    assert one.mask.sum(axis=1).max() <= 2


def test_a_long_clip_gets_its_share_too() -> None:
    clip = person(seconds=30.0, rate=30.0)
    one = cuts("random", clip, copies=1, share=(0.09, 0.09), seconds=(0.1, 0.3))[0]
    assert one.mask.mean() >= 0.09


def test_each_marker_in_its_turn() -> None:
    clip = person()
    found = cuts("markers", clip)
    assert [one.name for one in found] == list(clip.labels)
    for i, one in enumerate(found):
        assert [(gap.marker, gap.frames) for gap in find_gaps(one.mask)] == [(i, round(clip.rate))]
    some = cuts("markers", clip, markers=("LELB", "LTOE"), copies=2)
    assert [(one.name, one.copy) for one in some] == [
        ("LELB", 1), ("LELB", 2), ("LTOE", 1), ("LTOE", 2)
    ]  # fmt: skip
    spelt = cuts("markers", clip, markers=("lelb", "?TOE"))
    assert [one.name for one in spelt] == ["LELB", "LTOE", "RTOE"]
    reason = refusals("markers", clip, markers=("LTOES",))[0].reason
    assert reason.startswith("the clip has no such marker; did you mean LTOE")
    missing = refusals("markers", broken())
    assert [one.name for one in missing] == ["LELB"]
    assert "nowhere measured throughout 1.00 s" in missing[0].reason


def test_groups_are_arms_and_legs() -> None:
    clip = person(seconds=8.0)
    named = {
        one.name: {clip.labels[m] for m in np.flatnonzero(one.mask.any(axis=0))}
        for one in cuts("groups", clip)
    }
    assert list(named) == ["arms", "legs", "both"]
    assert {"LELB", "RELB", "LFIN"} <= named["arms"]
    assert {"LKNE", "RTOE"} <= named["legs"]
    assert named["both"] == named["arms"] | named["legs"]
    assert not named["arms"] & named["legs"]
    left = cuts("groups", clip, groups=("left_arm",))[0]
    assert find_gaps(left.mask)[0].frames == round(3.0 * clip.rate)
    assert refusals("groups", clip, groups=("wings",))[0].reason.startswith("the clip has no such")


def test_a_short_clip_loses_its_limbs_for_half_of_it() -> None:
    clip = person(seconds=4.0)
    assert find_gaps(cuts("groups", clip)[0].mask)[0].frames == clip.frames // 2


def test_groups_of_an_unknown_body_are_found() -> None:
    clip = unknown(person(seconds=8.0))
    parts = parts_of(clip)
    assert not parts.known
    assert all(len(markers) >= 4 for markers in groups_of(parts).values())
    assert len(cuts("groups", clip)) == len(groups_of(parts))


def test_periodic_gaps_come_again() -> None:
    clip = person(seconds=10.0)
    one = cuts("periodic", clip, copies=1, number=(2, 2), seconds=(0.5, 0.5), period=2.0)[0]
    gaps = find_gaps(one.mask)
    markers = {gap.marker for gap in gaps}
    assert len(markers) == 2
    for marker in markers:
        mine = [gap for gap in gaps if gap.marker == marker]
        assert all(gap.frames == 30 for gap in mine)
        assert all(b.start - a.start == 120 for a, b in pairwise(mine))
        assert len(mine) >= 4


def test_whole_frames() -> None:
    clip = broken()
    for one in cuts("frames", clip):
        rows = one.mask.any(axis=1)
        assert (one.mask[rows] == ~clip.missing[rows]).all()
        assert 6 <= rows.sum() <= 30


def test_the_gaps_of_another_file() -> None:
    pattern = with_gaps(
        person(seconds=6.0, rate=120.0), (100, 160, ["LKNE", "RKNE"]), (300, 330, ["LTOE"]),
        (0, 720, ["C7"]),
    )  # fmt: skip
    clip = person(seconds=6.0, rate=60.0, seed=4)
    first, second = cuts("like", clip, pattern=pattern, copies=2)
    place = {name: clip.labels.index(name) for name in ("LKNE", "RKNE", "LTOE", "C7")}
    assert first.mask[:, place["C7"]].all()
    gaps = {gap.marker: (gap.start, gap.stop) for gap in find_gaps(first.mask)}
    assert gaps[place["LKNE"]] == gaps[place["RKNE"]] == (50, 80)
    assert gaps[place["LTOE"]] == (150, 165)
    moved = {gap.marker: gap for gap in find_gaps(second.mask)}
    assert moved[place["LKNE"]].frames == 30
    assert moved[place["LKNE"]].frames == moved[place["RKNE"]].frames
    # where the clip has a gap of its own, the pattern goes elsewhere
    elsewhere = with_gaps(clip, (60, 61, ["LKNE"]))
    one = cuts("like", elsewhere, pattern=pattern)[0]
    assert not (one.mask & elsewhere.missing).any()
    assert one.mask[:, place["LKNE"]].sum() == 30


def test_the_gaps_of_another_file_stay_together_when_moved() -> None:
    pattern = with_gaps(person(seconds=2.0), (40, 60, ["LKNE"]), (50, 70, ["RKNE"]))
    clip = person(seconds=8.0, seed=4)
    found = [find_gaps(one.mask) for one in cuts("like", clip, pattern=pattern, copies=6)]
    assert [gap.start for gap in found[0]] == [40, 50]
    assert all(right.start - left.start == 10 for left, right in found)
    assert len({left.start for left, _ in found}) > 3
    # of a longer file a part is taken
    longer = with_gaps(person(seconds=8.0), *((s, s + 10, ["LKNE"]) for s in range(10, 470, 40)))
    for one in cuts("like", person(seconds=2.0, seed=4), pattern=longer, copies=4):
        assert 1 <= len(find_gaps(one.mask)) <= 4


def test_copied_gaps_need_gaps_and_common_markers() -> None:
    with pytest.raises(OptionError, match="has no gaps to be copied"):
        make_protocol("like", pattern=person())
    with pytest.raises(OptionError, match="`pattern`"):
        make_protocol("like")
    pattern = with_gaps(person(), (10, 20, ["LKNE"]))
    assert "is of its markers" in refusals("like", unknown(person()), pattern=pattern)[0].reason


def test_samples_that_the_file_marks_as_interpolated_are_not_removed() -> None:
    clip = person()
    interpolated = np.zeros_like(clip.missing)
    interpolated[:, :20] = True
    source = Source(Path("a.c3d"), "", tuple(range(len(clip.labels))), clip.labels,
                    interpolated=interpolated)  # fmt: skip
    marked = replace(clip, source=source)
    assert not (measured_in(marked) & interpolated).any()
    assert not any((one.mask & interpolated).any() for one in cuts("random", marked))


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        (
            "magic",
            {},
            "no protocol 'magic'; use one of random, markers, groups",
        ),
        (
            "frames",
            {"period": 2.0},
            "frames has no option `period`; it has `copies`",
        ),
        ("random", {"copies": 0}, "`copies` is 0; give numbers of 1 and more"),
        ("random", {"seconds": (2.0, 1.0)}, "the lower one first"),
        ("random", {"share": (0.1, 0.9)}, "`share` is up to 0.9; give 0.5 at most"),
        ("periodic", {"seconds": (2.0, 2.0)}, "do not fit into a period of 2 s"),
    ],
)
def test_options_that_make_no_sense(name: str, options: dict[str, object], message: str) -> None:
    with pytest.raises(OptionError, match=message.replace("(", r"\(")):
        make_protocol(name, **options)


def test_no_place_is_found_where_nothing_is_measured() -> None:
    clip = with_gaps(person(), (0, 240, person().labels))
    generator = GapGenerator(clip, np.random.default_rng(0))
    assert not generator.remove([0], 30)
    assert not generator.scatter(0.1, (0.1, 0.2), 3)


# metrics


@given(st.integers(0, 10**6))
def test_measures_against_their_formulas(seed: int) -> None:
    """Measures computed sample by sample from the differences of each clip."""
    rng = np.random.default_rng(seed)
    truth = rng.normal(size=(12, 3, 3)) * 100
    filled = truth + 0.0
    gaps = [Gap(3, 7, 0), Gap(0, 2, 1), Gap(9, 12, 2)]
    for gap in gaps:
        filled[gap.start : gap.stop, gap.marker] += rng.normal(size=(gap.frames, 3))
    filled[5, 0] = np.nan
    expected_rms, bound = rng.uniform(1, 2, (2, 12, 3))
    rate = 50.0
    found = measure(truth, filled, expected_rms, bound, gaps, rate)
    column = 0
    for gap in gaps:
        for t in range(gap.start, gap.stop):
            x, y = filled[:, gap.marker], truth[:, gap.marker]
            off = x[t] - y[t]
            nothing = np.full(3, np.nan)
            inner = 0 < t < 11 and not np.isnan(off).any()
            v = [(z[t + 1] - z[t - 1]) * rate / 2 for z in (x, y)] if inner else [nothing] * 2
            a = (
                [(z[t + 1] - 2 * z[t] + z[t - 1]) * rate**2 / 1000 for z in (x, y)]
                if inner
                else [nothing] * 2
            )
            expected = [
                math.sqrt(sum(off**2)),
                sum(abs(off)) / 3,
                np.linalg.norm(v[0] - v[1]),
                np.linalg.norm(a[0] - a[1]),
                4 / math.sqrt(6 * math.pi) * expected_rms[t, gap.marker],
                bound[t, gap.marker],
            ]
            np.testing.assert_allclose(found[:, column], expected, rtol=1e-3, atol=1e-5)
            column += 1
    assert column == found.shape[1]


def test_a_summary_by_hand() -> None:
    samples = np.full((len(MEASURES), 5), np.nan, dtype=np.float32)
    samples[0] = [1.0, 2.0, 3.0, 6.0, np.nan]
    samples[1] = [0.5, 1.0, 1.5, 3.0, np.nan]
    samples[4] = [2.0, 2.0, np.nan, np.nan, 9.0]
    samples[5] = [1.5, 1.5, np.nan, np.nan, 9.0]
    summary = summarise(samples)
    assert (summary.samples, summary.filled, summary.share) == (5, 4, 0.8)
    assert summary.mean == 3.0
    assert summary.rmse == pytest.approx(math.sqrt(50 / 4))
    assert summary.median == 2.5
    assert summary.p95 == pytest.approx(5.55)
    assert summary.maximum == 6.0
    assert summary.mae == 1.5
    assert summary.expected_mean_error_mm == 2.0
    assert summary.error_bound_90_coverage == 0.5
    assert math.isnan(summary.velocity)
    nothing = summarise(np.full((len(MEASURES), 3), np.nan, dtype=np.float32))
    assert (nothing.samples, nothing.filled) == (3, 0)
    assert math.isnan(nothing.mean)


@pytest.mark.parametrize(
    ("seconds", "name"), [(0.1, "0-0.1 s"), (0.11, "0.1-0.25 s"), (4.0, "2-4 s"), (9.0, "> 4 s")]
)
def test_classes_of_length(seconds: float, name: str) -> None:
    assert length_class(seconds) == name
    assert len({length_class(s) for s in LENGTHS[1:]}) == len(LENGTHS) - 1


@given(st.floats(0.0, 180.0), st.integers(0, 10**6))
def test_angle_between_constructed_lines(degrees: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    joint = rng.normal(size=3) * 1000
    up = np.array([1.0, 0.0, 0.0])
    down = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees)), 0.0])
    first, last = (joint + turn @ (v * rng.uniform(100, 500)) for v in (up, down))
    assert angles(first[None], joint[None], last[None])[0] == pytest.approx(degrees, abs=1e-6)


def test_an_angle_of_nothing() -> None:
    point = np.zeros((2, 3))
    assert np.isnan(angles(point, point, point + 1)).all()
    assert np.isnan(angles(np.full((2, 3), np.nan), point, point + 1)).all()


def test_joint_errors_are_of_the_frames_removed() -> None:
    """A knee marker with a lateral error, compared with the law of cosines."""
    clip = person()
    removed = np.zeros_like(clip.missing)
    knee = clip.labels.index("LKNE")
    removed[30:50, knee] = True
    filled = clip.positions.copy()
    filled[30:45, knee, 1] += 40.0
    filled[45:50, knee] = np.nan
    found = joint_errors(describe(clip), clip.labels, clip.positions, filled, removed)
    assert set(found) == {"left_knee", "left_hip", "left_ankle"}

    def cosine_law(x: np.ndarray) -> np.ndarray:
        hip = (x[:, clip.labels.index("LFWT")] + x[:, clip.labels.index("LBWT")]) / 2
        at, ankle = x[:, knee], x[:, clip.labels.index("LANK")]
        a, b, c = (np.linalg.norm(u - v, axis=1)
                   for u, v in ((hip, at), (ankle, at), (hip, ankle)))  # fmt: skip
        return np.degrees(np.arccos((a**2 + b**2 - c**2) / (2 * a * b)))

    off = np.abs(cosine_law(filled[30:45]) - cosine_law(clip.positions[30:45]))
    np.testing.assert_allclose(found["left_knee"], off, atol=1e-4)
    assert joint_errors(describe(unknown(clip)), clip.labels, filled, filled, removed) == {}


# methods with known errors


def _off(millimetres: float, share: float = 1.0):
    """Return a method with a constant vertical error that fills the first markers only."""

    def run(task: Task, progress: object) -> Estimate:
        assert np.isnan(task.positions).any()
        positions = np.where(np.isnan(task.positions), TRUTH["x"], task.positions)
        positions[..., 2] += np.where(task.valid, 0.0, millimetres)
        positions[:, round(share * positions.shape[1]) :] = np.nan
        return Estimate.without_errors(task, positions, "the truth", "not of the first")

    return run


TRUTH: dict[str, np.ndarray] = {}


def refusing(task: Task, progress: object) -> Estimate:
    raise MethodError(f"{task.name}: it does not want to; give it a reason")


def faulty(task: Task, progress: object) -> Estimate:
    raise ZeroDivisionError("nobody\nthought of that")


@pytest.fixture
def tame(monkeypatch: pytest.MonkeyPatch) -> Clip:
    """A clip, and methods whose errors are known."""
    clip = person()
    TRUTH["x"] = clip.positions
    made = {"one": _off(1.0), "three": _off(3.0), "half": _off(0.5, 0.7), "few": _off(0.1, 0.2),
            "refusing": refusing, "faulty": faulty}  # fmt: skip
    for name in made:
        monkeypatch.setitem(registry.METHODS, name, MethodEntry(f"{name}:fill", "", ""))
    real = registry.get_method
    for module in ("fill_clip", "run_settings"):
        monkeypatch.setattr(
            f"priorfill.filling.{module}.get_method",
            lambda name: made[name] if name in made else real(name),
        )
    return clip


def test_errors_of_methods_with_known_errors(tame: Clip) -> None:
    found = evaluate(tame, methods=["three", "one"], protocol=make_protocol("random", copies=3))
    for name, size in (("one", 1.0), ("three", 3.0)):
        errors = found.methods[name].errors
        assert errors.share == 1.0
        for value in (errors.mean, errors.rmse, errors.median, errors.p95, errors.maximum):
            assert value == pytest.approx(size, rel=1e-5)
        assert errors.mae == pytest.approx(size / 3, rel=1e-5)
    assert list(found.methods) == ["three", "one"]
    assert list(found.comparison.methods) == ["one", "three"]
    assert found.best == "one"
    assert found.worked
    pair = found.pairs[0]
    assert (pair.first, pair.second, pair.first_better) == ("three", "one", 0.0)
    assert pair.samples == found.comparison.samples == found.comparison.of
    gaps = sum(len(one.gaps) for one in found.plan.cases)
    assert len(found.gaps) == 2 * gaps
    assert sum(count for count, _ in found.markers.values()) == 2 * gaps
    assert sum(count for count, _ in found.lengths.values()) == 2 * gaps


def test_unfilled_samples_do_not_count_in_the_comparison(tame: Clip) -> None:
    each_fourth = make_protocol("markers", markers=tame.labels[::4])
    found = evaluate(tame, methods="three,half,few,one", protocol=each_fourth)
    half, few = found.methods["half"].errors, found.methods["few"].errors
    assert half.share == pytest.approx(8 / 11)
    assert half.mean == pytest.approx(0.5, rel=1e-4)
    assert few.share == pytest.approx(2 / 11)
    comparison = found.comparison
    assert comparison.left_out == ("few",)
    assert comparison.samples == half.filled < comparison.of
    assert {name: one.samples for name, one in comparison.methods.items()} == dict.fromkeys(
        ("half", "one", "three"), half.filled
    )
    by_pair = {(pair.first, pair.second): pair for pair in found.pairs}
    assert by_pair["three", "one"].samples == comparison.of
    assert by_pair["half", "few"].samples == few.filled
    reasons = {row.unfilled for row in found.gaps if row.method == "few" and not row.errors.filled}
    assert reasons == {("not of the first",)}


def test_a_method_that_cannot_work_does_not_stop_the_others(tame: Clip) -> None:
    found = evaluate(
        tame, methods="refusing,one,faulty", protocol=make_protocol("frames", copies=2)
    )
    cases = len(found.plan.cases)
    assert not found.worked
    row = found.methods["refusing"]
    assert row.refused == {f"{tame.name}: it does not want to; give it a reason": cases}
    assert row.errors.filled == 0
    assert row.errors.samples == found.methods["one"].errors.filled
    assert list(found.methods["faulty"].refused) == [
        "a fault of the method (ZeroDivisionError: nobody thought of that)"
    ]
    assert found.best == "one"
    assert found.comparison.left_out == ("refusing", "faulty")
    text = json.dumps(found.to_dict(), allow_nan=False)
    assert '"mean_mm": null' in text


def test_reasons_come_only_from_unfilled_frames_inside_the_gap() -> None:
    result = pf.fill(with_gaps(person(seconds=2.0), (20, 60, ["LKNE"])), method="linear")
    spans = tuple(UnfilledSpan(t, t + 10, f"reason {t}", True) for t in (20, 30, 50))
    result = replace(result, gaps=(replace(result.gaps[0], unfilled=spans),))
    reasons = {
        (start, stop): gap_case._source_of(result, Gap(start, stop, marker=0), "LKNE").unfilled
        for start, stop in ((30, 40), (40, 50), (29, 41), (39, 51))
    }
    assert reasons == {
        (30, 40): ("reason 30",),
        (40, 50): (),
        (29, 41): ("reason 20", "reason 30"),
        (39, 51): ("reason 30", "reason 50"),
    }


def test_no_method_fills_anything(tame: Clip) -> None:
    found = evaluate(tame, methods="refusing", protocol="frames")
    assert found.best is None
    assert found.comparison.samples == 0
    assert compare(found.outcomes, found.plan).left_out == ("refusing",)
    assert pairs(found.outcomes, found.plan) == []


def test_truth_is_not_left_in_the_database(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clip, other = person(), person(seed=9, body=2)
    with pf.PriorDatabase.create(tmp_path / "db") as database:
        own = database.add(replace(clip, name="itself"))
        database.add(replace(other, name="other"))
    seen: list[set[str]] = []

    def spy(task: Task, progress: object) -> Estimate:
        seen.append({take.name for take in task.takes})
        return Estimate.of(task)

    monkeypatch.setattr("priorfill.filling.run_settings.get_method", lambda name: spy)
    # too little is left for a sketch to recognise the clip
    heavy = make_protocol("random", copies=2, share=(0.5, 0.5), max_missing=40)
    found = evaluate(clip, methods="linear", protocol=heavy, database=tmp_path / "db")
    assert seen == [{"other"}] * 2
    assert own.content in found.plan.sources[0].selection.not_names
    assert found.settings["database"]["clips"] == 2


# errors before any fill


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"methods": "linear,magic"}, OptionError, "no method 'magic'; use one of auto, gpr"),
        ({"methods": []}, OptionError, "no method is named"),
        ({"protocol": "magic"}, OptionError, "no protocol 'magic'"),
        ({"seed": -1}, OptionError, "^`seed` is -1; give 0 or more$"),
        ({"clips": []}, ClipError, "no clip is given"),
        ({"clips": [person(), person()]}, ClipError, "give each clip once"),
        ({"clips": person(seconds=0.05)}, ClipError, "no gap can be made: .*too short"),
    ],
)
def test_wrong_usage(
    options: dict[str, object], error: type[Exception], message: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setattr(gap_case, "fill", None)  # nothing is filled
    with pytest.raises(error, match=message):
        evaluate(**{"clips": person(), "methods": "linear"} | options)


def test_clips_of_one_name_are_told_apart() -> None:
    first, second = person(seconds=1.0), person(seconds=1.0, seed=5)
    some = make_protocol("frames", copies=1)
    found = evaluate([first, replace(second, name=first.name)], methods="linear", protocol=some)
    assert list(found.clips) == [first.name, f"{first.name} (2)"]


# the folder


def test_files_have_the_results(tmp_path: Path) -> None:
    made = make_protocol("markers", markers=person().labels[::5])
    found = evaluate(person(), methods="linear,spline", output=tmp_path / "out", protocol=made)
    with (tmp_path / "out/gaps.csv").open(newline="", encoding="utf-8") as lines:
        rows = list(csv.DictReader(lines))
    assert len(rows) == 2 * len(person().labels[::5])
    assert {row["method"] for row in rows} == {"linear", "spline"}
    assert {row["sources"] for row in rows if row["method"] == "linear"} == {
        "straight lines over time"
    }
    assert all(row["unfilled"] == row["source_clips"] == "" for row in rows)
    assert {row["training_poses"] for row in rows} == {"0"}
    assert {"expected_mean_error_mm", "error_bound_90_coverage"} <= set(rows[0])
    mean = np.average(
        [float(row["mean_mm"]) for row in rows if row["method"] == "spline"],
        weights=[int(row["filled"]) for row in rows if row["method"] == "spline"],
    )
    assert mean == pytest.approx(found.methods["spline"].errors.mean, rel=1e-4)
    facts = json.loads((tmp_path / "out/results.json").read_text(encoding="utf-8"))
    assert facts == found.to_dict()
    assert facts["settings"]["seed"] == 0
    assert facts["settings"]["protocol"]["name"] == "markers"
    assert {file.name for file in (tmp_path / "out").iterdir()} == {
        *evaluation_results.FILES, "evaluation.json", "cases"
    }  # fmt: skip


def _count_fills(monkeypatch: pytest.MonkeyPatch, last: int | None = None) -> list[str]:
    """Count fills; raise an interrupt after the last one."""
    made: list[str] = []
    real = gap_case.run_case

    def counted(source: object, one: gap_case.GapCase, method: str) -> object:
        if last is not None and len(made) == last:
            raise KeyboardInterrupt
        made.append(method)
        return real(source, one, method)

    monkeypatch.setattr(runner, "run_case", counted)
    return made


def test_it_goes_on_where_it_was_interrupted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clip = person(seconds=1.0)

    def run() -> pf.Evaluation:
        return evaluate(clip, methods="linear,spline", protocol="frames", output=tmp_path / "o")

    with monkeypatch.context() as patch:
        _count_fills(patch, last=4)
        with pytest.raises(KeyboardInterrupt):
            run()
    kept = sorted((tmp_path / "o/cases").iterdir())
    assert len(kept) == 4
    kept[0].write_bytes(kept[0].read_bytes()[:100])  # torn: made again
    kept[1].write_bytes(b"")
    np.savez(kept[2], facts=np.array("[" * 100_000), samples=np.zeros(3))
    (tmp_path / "o/cases/.00000-linear.0123.part.npz").write_bytes(b"")
    steps: list[tuple[int, int]] = []
    made = _count_fills(monkeypatch)
    found = evaluate(
        clip, methods="linear,spline", protocol="frames", output=tmp_path / "o",
        options=EvaluationOptions(progress=lambda done, total: steps.append((done, total))),
    )  # fmt: skip
    assert len(made) == 9
    assert steps[0] == (1, 10)
    assert steps[-1] == (10, 10)
    assert len(list((tmp_path / "o/cases").iterdir())) == 10
    uninterrupted = evaluate(clip, methods="linear,spline", protocol="frames")
    assert _figures(found) == _figures(uninterrupted)
    made.clear()
    assert _figures(run()) == _figures(uninterrupted)
    assert made == []


def _figures(found: pf.Evaluation) -> object:
    """All results except times."""
    facts = found.to_dict()
    for rows in (facts["methods"], *facts["clips"].values()):
        for row in rows.values():
            del row["seconds"]
    return facts


@pytest.mark.parametrize(
    ("options", "differs"),
    [
        ({"seed": 1}, "seed 0, not 1"),
        ({"methods": "spline"}, "methods linear, not spline"),
        (
            {"protocol": make_protocol("markers", markers=("LKNE",), seconds=(0.2, 0.2))},
            "protocol name frames, not mark",
        ),
        ({"clips": person(seed=8, seconds=1.0)}, "clips"),
    ],
)
def test_other_options_in_the_same_folder(
    tmp_path: Path, options: dict[str, object], differs: str
) -> None:
    some = make_protocol("frames", copies=2)
    given_ = {"clips": person(seconds=1.0), "methods": "linear", "protocol": some}
    given_["output"] = tmp_path
    evaluate(**given_)
    with pytest.raises(OptionError, match=f"holds an evaluation with {differs}"):
        evaluate(**given_ | options)
    (tmp_path / "error_by_length.png").write_bytes(b"old")
    again = evaluate(**given_ | options, options=EvaluationOptions(overwrite=True))
    assert not (tmp_path / "error_by_length.png").exists()
    assert len(list((tmp_path / "cases").iterdir())) == len(again.outcomes)


def test_folders_with_other_contents_are_not_changed(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("mine", encoding="utf-8")
    for overwrite in (False, True):
        with pytest.raises(OutputError, match="holds something else"):
            options = EvaluationOptions(overwrite=overwrite)
            evaluate(person(), methods="linear", output=tmp_path, options=options)
    with pytest.raises(OutputError, match="is a file"):
        evaluate(person(), methods="linear", output=tmp_path / "thesis.txt")
    assert [file.name for file in tmp_path.iterdir()] == ["thesis.txt"]


# in parallel


def test_processes_make_no_difference_and_a_killed_one_is_named(tmp_path: Path) -> None:
    """The last case of the pool ends the worker process that receives it."""
    clip = person(seconds=1.0)
    alone = evaluate(clip, methods="linear", protocol="frames")
    plan = replace(alone.plan, cases=(*alone.plan.cases, _Deadly(0, "deadly", 1, ())))
    store = OutcomeStore(tmp_path, plan)
    with pytest.raises(
        EvaluationError, match=r"a process was killed with . of 6 fills done.* kept"
    ):
        runner.run_plan(plan, jobs=2, store=store)
    kept = dict(store.kept())
    # four were handed out at first, and the last one only when two of them were finished
    assert 2 <= len(kept) <= 5
    for job, outcome in kept.items():
        np.testing.assert_array_equal(outcome.samples, alone.outcomes[job].samples)
        assert outcome.joints.keys() == alone.outcomes[job].joints.keys()
        assert outcome.gap_sources == alone.outcomes[job].gap_sources


class _Deadly(gap_case.GapCase):
    """A case that ends the worker process that receives it."""

    def __reduce__(self) -> tuple[object, ...]:
        return os._exit, (9,)


# plots


def test_plots(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    clips = [person(seconds=3.0), unknown(person(seconds=3.0, seed=5))]
    some = make_protocol("markers", markers=("LKNE", "LTOE", "M05", "M06"))
    found = evaluate(clips, methods="linear,spline", protocol=some, output=tmp_path)
    files = plots.draw_plots(tmp_path, found)
    assert [file.name for file in files] == [
        "errors_by_method.png",
        "error_by_length.png",
        "error_by_marker_baumann41.png",
        "error_by_marker_discovered.png",
    ]
    for file in files:
        assert file.read_bytes().startswith(b"\x89PNG")


def test_plots_of_nothing(tame: Clip, tmp_path: Path) -> None:
    assert plots.draw_plots(tmp_path, evaluate(tame, methods="refusing", protocol="frames")) == []


def test_more_methods_than_colours_are_told_apart() -> None:
    styles = [plots._style(i) for i in range(24)]
    looks = {(s["color"], s["marker"], s["linestyle"]) for s in styles}
    assert len(looks) == 24


def test_public_names() -> None:
    assert pf.evaluate is evaluate
    assert set(package.__all__) <= set(dir(package))
