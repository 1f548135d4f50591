"""Wildcards, the user's folder and quotation marks in paths; patterns stay as they are."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import click
import pytest
from db_cli import run, small_clip

from priorfill.cli import main, path_types
from priorfill.cli.path_types import expand_wildcards
from priorfill.formats import write


@pytest.fixture
def takes(here: Path) -> Path:
    for name in ("b.c3d", "a.c3d", "[1].c3d", "~x.c3d", "L.txt", ".hidden.c3d"):
        (here / name).touch()
    (here / "in" / "side").mkdir(parents=True)
    (here / "in" / "side" / "c.c3d").touch()
    return here


@pytest.fixture
def windows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(path_types, "WINDOWS", True)


@pytest.mark.usefixtures("takes")
@pytest.mark.parametrize(
    ("text", "paths"),
    [
        ("?.c3d", ["a.c3d", "b.c3d"]),
        ("*.c3d", ["[1].c3d", "a.c3d", "b.c3d", "~x.c3d"]),
        ("[1].c3d", ["[1].c3d"]),
        ("[1]*", ["[1].c3d"]),
        ("[ab].c3d", ["[ab].c3d"]),
        ("**/c.c3d", [str(Path("in", "side", "c.c3d"))]),
        ("no*.c3d", ["no*.c3d"]),
        ("a.c3d", ["a.c3d"]),
        ("~x.c3d", ["~x.c3d"]),
        ("-", ["-"]),
        ("", [""]),
    ],
)
def test_wildcards(text: str, paths: list[str]) -> None:
    assert expand_wildcards([text]) == paths


def test_the_folder_of_the_user(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in ("HOME", "USERPROFILE"):
        monkeypatch.setenv(name, str(tmp_path))
    (tmp_path / "walk.c3d").touch()
    assert [Path(path) for path in expand_wildcards(["~/*.c3d", "~/w.c3d"])] == [
        tmp_path / "walk.c3d",
        tmp_path / "w.c3d",
    ]


@pytest.mark.usefixtures("windows")
def test_one_file_is_one_file(here: Path) -> None:
    for name in ("one.npz", "two.npz"):
        write(here / name, small_clip())
    assert run("inspect", "one*.npz").exit_code == 0
    done = run("inspect", "*.npz")
    assert done.exit_code == 2
    assert "*.npz matches 2 files; name one" in done.stderr
    done = run("inspect", "none*.npz")
    assert done.exit_code == 2
    assert done.stderr.startswith("priorfill: none*.npz: ")


@pytest.mark.usefixtures("windows")
def test_a_backslash_before_a_quotation_mark(here: Path) -> None:
    done = run("inspect", 'takes" -d x')
    assert done.exit_code == 2
    assert "leave the last backslash out" in done.stderr


@pytest.mark.usefixtures("windows")
@pytest.mark.parametrize("path", ["out/C:x.c3d", ".\\C:x.c3d", "Z:\\out\\c:\\x.c3d"])
def test_a_drive_behind_a_folder_is_refused(here: Path, path: str) -> None:
    """pathlib of Python 3.11 drops the folder, so the file would be written elsewhere."""
    write(here / "a.npz", small_clip("a"))
    for arguments in (["fill", "a.npz", "-o", path], ["db", "add", "-d", path, "a.npz"]):
        done = run(*arguments)
        assert done.exit_code == 2
        assert "has a drive behind a folder" in done.stderr
    assert [file.name for file in here.iterdir()] == ["a.npz"]


@pytest.mark.parametrize(
    "path", ["C:x.c3d", "z:\\a\\x.c3d", "\\\\?\\Z:\\a\\x.c3d", "\\\\server\\share\\x.c3d", "ab:x"]
)
def test_paths_with_one_drive_are_taken(windows: None, path: str) -> None:
    assert str(path_types.FILE.convert(path, None, None)) == str(Path(path))


@pytest.mark.windows
def test_through_the_program(here: Path) -> None:
    """Files are expanded by the shell or the program, patterns by neither."""
    (here / "takes").mkdir()
    for name in ("a.npz", "B [1].npz"):
        write(here / "takes" / name, small_clip(name, seed=len(name)))
    for name in ("Abel", "cat"):  # what `A*` and `c*` would become
        (here / name).touch()

    def program(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-c", "from priorfill.cli import main; main()", *arguments]
        return subprocess.run(command, capture_output=True, text=True, timeout=300)

    files = ["takes/*.npz"] if os.name == "nt" else ["takes/a.npz", "takes/B [1].npz"]
    done = program("db", "add", "-d", "priors", "--subject", "Anna", *files)
    assert done.returncode == 0, done.stderr
    assert "added 2 clips" in done.stdout
    done = program("db", "remove", "-d", "priors", "--subject", "A*", "c*")
    assert done.returncode == 2, done.stderr
    assert "no clip of subject A* is called c*" in done.stderr


def test_click_expands_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[object] = []
    monkeypatch.setattr(
        click.Group, "main", lambda *_, windows_expand_args: asked.append(windows_expand_args)
    )
    main()
    assert asked == [False]
