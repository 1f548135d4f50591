"""The scripts of Li et al.'s tables, on a short synthetic recording."""

from __future__ import annotations

import importlib
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from gappy import person
from scripted import SCRIPTS

import priorfill as pf
from priorfill.clip import Clip
from priorfill.evaluation.protocols import GapMask, SkippedCase, draw_for
from priorfill.formats import write
from priorfill.gaps import find_gaps

PAPERS = SCRIPTS / "papers"
if str(PAPERS) not in sys.path:
    sys.path.insert(0, str(PAPERS))

li = importlib.import_module("li")
names = ("table1", "table2", "table4", "fig8", "fig9")
scripts = {name: importlib.import_module(f"li_{name}") for name in names}

SMALLER: dict[str, dict[str, object]] = {
    "table1": {"VARIANTS": {"Eq. (4)": {}, "truth": {"truth": True}}},
    "table2": {"PUBLISHED": {1: "1.2831", 8: "5.7161"}},
    "table4": {"EQUATION_4": {100: "146.6", 900: "151.1"}, "REPEATS": 1},
    "fig8": {"MISSING": (1, 20)},
    "fig9": {"NUMBERS": (1, 15)},
}
"""What is replaced, to keep the input small."""

ROWS = {
    "table1": ["20 ", "50 ", "80 ", "100 "],
    "table2": ["1 ", "8 "],
    "table4": ["pca-pieces, 100 frames", "wpca"],
    "fig8": ["1 (0.5%)", "20 (10.0%)"],
    "fig9": ["1 ", "15 "],
}

METHODS = {"fig8": "linear,pca-frames", "table4": "pca-pieces,wpca"}


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two samples and a rest."""
    file = tmp_path_factory.mktemp("walk") / "walk.c3d"
    write(file, person(seconds=15.0, rate=30.0))
    return file


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One sample, and half of one to learn from."""
    file = tmp_path_factory.mktemp("walk") / "walk.c3d"
    write(file, person(seconds=10.0, rate=30.0))
    return file


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fill in this process: others take longer to start than there is to do."""
    monkeypatch.setattr(li, "processes", lambda: 0)


def arguments(recording: Path, *more: str) -> list[str]:
    return ["--data", str(recording.parent / "nothing"), "--recording", str(recording), *more]


def run(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], given: list[str]
) -> list[str]:
    monkeypatch.setattr(sys, "argv", [f"li_{name}.py", *given])
    assert scripts[name].main() == 0
    return capsys.readouterr().out.splitlines()


# scripts


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("name", names)
def test_each_script_prints_ours_beside_the_papers(
    name: str,
    short: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    methods = METHODS.get(name, "pca-pieces,linear")
    for attribute, value in SMALLER[name].items():
        assert hasattr(scripts[name], attribute)
        monkeypatch.setattr(scripts[name], attribute, value)
    lines = run(name, monkeypatch, capsys, arguments(short, "--methods", methods))
    assert lines[0].startswith("Paper: ")
    head = next(
        i for i, line in enumerate(lines) if line.startswith(("MAE in mm", "CPU ms", "CPU"))
    )
    columns = lines[head + 1].split()[1:]
    assert columns == (["ours", "paper"] if name == "table4" else methods.split(","))
    for row, line in zip(ROWS[name], lines[head + 2 :], strict=False):
        assert line.startswith(row)
        values = line.removeprefix(row).split()
        ours = values[0].removesuffix("%)")
        # with all markers missing only methods over time fill anything
        assert ours == "-" or float(ours) > 0.0
    [compared] = [line for line in lines if "cells are within" in line] or [""]
    cells = {"table1": 4, "table2": 2, "table4": 2}.get(name, 0)
    assert (f"of {cells} cells" in compared) == bool(cells)


@pytest.mark.parametrize(
    ("name", "values"), [("table1", 28), ("table2", 5), ("table4", 12)], ids=str
)
def test_all_values_of_the_paper_are_compared(name: str, values: int) -> None:
    script = scripts[name]
    if name == "table1":
        assert sum(map(len, script.PUBLISHED.values())) == values
        assert set(script.PUBLISHED) == set(li.METHODS_OF_TABLE_1)
    elif name == "table2":
        assert len(script.PUBLISHED) == values
    else:
        assert len(script.EQUATION_4) + len(script.WITHOUT_TRAINING) == values


def test_a_script_runs_by_itself(tmp_path: Path) -> None:
    command = [sys.executable, str(PAPERS / "li_fig8.py"), "--data", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, encoding="utf-8", check=False)
    assert done.returncode == 1
    assert "--recording" in done.stderr and "Traceback" not in done.stderr


def test_unknown_methods_are_told(recording: Path) -> None:
    some = material(recording)
    with pytest.raises(SystemExit, match=r"unknown method; use some of auto .*pca-train"):
        li.evaluated(some, li.EvenGaps((1,), (9,)), "linear,nonsense")


# samples


def material(recording: Path, *more: str) -> object:
    parser = li.parser_of("A table.", ["linear"])
    return li.material(parser.parse_args(arguments(recording, *more)))


def test_each_complete_stretch_is_a_sample(recording: Path) -> None:
    some = material(recording)
    clip = pf.read(recording)
    at = [clip.labels.index(label) for label in li.JOINTS]
    kept = [(clip.positions[:, at][i : i + li.SAMPLE]) for i in range(0, clip.frames, li.SAMPLE)]
    assert len(kept) == 3  # the last too short for a sample
    for found, wanted in ((some.samples, kept[:2]), (some.training, kept)):
        assert [part.labels for part in found] == [li.JOINTS] * len(wanted)
        for part, positions in zip(found, wanted, strict=True):
            np.testing.assert_allclose(part.positions, positions, atol=1e-9)


@pytest.mark.usefixtures("here")
def test_no_sample_is_filled_from_itself(recording: Path) -> None:
    some = material(recording)
    found = li.evaluated(some, li.EvenGaps((3,), (20,)), "pca-train")
    for job, outcome in found.outcomes.items():
        learnt = {name for source in outcome.gap_sources for name in source.source_clips}
        assert learnt
        assert some.samples[found.plan.cases[job.case].clip].name not in learnt


def test_the_truth_among_the_training_data_is_found(recording: Path) -> None:
    """Translated frames of the sample are learnt from, and only where this is asked for."""
    some = material(recording)
    gaps = li.EvenGaps((5,), (50,))
    without, with_it = (
        li.filled_by(some, gaps, "pca-pieces", truth=truth, max_windows=1)["5 x 50"]
        for truth in (False, True)
    )
    assert with_it < 0.5 * without


@pytest.mark.usefixtures("here")
def test_a_sample_alone_is_filled_without_a_database(tmp_path: Path) -> None:
    write(tmp_path / "rest.c3d", person(seconds=6.8, rate=30.0))
    some = material(tmp_path / "rest.c3d")
    assert (len(some.samples), len(some.training)) == (1, 1)
    [row] = li.evaluated(some, li.EvenGaps((1,), (100,)), "r2").gaps
    assert row.errors.filled == 100


def test_recordings_come_to_the_papers_rate(tmp_path: Path) -> None:
    write(tmp_path / "fast.c3d", person(seconds=8.0, rate=60.0))
    [sample] = material(tmp_path / "fast.c3d").samples
    assert (sample.rate, sample.frames) == (li.RATE, li.SAMPLE)
    truth = person(seconds=8.0, rate=60.0)
    at = [truth.labels.index(label) for label in li.JOINTS]
    off = np.linalg.norm(sample.positions - truth.positions[: 2 * li.SAMPLE : 2, at], axis=2)
    assert np.median(off) < 1.0


def test_other_markers_are_all_used(tmp_path: Path) -> None:
    clip = person(seconds=8.0, rate=30.0)
    fewer = Clip(clip.positions[:, :12], clip.labels[:12], clip.rate, clip.up)
    write(tmp_path / "other.c3d", fewer)
    [sample] = material(tmp_path / "other.c3d").samples
    assert sample.labels == clip.labels[:12]


def test_other_recordings_are_learnt_from_but_not_the_truth(
    recording: Path, tmp_path: Path
) -> None:
    clip = person(seconds=15.0, rate=30.0)
    for name in ("walk.c3d", "other.c3d"):  # the first is what is filled
        write(tmp_path / name, clip)
    write(tmp_path / "fewer.c3d", Clip(clip.positions[:, :9], clip.labels[:9], clip.rate, clip.up))
    some = material(recording, "--training", str(tmp_path))
    assert [part.name for part in some.samples] == ["walk 1", "walk 2"]
    assert [part.name for part in some.training] == [f"other {i}" for i in range(1, 4)]
    assert [file.name for file in some.files] == ["other.c3d"]
    (tmp_path / "other.c3d").unlink()
    with pytest.raises(SystemExit, match="choose another --training"):
        material(recording, "--training", str(tmp_path))


def test_what_is_too_short_is_refused(tmp_path: Path) -> None:
    write(tmp_path / "short.c3d", person(seconds=3.0, rate=30.0))
    with pytest.raises(SystemExit, match=r"no complete sample of 15 markers and 6\.7 s"):
        material(tmp_path / "short.c3d")


# gaps


def cases(protocol: object, clip: Clip) -> list[GapMask | SkippedCase]:
    return list(protocol.cases(clip, None, draw_for(0, "test", clip.name)))


@pytest.mark.parametrize("number", range(1, 16))
def test_markers_are_evenly_distributed(number: int) -> None:
    markers = li.evenly_distributed(number, 15)
    assert len(set(markers)) == number
    assert set(markers) <= set(range(15))
    intervals = np.diff(markers)
    assert not len(intervals) or intervals.max() - intervals.min() <= 1
    if number in (1, 2, 3, 5, 8, 15):  # the paper's
        assert len(set(intervals)) <= 1


def test_gaps_begin_at_frame_101() -> None:
    clip = person(seconds=8.0, rate=30.0)
    found = cases(li.EvenGaps((1, 5), (20, 100)), clip)
    assert [case.name for case in found] == ["1 x 20", "1 x 100", "5 x 20", "5 x 100"]
    for made in found:
        assert isinstance(made, GapMask)
        number, length = map(int, made.name.split(" x "))
        gaps = find_gaps(made.mask)
        assert {(gap.start, gap.stop) for gap in gaps} == {(100, 100 + length)}
        assert len(gaps) == number
    [made] = cases(li.EvenGaps((len(clip.labels) + 1,), (20,)), clip)
    assert isinstance(made, SkippedCase)


# errors


@pytest.mark.usefixtures("here")
def test_mae_is_the_mean_norm_over_the_frames_of_each_gap(recording: Path) -> None:
    """Eq. (17): Euclidean norms, and the number of frames as the divisor."""
    clip = material(recording).samples[0]
    found = li.evaluated(li.Material([clip], [], []), li.EvenGaps((2,), (30,)), "linear")
    means = []
    for marker in li.evenly_distributed(2, 15):
        positions = clip.positions[:, marker]
        line = np.linspace(positions[99], positions[130], 32)[1:-1]
        means.append(np.linalg.norm(line - positions[100:130], axis=1).sum() / 30)
    error, share = li.mae(found, "linear")
    assert share == 1.0
    assert error == pytest.approx(np.mean(means), rel=1e-4)


@pytest.mark.usefixtures("here")
def test_what_is_not_filled_is_told(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    some = material(recording)
    one = li.Material(some.samples[:1], [], [])
    found = li.evaluated(one, li.EvenGaps((3, 15), (20,)), "pca-train")
    assert np.isnan(li.mae(found, "pca-train", case="15 x 20")[0])
    assert li.cell(found, "pca-train").endswith(" (16 %)")  # of 3 + 15 markers
    assert isinstance(li.cell(found, "pca-train", case="3 x 20"), float)
    li.refusals(found)
    assert capsys.readouterr().out == ""
    job = next(iter(found.outcomes))
    refused = replace(found.outcomes[job], refused="too short")
    li.refusals(replace(found, outcomes=found.outcomes | {job: refused}))
    assert capsys.readouterr().out == "pca-train: failed on 1 of 2 cases: too short\n"


def test_a_share_is_never_rounded_up_to_all() -> None:
    assert li.floored(0.9999) == 99
    assert li.floored(1.0) == 100
