"""Output that a code page cannot take is replaced, by every command, on stdout and stderr."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from db_cli import LABELS, small_clip

from priorfill.cli import encoding, main
from priorfill.cli import progress as progress_module
from priorfill.cli.encoding import encodable, replace_what_is_lacking
from priorfill.cli.output import print_table
from priorfill.cli.progress import progress
from priorfill.clip import Clip
from priorfill.formats import write

STRANGE = "Łó 歩 é\N{GREEK SMALL LETTER SIGMA}\N{LESS-THAN OR EQUAL TO}2"
"""No code page but UTF-8 has all of these."""


class _Stream(io.TextIOWrapper):
    """A strict stream with an encoding, as a pipe is, or a terminal."""

    def __init__(self, name: str, *, terminal: bool = False) -> None:
        super().__init__(io.BytesIO(), encoding=name, newline="\n", write_through=True)
        self._terminal = terminal

    def isatty(self) -> bool:
        return self._terminal

    def text(self) -> str:
        raw = self.buffer
        assert isinstance(raw, io.BytesIO)
        return raw.getvalue().decode(self.encoding)


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("ascii", r"\u0141\xf3 \u6b69 \xe9sigma<=2"),
        ("cp1252", r"\u0141ó \u6b69 ésigma<=2"),
        ("cp1250", r"Łó \u6b69 ésigma<=2"),
        ("cp932", r"\u0141\xf3 歩 \xe9" + "\N{GREEK SMALL LETTER SIGMA}<=2"),
        ("utf-8", STRANGE),
    ],
)
def test_replacements(name: str, shown: str) -> None:
    assert encodable(STRANGE, _Stream(name)) == shown


def test_every_sign_is_replaced_by_ascii() -> None:
    for sign, ascii_text in encoding._REPLACEMENTS.items():
        assert encodable(sign, _Stream("ascii")) == ascii_text
        assert ascii_text.isascii()
    assert encodable("\udcff", _Stream("utf-8")) == r"\udcff"


def test_whatever_writes_to_the_streams(monkeypatch: pytest.MonkeyPatch) -> None:
    """As click and rich do."""
    for name in ("stdout", "stderr"):
        monkeypatch.setattr(sys, name, _Stream("cp1252"))
    replace_what_is_lacking()
    for stream in (sys.stdout, sys.stderr):
        stream.write("\N{LESS-THAN OR EQUAL TO}歩é")
        assert stream.text() == r"<=\u6b69é"  # type: ignore[attr-defined]


def strange_clip(name: str = "clip", *, gaps: bool = True, seed: int = 0) -> Clip:
    clip = small_clip(name, seed=seed, subject=STRANGE)
    positions = clip.positions.copy()
    if gaps:
        positions[40:50, 3] = float("nan")
    labels = (*LABELS[:3], STRANGE)
    return Clip(positions, labels, clip.rate, name=name, subject=STRANGE)


@pytest.fixture
def walk(here: Path) -> Path:
    path = here / f"{STRANGE.replace('<', '')}.npz"
    write(path, strange_clip())
    return path


def run(code_page: str, *arguments: str | Path) -> Result:
    done = CliRunner(charset=code_page).invoke(main, [str(argument) for argument in arguments])
    assert isinstance(done.exception, SystemExit | None), done.exception
    assert "bug in priorfill" not in done.stderr
    return done


@pytest.mark.parametrize("code_page", ["ascii", "cp1252", "cp932"])
def test_commands(walk: Path, code_page: str) -> None:
    def shown(text: str) -> str:
        return encodable(text, _Stream(code_page))

    done = run(code_page, "inspect", walk)
    assert done.exit_code == 0
    assert shown(STRANGE) in done.stdout
    assert json.loads(run(code_page, "inspect", walk, "--json").stdout)["labels"][3] == STRANGE
    done = run(code_page, "fill", walk, "-o", f"{walk.stem}.csv.npz", "-m", "linear")
    assert done.exit_code in (0, 3)
    assert shown(STRANGE) in done.stdout
    facts = run(code_page, "fill", walk, "-o", "o.npz", "-m", "linear", "--json").stdout
    assert facts.isascii()
    assert json.loads(facts)["file"] == str(walk)
    done = run(code_page, "fill", walk, "-o", "p.npz", "--markers", "歩")
    assert (done.exit_code, shown("歩") in done.stderr) == (2, True)
    assert shown("歩") in run(code_page, "fill", "歩.c3d", "-o", "q.npz").stderr
    assert shown("歩") in run(code_page, "歩").stderr
    assert run(code_page, "methods").exit_code == 0
    whole = Path("whole.npz")
    write(whole, strange_clip(gaps=False))
    line = ("evaluate", whole, "-m", "linear", "-p", "markers", "--length", "0.1", "--jobs", "0")
    done = run(code_page, *line)
    assert done.exit_code == 0
    assert shown("m/s²") in done.stdout
    assert run(code_page, *line, "--json").stdout.isascii()
    assert run(code_page, "db", "add", "-d", STRANGE[:4], walk, "--verbose").exit_code == 0
    done = run(code_page, "db", "list", "-d", STRANGE[:4])
    assert shown("Łó") in done.stdout
    assert run(code_page, "db", "list", "-d", STRANGE[:4], "--json").stdout.isascii()


def test_columns_are_aligned_after_replacement(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = _Stream("cp1252")
    monkeypatch.setattr(sys, "stdout", stream)
    print_table(("a", "b>"), [("\N{LESS-THAN OR EQUAL TO}歩", "1"), ("x", "22")])
    assert stream.text().splitlines() == ["a          b", r"<=\u6b69   1", "x         22"]


@pytest.mark.parametrize("code_page", ["cp1252", "utf-8"])
def test_a_progress_bar_on_a_terminal(monkeypatch: pytest.MonkeyPatch, code_page: str) -> None:
    stream = _Stream(code_page, terminal=True)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(progress_module, "WINDOWS", False)
    monkeypatch.setattr(sys, "stderr", stream)
    with progress(2, f"filling {STRANGE}") as show:
        show(1, None)
    assert encodable(STRANGE, stream) in stream.text()


@pytest.mark.parametrize(("windows", "shown"), [(True, False), (False, True)])
def test_no_progress_bar_on_a_console_of_windows_without_stdout(
    monkeypatch: pytest.MonkeyPatch, windows: bool, shown: bool
) -> None:
    monkeypatch.setattr(progress_module, "WINDOWS", windows)
    monkeypatch.setattr(sys, "stdout", _Stream("cp1252"))
    monkeypatch.setattr(sys, "stderr", _Stream("cp1252", terminal=True))
    with progress(2, "filling") as show:
        show(1, None)
    assert bool(sys.stderr.text()) is shown  # type: ignore[attr-defined]


@pytest.mark.windows
def test_through_pipes(walk: Path) -> None:
    """With the code page of Windows, or ASCII in the C locale."""
    done = subprocess.run(
        [sys.executable, "-c", "from priorfill.cli import main; main()", "inspect", walk],
        capture_output=True,
        env=os.environ | {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    assert rb"\u0141" in done.stdout
    assert b"sigma<=2" in done.stdout
