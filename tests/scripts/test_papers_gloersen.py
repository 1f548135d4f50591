"""The scripts of Gløersen and Federolf's tables, on a short synthetic walk."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from gappy import person, with_gaps
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


# gaps


def test_published_patterns_are_read(recording: Path) -> None:
    found = gloersen.published(recording)
    np.testing.assert_array_equal(found, patterns(pf.read(recording)))


def test_patterns_of_another_size_are_none_of_the_recording(tmp_path: Path) -> None:
    clip = person(seconds=6.0, rate=30.0)
    gone = patterns(clip)[:, :-9]
    np.savez(tmp_path / gloersen.PATTERNS, missing=np.packbits(gone, axis=1), shape=gone.shape)
    write(tmp_path / "short.c3d", clip)
    assert gloersen.published(tmp_path / "short.c3d") == []
    (tmp_path / gloersen.PATTERNS).unlink()
    assert gloersen.published(tmp_path / "short.c3d") == []


@pytest.mark.parametrize("share", [0.1, 0.9])
def test_one_run_is_of_one_marker_and_its_share(share: float) -> None:
    clip = person()
    runs = [find_gaps(gloersen.one_run(clip, 5, share, copy)) for copy in range(6)]
    assert all(len(gaps) == 1 and gaps[0].marker == 5 for gaps in runs)
    assert {gaps[0].frames for gaps in runs} == {round(share * clip.frames)}
    starts = {gaps[0].start for gaps in runs}
    assert len(starts) > 1 or share > 0.5  # a long one has no other place


def test_one_run_finds_no_place_in_what_is_not_measured() -> None:
    clip = person()
    some = with_gaps(clip, (clip.frames // 2, clip.frames // 2 + 1, [clip.labels[5]]))
    assert gloersen.one_run(some, 5, 0.9, 0) is None


def test_runs_go_on_until_the_share_of_frames_has_one() -> None:
    clip = person(seconds=12.0)
    low, high = (gloersen.runs_in_frames(clip, share, 3) for share in (0.3, 0.7))
    longest = max(gap.frames for gap in find_gaps(high)) / clip.frames
    for gone, share in ((low, 0.3), (high, 0.7)):
        assert share <= gone.any(axis=1).mean() < share + longest
    assert (high | ~low).all()
    assert (low != gloersen.runs_in_frames(clip, 0.3, 4)).any()


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


def test_errors_by_axis_are_root_mean_squares(
    recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here(monkeypatch)
    module, clip, gone = scripts["table2"], pf.read(recording), patterns(pf.read(recording))
    found, filled = module.by_axis([module.Case(recording, one) for one in gone])
    assert filled == 2
    positions = clip.positions.copy()
    positions[gone[0]] = np.nan
    off = pf.fill(clip.with_positions(positions), method="r2").clip.positions - clip.positions
    for axis in range(3):
        wanted = np.sqrt(np.mean(off[20:50, 3, axis] ** 2))
        assert found[3, axis] == pytest.approx(wanted)
    never = ~gone.any(axis=(0, 1))
    assert np.isnan(found[never]).all()
    assert np.isfinite(found[~never]).all()


# scripts


def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let scripts work in this process, and make few gaps."""
    for module in scripts.values():
        monkeypatch.setattr(module, "in_processes", lambda function, cases: [*map(function, cases)])
    monkeypatch.setattr(scripts["table1"], "FEW", 1)
    monkeypatch.setattr(scripts["table1"], "SHARES", (0.1, 0.9))
    monkeypatch.setattr(scripts["table2"], "FEW", 1)
    monkeypatch.setattr(scripts["fig4"], "FEW", 2)
    monkeypatch.setattr(scripts["fig4"], "SLOW", {"lds": 0})
    monkeypatch.setattr(scripts["fig4"], "SHARES", (0.1, 0.5))
    monkeypatch.setattr(scripts["fig6"], "FEW", 1)
    monkeypatch.setattr(scripts["walkl"], "FEW", 2)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        (
            "table1",
            ("missing  median  central 90 %  paper", "2-5", "markers are within 5 mm at 90%"),
        ),
        ("table2", ("2 of 2 published patterns", "alone", "paper", "1-4")),
        ("fig4", ("median", "paper", "r1", "spline", "116.0", "3 mm at most")),
        ("fig6", ("sigma", "w_mm", "cut-off", "MinCumSV", "chosen", "paper")),
        ("walkl", ("2 patterns published", "evaluate", "paper", "complete", "times as fast")),
    ],
)
def test_a_script_prints_its_table_with_values_of_the_paper(
    name: str,
    expected: tuple[str, ...],
    recording: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    here(monkeypatch)
    monkeypatch.setattr(sys, "argv", [name, "--recording", str(recording)])
    monkeypatch.setattr(scripts["table2"], "EVERY", 1)
    assert scripts[name].main() == 0
    printed = capsys.readouterr().out
    assert "Not the recording of the paper" in printed
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
    clip = gloersen.read(data / "walkl" / "WalkL.c3d")
    assert len(gloersen.published(data / "walkl" / "WalkL.c3d")) == 50
    masks = [gloersen.runs_in_frames(clip, 0.7, copy) for copy in range(3)]
    assert np.median([gloersen.mean_distance(clip, gone, "r2") for gone in masks]) < 3.0
