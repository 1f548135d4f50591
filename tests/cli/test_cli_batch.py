"""``priorfill batch`` as a user runs it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from gappy import person, with_gaps

from priorfill.cli import main
from priorfill.formats import read, write


def batch(*arguments: str) -> Result:
    return CliRunner().invoke(main, ["batch", *arguments])


@pytest.fixture
def study(here: Path) -> Path:
    """A folder with a recording with a gap, and a file that is none."""
    clip = with_gaps(person(seconds=1.0, rate=30.0), (10, 20, ["LKNE"]))
    write("study/P01/walk.c3d", clip)
    Path("study/P02").mkdir()
    Path("study/P02/bad.c3d").write_bytes(b"garbage")
    return here


@pytest.mark.windows
def test_a_study_is_filled_and_continued(study: Path) -> None:
    done = batch("study", "-o", "out", "-m", "linear", "-w", "1", "--report", "--uncertainty")
    assert done.exit_code == 3, done.output
    first, total, summary = done.stdout.splitlines()
    assert first.startswith(f"failed: {Path('P02/bad.c3d')}: is not a C3D file")
    assert total == f"2 files: 1 filled, 1 failed; in {study / 'out'}"
    assert summary == f"summary: {study / 'out' / 'summary.html'}"
    assert not read("out/P01/walk.c3d").missing.any()
    names = {path.name for path in Path("out/P01").iterdir()}
    assert names == {"walk.c3d", "walk.c3d.html", "walk.c3d.uncertainty.npz"}
    again = batch("study", "-o", "out", "-m", "linear", "--report", "--uncertainty", "--json")
    assert again.exit_code == 3
    outcomes = json.loads(again.stdout)
    assert [(one["name"], one["status"]) for one in outcomes] == [
        ("P01/walk.c3d", "filled"),
        ("P02/bad.c3d", "failed"),
    ]
    assert sorted(Path("out").rglob(".priorfill-*")) == []
    with Path("out/P01/walk.c3d").open("ab") as file:
        file.write(b"by hand")
    edited = batch("study", "-o", "out", "-m", "linear", "--report", "--uncertainty").stdout
    assert "changed: P01/walk.c3d: walk.c3d was changed after the fill" in edited
    Path("out/summary.csv").unlink()
    assert batch("-o", "out").exit_code == 3
    assert Path("out/summary.csv").exists()


def test_a_check_tells_what_is_to_be_done(study: Path) -> None:
    done = batch("study", "-o", "out", "--check")
    assert done.stdout == f"2 files: 2 to be filled; in {study / 'out'}\n"
    assert done.exit_code == 0
    assert not Path("out").exists()


def test_all_problems_are_printed(study: Path) -> None:
    done = batch("study", "nowhere", "study", "-o", "study/P02/bad.c3d", "-d", "lab")
    assert done.exit_code == 2
    lines = done.stderr.splitlines()
    assert len(lines) == 3
    assert all(line.startswith("priorfill: ") for line in lines)
    done = batch("nowhere", "-o", "out")
    assert done.exit_code == 2
    assert "there is no such file or folder" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("study",), "Missing option '--output'"),
        (("study", "-o", "out", "-m", "grp"), "there is no method 'grp'"),
        (("study", "-o", "out", "--index", "2"), "--index and --of belong together"),
        (("study", "-o", "out", "--index", "3", "--of", "2"), "must be from 1 to --of, 2"),
        (("study", "-o", "out", "--time-limit", "0"), "--time-limit"),
        (("study", "-o", "study"), "give another one (--output)"),
        (("study", "-o", "out", "--only-subject", "a"), "--only-subject needs a database"),
        (("study", "-o", "out", "--summary", "out.txt"), "use .html"),
    ],
)
def test_wrong_usage_of_batch(study: Path, arguments: tuple[str, ...], message: str) -> None:
    done = batch(*arguments)
    assert done.exit_code == 2, done.output
    assert message in done.stderr
    assert not Path("out").exists()


def test_a_folder_without_a_study(study: Path) -> None:
    done = batch("-o", "out")
    assert done.exit_code == 2
    assert "holds no filled files of a study" in done.stderr
