"""The scripts of Gløersen and Federolf's tables, on a short synthetic walk."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gappy import person
from scripted import SCRIPTS

import priorfill as pf
from priorfill.clip import Clip
from priorfill.formats import write
from priorfill.gaps import find_gaps
from priorfill.methods.gloersen2016 import Gloersen2016Options

PAPERS = SCRIPTS / "papers"
if str(PAPERS) not in sys.path:
    sys.path.insert(0, str(PAPERS))

gloersen = importlib.import_module("gloersen")
alone = importlib.import_module("method_alone").method_alone
scripts = {
    name: importlib.import_module(f"gloersen_{name}")
    for name in ("table1", "table2", "fig4", "fig6", "walkl")
}


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A walk, and two gap patterns of its size in the same folder."""
    file = tmp_path_factory.mktemp("walk") / "short.c3d"
    clip = person(seconds=6.0, rate=30.0)
    gone = patterns(clip)
    np.savez(file.parent / gloersen.PATTERNS, missing=np.packbits(gone, axis=1), shape=gone.shape)
    write(file, clip)
    return file


def patterns(clip: Clip) -> np.ndarray:
    gone = np.zeros((2, *clip.missing.shape), dtype=bool)
    gone[0, 20:50, 3] = gone[0, 40:60, 8] = True
    gone[1, 100:131, 30] = True
    return gone


def sample_of(file: Path) -> Any:
    return gloersen.Sample(gloersen.WALKL, file, own=False)


# recordings and gaps


def test_patterns_are_read(recording: Path) -> None:
    found = gloersen.patterns(recording)
    np.testing.assert_array_equal(found, patterns(pf.read(recording)))


def test_patterns_of_another_size_are_none_of_the_recording(tmp_path: Path) -> None:
    clip = person(seconds=6.0, rate=30.0)
    gone = patterns(clip)[:, :-9]
    np.savez(tmp_path / gloersen.PATTERNS, missing=np.packbits(gone, axis=1), shape=gone.shape)
    write(tmp_path / "short.c3d", clip)
    assert gloersen.patterns(tmp_path / "short.c3d") == []
    (tmp_path / gloersen.PATTERNS).unlink()
    assert gloersen.patterns(tmp_path / "short.c3d") == []


def test_named_takes_come_before_stand_ins(tmp_path: Path) -> None:
    arguments = Namespace(data=tmp_path, recording=None)
    clip = person(seconds=20.0, rate=100.0)
    motion = gloersen.WALKRUN
    for folder, source in (("any", motion.own), ("", motion.stand_in)):
        stand_in = tmp_path / folder / source.file
        stand_in.parent.mkdir(exist_ok=True)
        write(stand_in, clip)
        if folder:
            own = gloersen.recording(arguments, motion)
            assert (own.own, own.name, own.why) == (True, "WalkRun", "")
            frames = clip.positions[1950:2350]
            np.testing.assert_allclose(own.clip.positions, frames, atol=1e-3)
            stand_in.unlink()
    found = gloersen.recording(arguments, motion)
    assert (found.own, found.name) == (False, "WalkRun*")
    assert found.why == "stand-in: the same actor, from stepping to running on the spot"
    np.testing.assert_allclose(found.clip.positions, clip.positions[885:1285], atol=1e-3)
    with pytest.raises(SystemExit, match="CP-gait"):
        gloersen.recording(arguments, gloersen.CP_GAIT)


def test_a_stand_in_can_have_fewer_markers(tmp_path: Path) -> None:
    source = replace(gloersen.CP_GAIT.stand_in, file="short.c3d", markers="RKNE LKNE")
    motion = replace(gloersen.CP_GAIT, stand_in=source)
    clip = person(seconds=1.0)
    write(tmp_path / "short.c3d", clip)
    found = gloersen.Sample(motion, tmp_path / "short.c3d", own=False).clip
    assert found.labels == ("RKNE", "LKNE")
    at = [clip.labels.index(label) for label in found.labels]
    np.testing.assert_allclose(found.positions, clip.positions[:, at], atol=1e-3)


def test_random_gaps_are_the_papers(recording: Path) -> None:
    sample = sample_of(recording)
    copies = [find_gaps(gloersen.random_gaps(sample, copy)) for copy in range(40)]
    numbers = [len(gaps) for gaps in copies]
    assert (min(numbers), max(numbers)) == (5, 15)
    frames = [gap.frames for gaps in copies for gap in gaps]
    assert (min(frames), max(frames)) == (3, 60)  # 20 and 480 at 240 Hz
    np.testing.assert_array_equal(gloersen.random_gaps(sample, 3), gloersen.random_gaps(sample, 3))


def test_markers_are_known_by_their_labels() -> None:
    walkl = person(seconds=0.1)
    walkl = replace(walkl, labels=tuple(f"M{i:02}" for i in range(1, len(walkl.labels) + 1)))
    assert [gloersen.marker_of(walkl, name) for name in gloersen.MARKERS] == [
        2, 1, 4, 13, 27, 29, 31, 33,
    ]  # fmt: skip
    assert gloersen.marker_of(person(seconds=0.1), "LASIS") == walkl_index("LFWT")
    assert gloersen.marker_of(replace(walkl, labels=tuple(map(str, range(41)))), "LKNE") is None


def walkl_index(label: str) -> int:
    return person(seconds=0.1).labels.index(label)


# errors


@pytest.mark.parametrize("method", ["r1", "r2"])
def test_the_papers_constants_give_what_fill_gives(method: str) -> None:
    clip = person(seconds=6.0, rate=30.0)
    # its axes are turned into upright ones and back
    lying = replace(clip, positions=clip.positions[..., [0, 2, 1]] * [1, 1, -1], up="+Y")
    gone = patterns(clip)[0]
    positions = lying.positions.copy()
    positions[gone] = np.nan
    filled = pf.fill(lying.with_positions(positions), method=method).clip.positions
    wanted = (filled - lying.positions)[gone]
    np.testing.assert_array_equal(gloersen.deviations(lying, gone, method), wanted)
    np.testing.assert_allclose(
        gloersen.deviations(lying, gone, method, Gloersen2016Options()), wanted, atol=1e-9
    )
    other = gloersen.deviations(lying, gone, method, Gloersen2016Options(min_singular_share=0.5))
    assert np.abs(other - wanted).max() > 0.1


def test_what_is_not_wholly_filled_has_no_error() -> None:
    clip = person(seconds=6.0, rate=30.0)
    gone = patterns(clip)[0]
    gone[:, 8] = True  # never seen: no method of this paper can say where it is
    assert gloersen.deviations(clip, gone, "r2") is None
    assert np.isnan(gloersen.mean_distance(clip, gone, "r2"))
    gone[:] = True
    assert gloersen.deviations(clip, gone, "r2") is None


def test_errors_by_axis_are_mean_absolute_differences(recording: Path) -> None:
    module, clip = scripts["table2"], pf.read(recording)
    found = module.errors(module.Case(sample_of(recording), "LKNE", "r2"))
    positions = clip.positions.copy()
    marker = clip.labels.index("LKNE")
    positions[18:, marker] = np.nan
    off = pf.fill(clip.with_positions(positions), method="r2", options=alone()).clip.positions
    off = (off - clip.positions)[18:, marker]
    distance = np.linalg.norm(off, axis=1).mean()
    np.testing.assert_allclose(found, [*np.abs(off).mean(axis=0), distance])


def test_a_gap_has_the_papers_share_of_the_frames(
    recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module, seen = scripts["table1"], []
    monkeypatch.setattr(module, "mean_distance", lambda clip, gone, method: seen.append(gone))
    gap = next(gap for gap in module.GAPS if gap.name == "transition")  # frames 150-249 of 400
    module.errors(module.Case(sample_of(recording), gap, "LKNE"))
    frames = np.flatnonzero(seen[0].any(axis=1))
    assert (frames[0], frames[-1]) == (67, 111)  # of 180
    assert seen[0].any(axis=0).sum() == 1


def test_a_constant_is_best_where_the_median_is_smallest(
    recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    module = scripts["fig6"]
    compared = module.Comparison(unit="")
    curves = np.full((1, 3, 11), 1.0)
    curves[0, :, 1] = [0.2, 0.5, 9.0]  # Theta_D = 0.2; the paper has 1
    constant = next(one for one in module.CONSTANTS if one.name == "Theta_D")
    module._compare_best(compared, constant, [sample_of(recording)], curves)
    compared.print()
    printed = capsys.readouterr().out
    assert "best Theta_D, WalkL: 0.20 (paper 1, -80%): 0.50 mm better than with 1" in printed


def test_errors_are_relative_to_the_mean_of_a_copy() -> None:
    found = scripts["fig6"].relative(np.array([[1.0, 2.0, 6.0], [10.0, 11.0, 12.0]]))
    np.testing.assert_allclose(found, [[-2.0, -1.0, 3.0], [-1.0, 0.0, 1.0]])


def test_the_interval_of_a_median_is_that_of_copies_drawn_again() -> None:
    assert scripts["fig4"].interval(np.full(9, 2.0)) == "2.0-2.0"
    values = np.arange(101.0)
    low, high = map(float, scripts["fig4"].interval(values).split("-"))
    # the median's standard deviation is 0.5 / (density sqrt(n)), here 5
    assert low == pytest.approx(40, abs=3)
    assert high == pytest.approx(60, abs=3)


# scripts


def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let scripts work in this process, with few methods and values."""
    for module in scripts.values():
        monkeypatch.setattr(module, "in_processes", lambda function, cases: [*map(function, cases)])
    for name in ("table1", "table2"):
        monkeypatch.setattr(scripts[name], "OURS", ("r2", "linear"))
    monkeypatch.setattr(scripts["fig4"], "METHODS", ("r1", "r2", "spline"))
    few = tuple(replace(one, values=one.values[9:11]) for one in scripts["fig6"].CONSTANTS)
    monkeypatch.setattr(scripts["fig6"], "CONSTANTS", few)
    monkeypatch.setattr(scripts["walkl"], "FEW", 2)


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        ("table1", ("WalkL*  last 90 %    LKNE", "3 cells are within 10%", ": stand-in: ")),
        ("table2", ("X r2 (paper)", "Federolf 2013", "of 24 cells are within 10%")),
        ("fig4 --copies 2", ("quartiles", "WalkL*  spline       2", "of 3 cells", "of 2\n")),
        ("fig6 --copies 2", ("w_mm", "sigma", "Theta_lambda", "Theta_D", "of 3 cells are")),
        ("walkl", ("2 of file", "evaluate", "complete", "times as fast")),
    ],
)
def test_a_script_prints_its_table_with_values_of_the_paper(
    command: str,
    expected: tuple[str, ...],
    recording: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    here(monkeypatch)
    name, *more = command.split()
    monkeypatch.setattr(sys, "argv", [name, "--recording", str(recording), *more])
    assert scripts[name].main() == 0
    printed = capsys.readouterr().out
    assert "* Stand-in: short.c3d" in printed
    for words in expected:
        assert words in printed
    assert "nan" not in printed
    assert "inf" not in printed


def test_a_script_runs_by_itself() -> None:
    """Also where the output lacks a letter of the author."""
    done = subprocess.run(
        [sys.executable, PAPERS / "gloersen_walkl.py", "--help"],
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
        encoding="ascii",
        check=True,
    )
    assert "Gl\\xf8ersen and Federolf 2016" in done.stdout


def test_a_script_says_which_recording_it_wants(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["table1", "--data", str(tmp_path)])
    with pytest.raises(SystemExit, match=r"walkl/WalkL\.c3d"):
        scripts["table1"].main()


@pytest.mark.realdata
def test_walkl_is_filled_as_the_abstract_says(data: Path) -> None:
    """At most 3 mm for gaps in up to 70 % of the frames."""
    sample = gloersen.recording(Namespace(data=data, recording=None))
    assert sample.own
    assert len(gloersen.patterns(sample.file)) == 50
    masks = [gloersen.random_gaps(sample, copy) for copy in range(3)]
    assert np.median([gloersen.mean_distance(sample.clip, gone, "r2") for gone in masks]) < 3.0
