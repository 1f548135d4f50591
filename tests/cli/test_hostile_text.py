"""Whatever files, databases and definitions say, no terminal or spreadsheet obeys it."""

from __future__ import annotations

import csv
import json
import re
import sys
import unicodedata
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from db_cli import run
from gappy import person

import priorfill as pf
from priorfill.clip import Clip
from priorfill.report.figures import plain
from priorfill.runtime.resources import resource_path

NASTY = (
    "\x1b[31mred\x1b[0m",
    "\x1b]0;title\x07",
    "c1\x9b2J",
    "left\u202eright\u2066",
    "zero\u200bwidth\ufeff",
    "line\nbreak\r\t",
    "separator\u2028\u2029\x85x",
    "[bold red]markup[/]",
    "[link=x]link[/link]",
    "=1+1",
    "@SUM(A1)",
    "+1",
    "-2",
    "$\\frac{1}{0}$",
    "\U000e0041tag",
)
"""Labels: terminal escapes, direction, markup of rich, formulas of spreadsheets and of TeX."""

HIDDEN = {"Cc", "Cf", "Cs", "Zl", "Zp"}
"""Unicode categories that no output may contain, apart from line breaks."""

CLIP_NAME = "walk\x1b[31m\u202e\x9b" if sys.platform != "win32" else "walk\u202e"


def check(result: Result, status: int | tuple[int, ...] = 0) -> Result:
    """A result with an expected exit status, in whose output nothing hidden is."""
    assert result.exit_code in (status if isinstance(status, tuple) else (status,)), result.output
    assert "bug in priorfill" not in result.output
    clean(result.stdout)
    clean(result.stderr)
    return result


def clean(text: str) -> None:
    found = {c for c in text if unicodedata.category(c) in HIDDEN} - {"\n"}
    assert not found, text


def clean_table(path: Path) -> None:
    """A CSV file without hidden characters whose cells of text are no formulas."""
    clean(path.read_text("utf-8").replace("\r\n", "\n"))
    with path.open(newline="", encoding="utf-8") as file:
        cells = [cell for row in csv.reader(file) for cell in row]
    assert not [c for c in cells if c.startswith(("=", "@", "+", "\t", "\r"))]
    assert not [c for c in cells if c.startswith("-") and not re.fullmatch(r"-[\d.e+-]+", c)]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def hostile_clip(subject: str = "Ann\x1b[5m\u202e", seed: int = 3) -> Clip:
    whole = person("walking", 1.5, 60.0, seed)
    labels = (*NASTY, *whole.labels[len(NASTY) :])
    return Clip(whole.positions, labels, whole.rate, whole.up, "walk", subject)


@pytest.fixture
def gappy(folder: Path) -> Path:
    """A file with gaps in the markers of odd names."""
    clip = hostile_clip()
    positions = clip.positions.copy()
    for marker in range(len(NASTY)):
        positions[20 + marker : 30 + marker, marker] = np.nan
    positions[60, 20] += 900.0  # an artefact
    path = folder / f"{CLIP_NAME}.npz"
    pf.write(path, clip.with_positions(positions))
    return path


def test_inspect_and_fill(gappy, folder):
    check(run("inspect", gappy))
    facts = json.loads(check(run("inspect", gappy, "--json")).stdout)
    assert NASTY[0] in [gap["marker"] for gap in facts["gaps"]]
    table = check(
        run("fill", gappy, "-o", "o.npz", "-m", "linear", "--uncertainty", "u.csv"), (0, 3)
    )
    assert r"\x1b[31mred\x1b[0m" in table.stdout
    assert "[bold red]markup[/]" in table.stdout
    assert "[link=x]link[/link]" in table.stdout
    clean_table(Path("u.csv"))
    assert "'=1+1" in Path("u.csv").read_text("utf-8")
    more = ("--overwrite", "--reject-artefacts", "--json", "-m", "pchip")
    check(run("fill", gappy, "-o", "o.npz", *more), (0, 3))
    assert pf.read("o.npz").labels == pf.read(gappy).labels  # the data stay as they are


def test_messages(gappy, folder):
    """Errors quote names of files and markers, arguments and what a file says."""
    check(run("inspect", f"no{CLIP_NAME}.npz"), 2)
    check(run("fill", gappy, "-o", f"{CLIP_NAME}/x/o.npz", "-m", "linear"), (0, 3))
    check(run("fill", gappy, "-o", f"o.{CLIP_NAME}"), (1, 2))
    check(run("fill", gappy, "-o", "o.npz", "--markers", "\x1b[31m"), (1, 2))
    check(run("fill", gappy, "-o", "o.npz", "--method", "\u202e"), (1, 2))
    check(run("fill", gappy, "-o", "o.npz", "--set", "\x1b=\x9b"), (1, 2))
    check(run("fill", gappy, "-o", "o.npz", "--subject", "\x1b"), (1, 2))
    check(run(f"--\x1b{CLIP_NAME}"), 2)
    check(run(CLIP_NAME), 2)
    check(run("methods", "\x1b[31m"), (1, 2))
    arrays = dict(np.load(gappy))
    for key, value in (("up", "\x1b\u202e"), ("unit", "\x9b"), ("rate", "\x1b"), ("\x1b", 1.0)):
        np.savez("bad.npz", **arrays | {key: np.array(value)})
        check(run("inspect", "bad.npz"), (0, 1))


def test_definitions(gappy, folder):
    text = resource_path("markersets", "plug-in-gait.toml").read_text("utf-8")
    odd = json.dumps(NASTY[0])
    for number, (old, new) in enumerate(
        [("[markers]", f"[markers]\n{odd} = 1"), ("title =", f"{odd} = 1\ntitle ="), ("", "a = ")]
    ):
        path = folder / f"{number}{CLIP_NAME}.toml"
        path.write_text(text.replace(old, new, 1) if old else new, "utf-8")
        check(run("inspect", gappy, "--marker-set", path), (1, 2))
    path = folder / f"d{CLIP_NAME}.toml"
    for entry in ('"LKNE"\nframes = "\\u001b"', '"LKNE"\ndo = "\\u202e"', f'{odd}\ndo = "leave"'):
        path.write_text(f"[[gap]]\nmarker = {entry}\n", "utf-8")
        options = ("-m", "linear", "--overrides", path, "--overwrite")
        check(run("fill", gappy, "-o", "o.npz", *options), (0, 1, 2, 3))
    path.write_text('name = "a\\u001b"\ntitle = "\\u202e"\n', "utf-8")
    check(run("db", "fetch", path, "--to", "x", "--download-only", "--yes"), (1, 2))


def test_databases(folder, gappy):
    whole = folder / f"whole{CLIP_NAME}.npz"
    pf.write(whole, hostile_clip(seed=4))
    check(run("db", "add", "-d", "db", whole, folder / f"none{CLIP_NAME}.npz"), 2)
    check(run("db", "add", "-d", "db", whole, gappy), (0, 1))
    for command in ("list", "info"):
        check(run("db", command, "-d", "db"))
        check(run("db", command, "-d", "db", "--json"))
    check(run("db", "verify", "-d", "db"))
    check(run("db", "compact", "-d", "db"))
    check(run("db", "list", "-d", "db", "--subject", "\x1b*"), (0, 1))
    check(
        run("fill", gappy, "-o", "o.npz", "-d", "db", "--frames", "20:32", "-m", "linear"), (0, 3)
    )
    check(run("db", "export", "-d", "db", "-o", f"out{CLIP_NAME}", "--format", "npz"), (0, 1))
    check(run("db", "merge", "-d", "other", "db"), (0, 1))
    check(run("db", "remove", "-d", "other", "--subject", "*"), (0, 1))
    check(run("db", "accept", "-d", "db", "o.npz"), (0, 1, 2))
    manifest = folder / "db" / "priorfill-database.json"
    manifest.write_text('{"format": "\\u001b"}', "utf-8")
    check(run("db", "info", "-d", "db"), 1)
    check(run("db", "info", "-d", f"db{CLIP_NAME}"), 2)


def test_evaluation(folder, gappy):
    options = ("-m", "linear", "--copies", "1", "-p", "random", "-j", "1")
    check(run("evaluate", gappy, *options, "-o", f"e{CLIP_NAME}"), (0, 3))
    output = folder / f"e{CLIP_NAME}"
    tables = list(output.glob("*.csv"))
    assert tables
    for table in tables:
        clean_table(table)
    for text in output.glob("*.json"):
        clean(text.read_text("utf-8"))


def test_names_in_plots():
    pytest.importorskip("matplotlib")
    from matplotlib.figure import Figure

    figure = Figure()
    figure.suptitle(plain("$\\frac{1}{$ \x1b"))
    figure.canvas.draw()  # a formula would raise an error
    assert plain("a$b\n") == r"a\$b\n"


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are Unicode elsewhere")
def test_names_of_files_that_are_not_utf_8(folder, gappy):
    path = folder / "\udcff\udc80.npz"
    plain = person("walking", 1.5, 60.0, 4)
    positions = plain.positions.copy()
    positions[20:30, 3] = np.nan
    pf.write(path, plain.with_positions(positions))
    for suffix in ("c3d", "trc", "mat"):
        output = folder / f"o\udcff.{suffix}"
        check(run("fill", path, "-o", output, "-m", "linear"))
        check(run("fill", output, "-o", folder / f"p\udcff.{suffix}"))
    again = ("-o", folder / "q\udcff.c3d", "--rewrite", "--reject-artefacts")
    check(run("fill", folder / "o\udcff.c3d", *again))
    check(run("inspect", path))
    check(run("inspect", path, "--json"))
    check(run("fill", path, "-o", folder / "o\udcff.npz", "-m", "linear"), (0, 3))
    check(run("db", "add", "-d", "db\udcff", path), (0, 1))
    check(run("db", "list", "-d", "db\udcff"), (0, 1))
    options = ("-m", "linear", "--copies", "1", "-j", "1", "-o", "e\udcff")
    check(run("evaluate", path, *options), (0, 3))


def test_labels_of_any_length_do_not_flood_the_terminal(folder):
    clip = hostile_clip(seed=6)
    positions = clip.positions.copy()
    positions[20:30, 0] = np.nan
    pf.write("a.npz", Clip(positions, ("L" * 100_000, *clip.labels[1:]), clip.rate, clip.up))
    assert len(check(run("inspect", "a.npz")).stdout) < 20_000
    assert len(check(run("fill", "a.npz", "-o", "o.npz", "-m", "linear")).output) < 20_000
