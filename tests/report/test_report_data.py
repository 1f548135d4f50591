"""What the page shows of results: states, versions, facts, sizes, and clips at the limits."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from page_decoding import decoded, expand, unpacked

import priorfill as pf
from priorfill.errors import ClipError
from priorfill.filling.result import UnfilledSpan
from priorfill.report.page import page_text
from priorfill.report.report_data import PageContents, page_data
from priorfill.synthetic.demo import make_demo_clip

QUICK = pf.FillOptions(estimate_errors=False)


@pytest.fixture(scope="module")
def demo() -> tuple[pf.Clip, pf.Clip, pf.Result]:
    """The truth, the clip with gaps, and its fill by straight lines."""
    truth, clip = make_demo_clip()
    return truth, clip, pf.fill(clip, method="linear")


def clip_of(frames: int, markers: int, rate: float = 100.0, up: str = "+Z") -> pf.Clip:
    rng = np.random.default_rng(frames)
    positions = rng.normal(0.0, 2.0, (frames, markers, 3)).cumsum(axis=0) + 500.0
    return pf.Clip(positions, tuple(f"M{i}" for i in range(markers)), rate, up)


def test_states_positions_and_errors_of_a_fill(demo: tuple[pf.Clip, pf.Clip, pf.Result]) -> None:
    _, clip, result = demo
    data = page_data(result)
    states = expand(data["states"])
    assert ((states == 2) == result.filled).all()
    assert ((states == 0) == result.clip.missing).all()
    shown = decoded(data["versions"][0]["positions"]) / 10.0
    known = ~result.clip.missing
    assert np.abs(shown - result.clip.positions)[known].max() <= 0.05 + 1e-9
    stored = unpacked(data["bound_90"]["data"], 2)
    expected = result.error_bound_90_mm.T[result.filled.T]
    assert len(stored) == result.filled.sum()
    assert np.allclose(
        stored[np.isfinite(expected)] / 10.0, expected[np.isfinite(expected)], atol=0.051
    )
    assert sorted(gap["badness"] for gap in data["gaps"]) == list(range(len(result.gaps)))
    assert sum(m["missing_before"] for m in data["markers"]) == clip.missing.sum()
    assert sum(m["missing_after"] for m in data["markers"]) == result.clip.missing.sum()


def test_the_page_has_options_in_place_of_arguments(
    demo: tuple[pf.Clip, pf.Clip, pf.Result],
) -> None:
    result = demo[2]
    span = UnfilledSpan(0, 1, "too few are visible (`extrapolate`)")
    gap = replace(result.gaps[0], unfilled=(span,))
    noted = replace(result, gaps=(gap, *result.gaps[1:]), notes=("+Z is up (see `up`), `L KNE`",))
    data = page_data(noted)
    reasons = [one["reason"] for row in data["gaps"] for one in row["unfilled"]]
    assert "too few are visible (option extrapolate)" in reasons
    rows = [row for table in data["facts"] if table["title"] == "Notes" for row in table["rows"]]
    assert ["", "+Z is up (see option up), `L KNE`"] in rows


def test_positions_are_upright() -> None:
    clip = clip_of(20, 3, up="+Y")
    data = page_data(pf.fill(clip, method="linear", options=QUICK))
    shown = decoded(data["versions"][0]["positions"]) / 10.0
    assert np.allclose(shown[..., 2], clip.positions[..., 1], atol=0.051)
    assert data["clip"]["up"] == "+Y"


def test_the_truth_gives_true_errors(demo: tuple[pf.Clip, pf.Clip, pf.Result]) -> None:
    truth, _, result = demo
    data = page_data(result, PageContents(truth=truth))
    gap, found = result.gaps[0], data["gaps"][0]
    inside = slice(gap.start, gap.stop), truth.labels.index(gap.label)
    off = np.linalg.norm(result.clip.positions[inside] - truth.positions[inside], axis=1)
    assert found["true_mean"] == pytest.approx(off.mean(), abs=0.01)
    version = next(one for one in data["versions"] if one["kind"] == "truth")
    assert (expand(version["shown"]) == (result.filled | result.clip.missing)).all()
    titles = [table["title"] for table in data["facts"]]
    assert "True errors" in titles


def test_measured_samples_that_were_replaced_are_shown(
    demo: tuple[pf.Clip, pf.Clip, pf.Result],
) -> None:
    truth, _, _ = demo
    wrong = truth.positions.copy()
    wrong[100:110, 3] += 400.0
    clip = truth.with_positions(wrong)
    entry = pf.GapOverride(
        (truth.labels[3],), "missing", *(truth.first_frame + f for f in (100, 109))
    )
    result = pf.fill(clip, method="linear", overrides=pf.Overrides((entry,)), options=QUICK)
    data = page_data(result, PageContents(before=clip))
    states = expand(data["states"])
    assert (states[100:110, 3] == 4).all()
    assert (states == 4).sum() == 10
    original = data["versions"][1]
    assert original["kind"] == "original"
    assert (expand(original["shown"]) == (states == 4)).all()
    assert np.allclose(
        decoded(original["positions"])[100:110, 3] / 10.0, wrong[100:110, 3], atol=0.051
    )
    assert data["decisions"][0]["do"] == "missing"
    assert page_data(result)["versions"][1:] == []


def test_facts_name_what_was_done(demo: tuple[pf.Clip, pf.Clip, pf.Result]) -> None:
    _, clip, _ = demo
    gap_filter = pf.GapFilter(max_gap=0.4)
    result = pf.fill(clip, method="linear", gap_filter=gap_filter, options=QUICK)
    facts = {table["title"]: table["rows"] for table in page_data(result)["facts"]}
    rows = dict(map(tuple, facts["Fill"]))
    assert rows["Method"] == "linear"
    assert rows["Gaps filled"] == "max_gap 0.4"
    assert rows["Filled"] == f"{result.filled.sum()} samples"
    assert dict(map(tuple, facts["Recording"]))["Frames"].startswith(f"{clip.frames} (")
    assert [name for name, _ in facts["Versions"]][:2] == ["python", "priorfill"]


@pytest.mark.parametrize(
    ("frames", "markers", "rate"), [(1, 1, 100.0), (2, 1, 1e6), (5, 2, 0.01), (400, 1, 1e6)]
)
@pytest.mark.parametrize("missing", ["none", "some", "all"])
def test_clips_at_the_limits(frames: int, markers: int, rate: float, missing: str) -> None:
    clip = clip_of(frames, markers, rate)
    positions = clip.positions.copy()
    if missing == "all":
        positions[:] = np.nan
    elif missing == "some":
        positions[frames // 3 : 1 + frames // 2, 0] = np.nan
    clip = clip.with_positions(positions)
    result = pf.fill(clip, method="linear", options=QUICK)
    data = page_data(result, PageContents(before=clip))
    assert json.loads(json.dumps(data, allow_nan=False)) == data
    assert len(data["gaps"]) == len(result.gaps)
    assert page_text(data)


def test_subjects_are_not_connected() -> None:
    clips = [replace(clip_of(50, 5), subject=name) for name in ("Anna", "Ben")]
    data = page_data(pf.fill(clips, method="linear", options=QUICK))
    assert data["subjects"] == ["Anna", "Ben"]
    assert [one["subject"] for one in data["markers"]] == [0] * 5 + [1] * 5
    assert data["markers"][5]["label"] == "Ben:M0"
    assert data["markers"][5]["own"] == "M0"
    assert data["sticks"]
    assert all((i < 5) == (j < 5) for i, j in data["sticks"])


def test_clips_that_do_not_fit_are_refused(demo: tuple[pf.Clip, pf.Clip, pf.Result]) -> None:
    truth, _, result = demo
    shorter = truth.with_positions(truth.positions[:-1])
    with pytest.raises(ClipError, match="frames"):
        page_data(result, PageContents(truth=shorter))
    with pytest.raises(ClipError, match="frame rate"):
        page_data(result, PageContents(truth=replace(truth, rate=77.0)))
    others = replace(truth, labels=tuple(f"X{label}" for label in truth.labels))
    with pytest.raises(ClipError, match="has no marker"):
        page_data(result, PageContents(truth=others))
    with pytest.raises(ClipError, match="has no marker"):
        page_data(result, PageContents(before=others))


def test_a_page_of_41_markers_is_small() -> None:
    rng = np.random.default_rng(1)
    time = np.arange(3000)[:, None, None] / 120.0
    positions = 400.0 * np.sin(4.0 * time + rng.uniform(0, 6, (1, 41, 3)))
    positions = positions + rng.normal(0.0, 0.05, positions.shape)
    for marker in range(0, 41, 2):
        positions[100 * (1 + marker // 4) :, marker][:80] = np.nan
    clip = pf.Clip(positions, tuple(f"M{i}" for i in range(41)), 120.0)
    result = pf.fill(clip, method="linear", options=QUICK)
    first, second = (page_text(page_data(result)) for _ in range(2))
    assert first == second
    assert len(first) < 500_000
