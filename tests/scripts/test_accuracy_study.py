"""The accuracy study: its gaps, quality measures, counts, and that it resumes correctly."""

from __future__ import annotations

import csv
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from gappy import person
from scripted import load_script

import priorfill as pf
from priorfill.clip import Clip
from priorfill.evaluation.body_parts import MIN_LIMB_MARKERS, parts_of
from priorfill.evaluation.gap_generator import MIN_EDGE_SECONDS
from priorfill.formats import write
from priorfill.gaps import find_gaps

gaps = load_script("artificial_gaps")
fill_quality = load_script("fill_quality")
study = load_script("accuracy_study")
rows_module = load_script("accuracy_rows")
tables = load_script("accuracy_tables")

SECONDS = {
    "single": (0.5, 2.0),
    "segment": (1.0, 2.0),
    "limb": (1.0, 3.0),
    "limbs": (1.0, 2.0),
    "ends": (0.5, 1.0),
    "blackout": (0.1, 0.5),
    "short": (1.0, 2.0),
}


def long_person() -> Clip:
    """A clip that has itself a gap in its middle, which no artificial gap may touch."""
    clip = person(seconds=16.0, rate=60.0)
    positions = clip.positions.copy()
    positions[400:430, :10] = np.nan
    return clip.with_positions(positions)


def unknown_person() -> Clip:
    clip = person(seconds=12.0)
    return replace(clip, labels=tuple(f"M{i:02d}" for i in range(len(clip.labels))))


# the gaps


@pytest.mark.parametrize("clip", [long_person(), unknown_person()], ids=["known", "unknown"])
@pytest.mark.parametrize("kind", gaps.KINDS)
def test_gaps_of_a_kind(kind: str, clip: Clip) -> None:
    parts = parts_of(clip)
    found = [gaps.cut_gaps(kind, clip, parts, np.random.default_rng(seed)) for seed in range(8)]
    cut = [result for result in found if result is not None]
    assert len(cut) >= 5
    for truth, gone in cut:
        assert gone.shape == truth.missing.shape
        assert gone.any()
        assert not (gone & truth.missing).any()
        runs = find_gaps(gone)
        if kind in SECONDS:
            low, high = SECONDS[kind]
            for gap in runs:
                assert low - 0.02 <= gap.frames / truth.rate <= high + 0.02
            assert len({(gap.start, gap.stop) for gap in runs}) == 1
        markers = len({gap.marker for gap in runs})
        if kind == "single":
            assert markers == 1
        elif kind == "blackout":
            assert gone.all(axis=1).any()
        elif kind == "dropout":
            assert markers in (1, 2)
            assert gone.all(axis=0).sum() == markers
        elif kind == "ends":
            assert gone[0].any() or gone[-1].any()
        elif kind in ("limb", "short"):
            assert any(sorted(limb) == sorted({g.marker for g in runs}) for limb in parts.limbs)
        elif kind == "segment":
            assert markers >= 2
        elif kind == "scatter":
            assert gone.sum(axis=1).max() <= gaps.RANDOM_MAX_MISSING
            assert len(runs) > 3
            assert gone.mean() < gaps.RANDOM_GAP_SHARE[1] + 0.02
        elif kind == "long":
            span = np.flatnonzero(gone.any(axis=1))
            assert 2.0 - 0.02 <= len(span) / truth.rate <= 6.02
            assert span[-1] - span[0] + 1 == len(span)
            assert markers >= 5
        if kind == "short":
            assert (~gone.any(axis=1)).sum() == round(gaps.SHORT_SECONDS * truth.rate)
        elif kind not in ("ends", "dropout"):
            assert not gone[: round(MIN_EDGE_SECONDS * truth.rate) - 1].any()
            assert not gone[-round(MIN_EDGE_SECONDS * truth.rate) + 1 :].any()
    masks = {gone.tobytes() for _, gone in cut}
    assert len(masks) > 1 or kind == "dropout"
    again = gaps.cut_gaps(kind, clip, parts, np.random.default_rng(7))
    assert (again is None) == (found[7] is None)
    if again is not None and found[7] is not None:
        np.testing.assert_array_equal(again[1], found[7][1])


def test_no_gap_longer_than_half_of_the_clip() -> None:
    clip = person(seconds=3.0)
    parts = parts_of(clip)
    rng = np.random.default_rng(0)
    assert gaps.cut_gaps("long", clip, parts, rng) is None
    for _ in range(10):
        _, gone = gaps.cut_gaps("limb", clip, parts, rng)
        assert gone.any(axis=1).mean() <= 0.51


def test_limbs_of_a_known_body() -> None:
    clip = person()
    parts = parts_of(clip)
    names = [{clip.labels[i] for i in limb} for limb in parts.limbs]
    assert len(names) == 4
    assert {"LUPA", "LELB", "LFRM", "LWRA", "LWRB", "LFIN"} in names
    assert {"RTHI", "RKNE", "RSHN", "RANK", "RHEE", "RTOE", "RMT5"} in names


def test_limbs_of_an_unknown_body_are_near_each_other() -> None:
    clip = unknown_person()
    parts = parts_of(clip)
    assert parts.limbs
    size = np.linalg.norm(np.ptp(clip.positions[0], axis=0))
    for limb in parts.limbs:
        assert len(set(limb)) == len(limb) >= MIN_LIMB_MARKERS
        assert np.linalg.norm(np.ptp(clip.positions[0, limb], axis=0)) < 0.6 * size


# quality of fills


def test_a_step_at_an_edge_is_seen() -> None:
    """x = t²: second differences of 2 everywhere; a fill that is 5 off has 5 more at its edges."""
    time = np.arange(60.0)
    path = np.stack([time**2, 0 * time, 0 * time], axis=1)
    assert fill_quality.edge_step(path, 20, 40) == pytest.approx(2.0)
    assert fill_quality.reference_step(path) == pytest.approx(2.0)
    off = path.copy()
    off[20:40, 0] -= 5.0
    assert fill_quality.edge_step(off, 20, 40) == pytest.approx(7.0)
    assert fill_quality.edge_step(off, 20, 41) == pytest.approx(7.0)
    off[30] += 100.0  # not at the edge
    assert fill_quality.edge_step(off, 20, 40) == pytest.approx(7.0)


def test_edges_of_gaps_at_the_ends_of_a_clip() -> None:
    path = np.zeros((30, 3))
    path[:10, 2] = 3.0
    assert fill_quality.edge_step(path, 0, 10) == pytest.approx(3.0)
    assert fill_quality.edge_step(path, 10, 30) == pytest.approx(3.0)
    assert np.isnan(fill_quality.edge_step(path, 0, 30))
    assert np.isnan(fill_quality.reference_step(path[:20]))
    path[10:] = np.nan
    assert np.isnan(fill_quality.edge_step(path, 0, 10))


def test_shaking_is_power_above_what_bodies_do() -> None:
    rate, time = 120.0, np.arange(240) / 120.0
    slow = 300.0 * np.sin(2 * np.pi * 2.0 * time)
    fast = np.sin(2 * np.pi * 25.0 * time)
    path = np.zeros((240, 3))
    path[:, 0] = slow
    smooth = fill_quality.jitter(path, rate)
    path[:, 1] = fast
    jittery = fill_quality.jitter(path, rate)
    assert jittery[0] > 100 * smooth[0]
    assert jittery[1] == pytest.approx(np.sqrt(0.5), rel=0.02)  # rms of a sine of 1 mm
    assert smooth[1] < 0.05
    path[:, 1] = 2.0 * fast
    assert fill_quality.jitter(path, rate)[0] == pytest.approx(4.0 * jittery[0], rel=0.02)
    turned = path[:, [2, 0, 1]]
    assert fill_quality.jitter(turned, rate) == pytest.approx(fill_quality.jitter(path, rate))
    assert np.isnan(fill_quality.jitter(path[:20], rate)).all()


def test_depth() -> None:
    assert fill_quality.penetration(np.array([30.0, 12.0, 40.0]), 20.0) == 8.0
    assert fill_quality.penetration(np.array([30.0, 22.0]), 20.0) == 0.0


# the tables


def row(case: str, database: str, error: float, frames: int = 100, **more: object) -> object:
    """A row with neutral values for all other fields."""
    kinds = {"str": "", "int": 0, "float": float("nan")}
    nothing = {f.name: kinds[str(f.type)] for f in fields(rows_module.Row)}
    summary = {
        "case": case,
        "kind": case.split("-")[0],
        "database": database,
        "method": "auto",
        "frames": frames,
        "filled": frames,
        "seconds": frames / 100,
        "error": error,
        "linear": 10.0,
    }
    return rows_module.Row(**(nothing | summary | more))


def table(text: str, first: str) -> dict[str, list[str]]:
    """The last table of a text, its cells by kind and database."""
    lines = text[text.index(first) :].splitlines()[2:]
    return {" ".join(line.split()[:2]): line.split() for line in lines if line}


def test_all_cases_have_equal_weight(capsys: pytest.CaptureFixture[str]) -> None:
    """A blackout of 8 gaps with 4 mm, and a single gap with 1 mm: a geometric mean of 2."""
    rows = [row("blackout-0", "none", 4.0, start=i) for i in range(8)]
    rows.append(row("single-0", "none", 1.0))
    rows.append(row("single-1", "none", float("nan"), filled=0))
    tables.print_errors(rows)
    text = capsys.readouterr().out
    found = table(text[: text.index("By length")], "Mean error")
    assert found["blackout none"][2:] == ["8", "0", *["4.00"] * 5, "0.40"]
    assert found["single none"][2:] == ["2", "1", *["1.00"] * 5, "0.10"]
    assert found["all cases"][3:6] == ["3", "1", "2.00"]


def test_ratio_of_errors_with_and_without_a_database(capsys: pytest.CaptureFixture[str]) -> None:
    rows = [row("limb-0", "none", 4.0, start=1), row("limb-0", "full", 2.0, start=1)]
    rows += [row("limb-0", "none", 4.0, start=2), row("limb-0", "full", 8.0, start=2)]
    rows += [row("limb-1", "full", 8.0)]  # not filled without one
    tables.print_ratios(rows)
    line = table(capsys.readouterr().out, "Ratio of errors")["limb auto"]
    assert line[-4:] == ["2", "1.00", "2.00", "50%"]


def test_coverage_counts_samples(capsys: pytest.CaptureFixture[str]) -> None:
    summary = {"bound": 9.0, "expected_mean": 2.0}
    rows = [row("limb-0", "none", 1.0, frames=300, below=300, below_gap=0, **summary)]
    rows += [row("limb-1", "none", 4.0, frames=100, below=0, below_gap=90, **summary)]
    tables.print_uncertainty(rows)
    text = capsys.readouterr().out
    line = table(text, "Coverage")["limb auto"]
    assert line[2:] == ["none", "2", "400", "75.0%", "22.5%", "50%", "1.00", "0%", "-"]
    assert "50.0%" in text.splitlines()[-1]  # each case the same


# the study


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of recordings: two walks of bd, one of dg, and one of nobody's marker set."""
    place = tmp_path_factory.mktemp("data")
    (place / "hdm05").mkdir()
    (place / "walkl").mkdir()
    for seed, name in ((1, "HDM_bd_a"), (2, "HDM_bd_b"), (3, "HDM_dg_c")):
        clip = person(seconds=5.0, rate=30.0, seed=seed, body=seed)
        write(place / "hdm05" / f"{name}.c3d", replace(clip, name=name))
    write(place / "walkl" / "walkl.c3d", unknown_person())
    return place


def run(recordings: Path, output: Path, *more: str) -> int:
    line = ["--data", str(recordings), "-o", str(output), "--processes", "1"]
    return study.main([*line, "--folders", "hdm05", "--kinds", "single,limb,dropout", *more])


def lines_of(output: Path) -> list[dict[str, str]]:
    with (output / "accuracy.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_the_study_resumes(
    recordings: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert run(recordings, tmp_path, "--count", "1") == 0
    text = capsys.readouterr().out
    for title in (
        "3 cases from ",
        "Mean error of each gap, by auto",
        "By length of the gap",
        "Ratio of errors with and without a database",
        "Coverage of the 90 % bounds",
        "Quality. ",
        "The worst 3 cases",
    ):
        assert title in text
    rows = lines_of(tmp_path)
    assert {row["database"] for row in rows} == {"none", "full", "no-subject"}
    limb = [row for row in rows if row["kind"] == "limb"]
    assert len(limb) >= 3 * 4
    assert all(0 < float(row["error"]) < 300 for row in limb)
    assert all(float(row["error"]) <= float(row["rms"]) <= float(row["worst"]) for row in limb)
    dropped = {row["database"]: row for row in rows if row["kind"] == "dropout"}
    # the partner on the other side tells where it is; other bodies tell better
    assert {int(dropped[name]["filled"]) for name in ("none", "full")} == {150}
    assert float(dropped["full"]["error"]) < float(dropped["none"]["error"])

    # nothing is filled again
    whole = (tmp_path / "accuracy.csv").read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(study, "run_case", None)
        assert run(recordings, tmp_path, "--count", "1") == 0
    assert (tmp_path / "accuracy.csv").read_bytes() == whole
    assert capsys.readouterr().out == text

    # an incomplete last line: only that fill is repeated
    (tmp_path / "accuracy.csv").write_bytes(whole[:-40])
    asked = []
    fill = study.fill

    def counting(plan: object, case: object, database: str, method: str) -> object:
        asked.append(database)
        return fill(plan, case, database, method)

    monkeypatch.setattr(study, "fill", counting)
    assert run(recordings, tmp_path, "--count", "1") == 0
    assert len(asked) == 1
    same = ("case", "database", "marker", "start", "error", "bound", "edge")

    def facts(rows: list[dict[str, str]]) -> list[tuple[str, ...]]:
        return sorted(tuple(row[name] for name in same) for row in rows)

    assert facts(lines_of(tmp_path)) == facts(rows)

    # one more method adds only its own
    assert run(recordings, tmp_path, "--count", "1", "--methods", "neighbours", "--databases",
               "none", "--kinds", "single") == 0  # fmt: skip
    assert asked[1:] == ["none"]
    assert "by neighbours" in capsys.readouterr().out


def test_what_a_database_may_hold(recordings: Path, tmp_path: Path) -> None:
    plan = study.Plan(recordings, tmp_path / "databases", ("hdm05",), 0, 25.0)
    study.make_databases(plan)
    number = next(
        n for n in range(20) if study.draw_case(plan, "limb", n).file.stem.startswith("HDM_bd")
    )
    case = study.draw_case(plan, "limb", number)
    other = "HDM_bd_b" if case.file.stem == "HDM_bd_a" else "HDM_bd_a"
    for database, names in (("full", {other, "HDM_dg_c"}), ("no-subject", {"HDM_dg_c"})):
        result = study.fill(plan, case, database, "baumann2011")
        assert {name for gap in result.gaps for name in gap.source_clips} == names
    assert study.fill(plan, case, "none", "auto").database is None


def test_recordings_of_no_known_set_have_no_database(recordings: Path, tmp_path: Path) -> None:
    options = ("--folders", "walkl", "--kinds", "segment", "--count", "1")
    assert run(recordings, tmp_path, *options) == 0
    assert {row["database"] for row in lines_of(tmp_path)} == {"none"}


def test_windows(recordings: Path, tmp_path: Path) -> None:
    plan = study.Plan(recordings, tmp_path, ("hdm05",), 0, 3.0)
    cases = [study.draw_case(plan, "single", n) for n in range(6)]
    assert {case.truth.frames for case in cases} == {90}
    assert len({case.truth.first_frame for case in cases}) > 1
    for case in cases:
        whole = pf.read(case.file).positions
        first = case.truth.first_frame
        np.testing.assert_array_equal(case.truth.positions, whole[first : first + 90])


def test_a_failure_is_named_and_the_rest_goes_on(
    recordings: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    whole = study.fill

    def failing(plan: object, case: object, *rest: str) -> object:
        if case.kind == "limb":
            raise RuntimeError("no luck")
        return whole(plan, case, *rest)

    monkeypatch.setattr(study, "fill", failing)
    assert run(recordings, tmp_path, "--count", "1", "--databases", "none") == 1
    assert capsys.readouterr().err == "limb-0: RuntimeError: no luck\n"
    assert {row["kind"] for row in lines_of(tmp_path)} == {"single", "dropout"}


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (["--kinds", "limb,hole"], "--kinds: hole is not one of single"),
        (["--databases", "some"], "--databases: some is not one of none full no-subject"),
        (["--methods", "splien"], "--methods: there is no method 'splien'"),
    ],
)
def test_wrong_usage(
    options: list[str],
    word: str,
    recordings: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit) as status:
        run(recordings, tmp_path / "new", *options)
    assert status.value.code == 2
    assert word in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_no_recordings_and_a_foreign_file(
    recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(recordings, tmp_path, "--folders", "cmu") == 1
    assert "no recordings in cmu; use --data" in capsys.readouterr().err
    (tmp_path / "accuracy.csv").write_text("a,b\n1,2\n")
    with pytest.raises(SystemExit, match="is not a file of this study"):
        run(recordings, tmp_path, "--databases", "none")
    assert (tmp_path / "accuracy.csv").read_text() == "a,b\n1,2\n"
