"""``priorfill report`` and ``priorfill fill --report``."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

import priorfill as pf
from priorfill.cli import main
from priorfill.synthetic import synthesise


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(main, [str(one) for one in arguments])


def data_of(page: Path) -> dict[str, Any]:
    text = page.read_text(encoding="utf-8")
    found = re.search(r'id="priorfill-data">(.*?)</script>', text, re.DOTALL)
    assert found
    return json.loads(found[1])


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a walk, the same with gaps, and a version with one sample changed."""
    walk = synthesise("walking", seconds=1.0, rate=50.0)
    positions = walk.positions.copy()
    positions[20:30, 3] = np.nan
    positions[:5, 7] = np.nan
    monkeypatch.chdir(tmp_path)
    pf.write("truth.c3d", walk)
    pf.write("walk.c3d", walk.with_positions(positions))
    changed = walk.positions.copy()
    changed[40, 10] += 25.0
    pf.write("other.trc", walk.with_positions(changed))
    return tmp_path


def test_fill_writes_a_report(folder: Path) -> None:
    done = run("fill", "walk.c3d", "-m", "pchip", "--report", "dry.html")
    assert done.exit_code in (0, 3), done.output
    assert "page that shows the fill: dry.html" in done.output
    assert not Path("out.c3d").exists()
    done = run("fill", "walk.c3d", "-o", "out.c3d", "-m", "pchip", "--report", "out.html", "--json")
    assert json.loads(done.stdout)["report"] == "out.html"
    data = data_of(Path("out.html"))
    assert data == data_of(Path("dry.html"))
    assert data["clip"]["file"] == data["title"] == "walk.c3d"
    assert [gap["method"] for gap in data["gaps"]] == ["pchip", "pchip"]
    assert str(folder) not in Path("out.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--report", "page.html"), "page.html: exists already; choose another name or use --over"),
        (("--report", "page.png"), "cannot be written with suffix '.png'; use .html or .htm"),
        (("--report", "walk.c3d"), "cannot be written with suffix '.c3d'"),
        (("--report", "e.html", "--uncertainty", "e.html"), "e.html"),
        (("--report", "page.html/x.html"), "is a file, no folder"),
    ],
)
def test_what_cannot_be_written_is_refused_before_the_fill(
    folder: Path, arguments: tuple[str, ...], message: str
) -> None:
    Path("page.html").write_text("mine", encoding="utf-8")
    before = sorted(one.name for one in folder.iterdir())
    done = run("fill", "walk.c3d", "-o", "out.c3d", *arguments)
    assert done.exit_code in (1, 2)
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert sorted(one.name for one in folder.iterdir()) == before


def test_report_of_files(folder: Path) -> None:
    done = run("report", "walk.c3d", "other.trc", "--truth", "truth.c3d", "-o", "page.html")
    assert done.exit_code == 0, done.output
    assert "15 of 16 samples" not in done.stdout
    assert "3 gaps, 16 of 16 samples filled; written to page.html" in done.stdout
    assert "note: 1 of 2035 measured samples differ in the filled file, by 43.3 mm" in done.stderr
    data = data_of(Path("page.html"))
    facts = {table["title"]: table["rows"] for table in data["facts"]}
    assert facts["Files"] == [
        ["Before", "walk.c3d"],
        ["After", "other.trc"],
        ["Truth", "truth.c3d"],
    ]
    assert dict(map(tuple, facts["True errors"]))["Samples"] == "16 in 3 gaps"
    done = run("report", "walk.c3d", "other.trc", "-o", "page.html")
    assert done.exit_code == 1
    assert "page.html: exists already; choose another name or use --overwrite" in done.stderr
    assert run("report", "walk.c3d", "other.trc", "-o", "page.html", "--overwrite").exit_code == 0
    assert "True errors" not in {table["title"] for table in data_of(Path("page.html"))["facts"]}


def test_files_that_are_read_are_not_replaced(folder: Path) -> None:
    Path("walk.c3d").rename("walk.html")
    content = Path("walk.html").read_bytes()
    for arguments in (("walk.html", "other.trc"), ("other.trc", "walk.html")):
        done = run("report", *arguments, "-o", "walk.html", "--overwrite")
        assert done.exit_code == 2
        assert Path("walk.html").read_bytes() == content
    done = run("report", "other.trc", "truth.c3d", "--truth", "walk.html", "-o", "walk.html")
    assert done.exit_code == 2
    assert "is the file that the clip was read from" in done.stderr
    assert Path("walk.html").read_bytes() == content


def test_wrong_usage(folder: Path) -> None:
    assert run("report", "walk.c3d", "-o", "page.html").exit_code == 2
    assert run("report", "walk.c3d", "other.trc").exit_code == 2
    done = run("report", "walk.c3d", "none.c3d", "-o", "page.html")
    assert done.exit_code == 2
    assert "none.c3d: there is no such file; check the name" in done.stderr
    assert not Path("page.html").exists()


def test_what_a_version_has_otherwise_is_noted(folder: Path) -> None:
    """Rate, frame numbers and markers, of every version and of the truth."""
    clip = synthesise("walking", seconds=1.0, rate=50.0)
    pf.write("walk.npz", clip)
    pf.write("slower.npz", replace(clip, rate=clip.rate * 0.9995))
    pf.write("later.npz", replace(clip, first_frame=clip.first_frame + 100))
    columns = [number for number, label in enumerate(clip.labels) if label != "C7"]
    fewer = replace(
        clip,
        positions=clip.positions[:, columns],
        labels=tuple(clip.labels[number] for number in columns),
    )
    pf.write("fewer.npz", fewer)
    done = run("report", "walk.npz", "slower.npz", "later.npz", "-o", "a.html")
    notes = done.stderr.splitlines()
    assert [note.split(": ")[1] for note in notes] == ["slower.npz", "later.npz"]
    assert f"and that of walk.npz is {clip.rate:g} Hz, which is used" in notes[0]
    assert f"numbered from {clip.first_frame + 100}, and those of walk.npz" in notes[1]
    done = run("report", "walk.npz", "slower.npz", "--truth", "fewer.npz", "-o", "b.html")
    assert "note: fewer.npz: marker C7 is in walk.npz only" in done.stderr.splitlines()
    assert run("report", "walk.npz", "walk.npz", "-o", "c.html").stderr == ""
