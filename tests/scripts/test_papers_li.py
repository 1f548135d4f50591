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
from priorfill.evaluation.protocols import (
    FrameGaps,
    GapMask,
    SkippedCase,
    draw_for,
)
from priorfill.formats import write
from priorfill.gaps import find_gaps

PAPERS = SCRIPTS / "papers"
if str(PAPERS) not in sys.path:
    sys.path.insert(0, str(PAPERS))

li = importlib.import_module("li")
names = ("table1", "table2", "table3", "table4", "fig8", "fig9")
scripts = {name: importlib.import_module(f"li_{name}") for name in names}

FEWER = {
    "table2": ("GAPS", (10, 100)),
    "table3": ("NUMBERS", (1, 14)),
    "table4": ("INTERVALS", (2, 25)),
    "fig8": ("MISSING", (1, 20)),
}
"""What the scripts go through, and of that what the test does."""

METHODS = {"fig8": "linear,pca-frames", "fig9": "pca-train,linear"}


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two samples with something to learn from after each."""
    file = tmp_path_factory.mktemp("walk") / "walk.c3d"
    write(file, person(seconds=28.0, rate=30.0))
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
    methods = METHODS.get(name, "pca-train,linear")
    rows = {"table1": ["walk 1"], "fig9": li.JOINTS}.get(name, [])
    if name in FEWER:
        what, values = FEWER[name]
        assert set(values) <= set(getattr(scripts[name], what))
        monkeypatch.setattr(scripts[name], what, values)
        rows = list(map(str, values))
    lines = run(name, monkeypatch, capsys, arguments(short, "--methods", methods))
    assert lines[0].startswith("Paper: ")
    head = next(i for i, line in enumerate(lines) if line.endswith("  paper"))
    assert "not available" in lines[head - 1]
    assert lines[head].split()[1:] == [*methods.split(","), "paper"]
    for row, line in zip(rows, lines[head + 1 : head + 1 + len(rows)], strict=True):
        assert line.startswith(row)
        *ours, papers = line.removeprefix(row).split()
        assert papers == "-"  # nothing is known, and nothing may be made up
        unseen = name == "fig9"  # linear knows nothing of a marker that is never seen
        assert float(ours[0]) >= 0.0
        assert ours[1] == "-" if unseen else float(ours[1]) >= 0.0


def test_a_script_runs_by_itself(tmp_path: Path) -> None:
    command = [sys.executable, str(PAPERS / "li_fig8.py"), "--data", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, encoding="utf-8", check=False)
    assert done.returncode == 1
    assert "--recording" in done.stderr and "Traceback" not in done.stderr


def test_unknown_methods_are_told(recording: Path) -> None:
    some = material(recording)
    with pytest.raises(SystemExit, match=r"unknown method; use some of auto .*pca-train"):
        li.evaluated(some, li.Onward(), "linear,nonsense")


# samples


def material(recording: Path, *more: str) -> object:
    parser = li.parser_of("A table.", full="more")
    return li.material(parser.parse_args(arguments(recording, *more)))


def test_samples_and_training_share_no_frame(recording: Path) -> None:
    some = material(recording)
    clip = pf.read(recording)
    at = [clip.labels.index(label) for label in li.JOINTS]
    kept = [(clip.positions[:, at][i : i + li.SAMPLE]) for i in range(0, clip.frames, li.SAMPLE)]
    assert len(kept) == 5  # the last too short for a sample
    for found, wanted in (
        (some.samples, [kept[0], kept[2]]),
        (some.training, [kept[1], kept[3], kept[4]]),
    ):
        assert [part.labels for part in found] == [li.JOINTS] * len(wanted)
        for part, positions in zip(found, wanted, strict=True):
            np.testing.assert_allclose(part.positions, positions, atol=1e-9)
    assert [part.frames for part in some.first(130).samples] == [130, 130]


@pytest.mark.usefixtures("here")
def test_what_is_left_is_not_learnt_from_where_it_is_too_little(tmp_path: Path) -> None:
    write(tmp_path / "rest.c3d", person(seconds=6.8, rate=30.0))
    some = material(tmp_path / "rest.c3d")
    assert (len(some.samples), some.training) == (1, [])
    [row] = li.evaluated(some, li.Onward(), "r2").gaps
    assert row.errors.filled == li.SAMPLE - li.COMPLETE_FRAMES


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
    clip = person(seconds=28.0, rate=30.0)
    for name in ("walk.c3d", "other.c3d"):  # the first is what is filled
        write(tmp_path / name, clip)
    write(tmp_path / "fewer.c3d", Clip(clip.positions[:, :9], clip.labels[:9], clip.rate, clip.up))
    some = material(recording, "--training", str(tmp_path))
    assert [part.name for part in some.samples] == ["walk 1", "walk 3"]
    assert [part.name for part in some.training] == [f"other {i}" for i in range(1, 6)]
    assert [file.name for file in some.files] == ["other.c3d"]
    (tmp_path / "other.c3d").unlink()
    with pytest.raises(SystemExit, match="choose another --training"):
        material(recording, "--training", str(tmp_path))


@pytest.mark.usefixtures("here")
def test_seconds_are_the_mean_over_cases(recording: Path) -> None:
    found = li.evaluated(material(recording), li.Onward(copies=2), "linear")
    taken = [made.seconds for made in found.outcomes.values()]
    assert len(taken) == 4
    assert li.seconds(found, "linear") == pytest.approx(sum(taken) / 4)
    assert np.isnan(li.seconds(found, "spline"))


def test_what_is_too_short_is_refused(tmp_path: Path) -> None:
    write(tmp_path / "short.c3d", person(seconds=3.0, rate=30.0))
    with pytest.raises(SystemExit, match=r"no complete sample of 15 markers and 6\.7 s"):
        material(tmp_path / "short.c3d")


# gaps


def cases(protocol: object, clip: Clip) -> list[GapMask | SkippedCase]:
    return list(protocol.cases(clip, None, draw_for(0, "test", clip.name)))


def test_markers_are_missing_to_the_end_and_more_of_them_in_turn() -> None:
    clip = person(seconds=8.0, rate=30.0)
    few, more = cases(li.Onward(numbers=(2, 5)), clip)
    for made, number in ((few, 2), (more, 5)):
        assert isinstance(made, GapMask)
        gaps = find_gaps(made.mask)
        assert {(gap.start, gap.stop) for gap in gaps} == {(li.COMPLETE_FRAMES, clip.frames)}
        assert len(gaps) == number
    assert (more.mask | ~few.mask).all()
    markers = {gap.marker for c in cases(li.Onward(copies=9), clip) for gap in find_gaps(c.mask)}
    assert len(markers) > 1


def test_some_marker_stays() -> None:
    clip = person(seconds=8.0, rate=30.0)
    [made] = cases(li.Onward(numbers=(len(clip.labels),)), clip)
    assert isinstance(made, SkippedCase)


def test_each_marker_is_missing_throughout() -> None:
    clip = person()
    found = cases(li.Throughout(), clip)
    assert [case.name for case in found] == list(clip.labels)
    for marker, case in enumerate(found):
        assert case.mask[:, marker].all() and case.mask.sum() == clip.frames


def test_several_protocols_are_told_apart() -> None:
    clip = person()
    few, many = (FrameGaps(copies=2, seconds=(s, s)) for s in (0.1, 0.5))
    found = cases(li.Several({"few": few, "many": many}), clip)
    assert [case.name for case in found] == ["few", "few", "many", "many"]
    wanted = cases(few, clip) + cases(many, clip)
    assert all((a.mask == b.mask).all() for a, b in zip(found, wanted, strict=True))


# errors


@pytest.mark.usefixtures("here")
def test_mae_is_the_mean_over_gaps_not_over_samples(recording: Path) -> None:
    some = material(recording)
    clip = some.samples[0]
    few, many = (li.Onward(start=start) for start in (190, 110))
    found = li.evaluated(li.Material([clip], [], []), li.Several({"1": few, "2": many}), "linear")
    means = []
    for made in cases_of(found):
        [gap] = made.gaps
        positions = clip.positions[:, gap.marker]
        # at the end of a clip a straight line has one end only
        held = np.repeat(positions[gap.start - 1][None], gap.frames, axis=0)
        means.append(np.linalg.norm(held - positions[gap.start : gap.stop], axis=1).mean())
    error, share = li.mae(found, "linear")
    assert share == 1.0
    assert error == pytest.approx(np.mean(means), rel=1e-4)
    assert li.mae(found, "linear", case="1")[0] == pytest.approx(means[0], rel=1e-4)
    assert error != pytest.approx(found.methods["linear"].errors.mean, rel=1e-2)


def cases_of(evaluation: object) -> tuple:
    return evaluation.plan.cases


@pytest.mark.usefixtures("here")
def test_what_is_not_filled_is_told(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    some = material(recording)
    both = li.Several({"to the end": li.Onward(), "throughout": li.Throughout()})
    one = li.Material(some.samples[:1], [], [])
    found = li.evaluated(one, both, "linear,r1")
    assert np.isnan(li.mae(found, "linear", case="throughout")[0])
    share = 100 / (100 + 15 * 200)
    assert li.mae(found, "linear")[1] == pytest.approx(share)
    assert li.cell(found, "linear").endswith(" (3 %)")
    assert isinstance(li.cell(found, "linear", case="to the end"), float)
    li.refusals(found)
    assert capsys.readouterr().out == ""
    job = next(job for job in found.outcomes if job.method == "r1")
    refused = replace(found.outcomes[job], refused="too short")
    li.refusals(replace(found, outcomes=found.outcomes | {job: refused}))
    assert capsys.readouterr().out == "r1: failed on 1 of 16 cases: too short\n"


def test_a_share_is_never_rounded_up_to_all() -> None:
    assert li.floored(0.9999) == 99
    assert li.floored(1.0) == 100
