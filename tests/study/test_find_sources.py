"""Which files of a folder belong to a study, and their names."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from platforms import on_wine

from priorfill.database import PriorDatabase
from priorfill.errors import OptionError
from priorfill.study.find_sources import find_sources
from priorfill.study.study_folder import StudyFolder


def deny(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """Let the system refuse to list folders of a name, as it does for users but not for root."""
    scandir = os.scandir

    def scan(path: str) -> os._ScandirIterator:
        if Path(path).name == name:
            raise PermissionError(13, "Permission denied", str(path))
        return scandir(path)

    monkeypatch.setattr("os.scandir", scan)


def make(*paths: str) -> None:
    for path in paths:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        Path(path).write_bytes(b"x")


def names(*paths: str, output: str = "out") -> list[str]:
    found = find_sources(paths, Path(output).absolute())
    assert found.problems == ()
    return [one.name for one in found.sources]


def test_names_are_paths_below_what_is_common(here: Path) -> None:
    make("in/P01/a.c3d", "in/P01/day2/B.C3D", "in/P02/a.c3d", "in/notes.docx", "in/list.csv")
    every = ["P01/a.c3d", "P01/day2/B.C3D", "P02/a.c3d"]
    assert names("in") == every
    assert names("in/P02", "in/P01") == every
    assert names("in/P01/a.c3d", "in/P01/a.c3d") == ["a.c3d"]
    assert names("in/P01/a.c3d", "in/P02") == ["P01/a.c3d", "P02/a.c3d"]


def test_outputs_databases_and_hidden_files_are_no_sources(here: Path) -> None:
    make("in/a.c3d", "in/._a.c3d", "in/.old/a.c3d", "in/out/b.c3d", "in/other/b.c3d")
    make("in/lab/a.c3d")
    StudyFolder(here / "in/other").mark()
    PriorDatabase.create("in/lab2").close()
    make("in/lab2/a.c3d")
    found = find_sources(["in"], here / "in/out")
    assert [one.name for one in found.sources] == ["a.c3d", "lab/a.c3d"]
    assert [note.partition(": ")[2] for note in found.notes] == [
        "is a prior database; left out",
        "holds the filled files of a study; left out",
    ]
    assert names("in/other") == ["b.c3d"]  # for a second pass


@pytest.mark.skipif(on_wine(), reason="wine shows no symbolic link as one")
def test_links_whose_contents_are_absent_are_sources(here: Path) -> None:
    make("in/a.c3d")
    try:
        Path("in/b.c3d").symlink_to(here / "annex/key")
    except OSError:
        pytest.skip("the system allows no links")
    assert names("in") == ["a.c3d", "b.c3d"]


@pytest.mark.skipif(on_wine(), reason="wine shows no symbolic link as one")
def test_folders_behind_links_are_searched_once(here: Path) -> None:
    make("in/a.c3d", "elsewhere/b.c3d")
    try:
        Path("in/linked").symlink_to(here / "elsewhere", target_is_directory=True)
        Path("in/loop").symlink_to(here / "in", target_is_directory=True)
    except OSError:
        pytest.skip("the system allows no links")
    assert names("in") == ["a.c3d", "linked/b.c3d"]


def test_a_folder_that_cannot_be_entered_costs_itself(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make("in/a/x.c3d", "in/b/x.c3d")

    def refused(place: Path, output: Path) -> str:
        if place.name == "b":
            raise PermissionError(13, "Permission denied", str(place / "priorfill-database.json"))
        return ""

    monkeypatch.setattr("priorfill.study.find_sources._left_out", refused)
    found = find_sources(["in"], Path("out"))
    assert [one.name for one in found.sources] == ["a/x.c3d"]
    assert found.notes == (
        f"{here / 'in' / 'b'}: cannot be searched (Permission denied); left out",
    )


@pytest.mark.skipif(on_wine(), reason="wine shows no symbolic link as one")
def test_what_cannot_be_read_is_a_source_too(here: Path) -> None:
    """Its job reports the reason, and the others are filled."""
    make("in/a.c3d")
    try:
        Path("in/b.c3d").symlink_to(here / "annex/key")
    except OSError:
        pytest.skip("the system allows no links")
    assert names("in/a.c3d", "in/b.c3d") == ["a.c3d", "b.c3d"]
    assert names(f"in/{'x' * 300}.c3d", "in/a.c3d")[0] == "a.c3d"


def test_a_folder_that_cannot_be_searched_is_named(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make("in/closed/x.c3d")
    deny(monkeypatch, "closed")
    assert find_sources(["in/closed"], Path("out")).problems == (
        f"{here / 'in' / 'closed'}: has no recordings (.c3d, .trc, .csv, .tsv, .txt, .npz, .mat)",
        f"{here / 'in' / 'closed'}: cannot be searched (Permission denied); left out",
    )


def test_files_of_matlab_7_3_are_noted(here: Path) -> None:
    """They may be recordings: their variables are not read."""
    make("in/a.c3d", "in/other.mat")
    Path("in/b.mat").write_bytes(b"MATLAB 7.3".ljust(512) + b"\x89HDF\r\n\x1a\n" + b"x" * 100)
    found = find_sources(["in"], Path("out"))
    assert [one.name for one in found.sources] == ["a.c3d"]
    assert found.notes == (
        f"{here / 'in' / 'b.mat'}: is a MATLAB file of version 7.3; left out; if it is a "
        "recording, save it as version 7 (save ... -v7)",
    )


def test_paths_without_recordings_are_named(here: Path) -> None:
    make("in/notes.txt", "more/a.c3d")
    found = find_sources(["in", "nowhere", "more"], here / "out")
    assert [problem.removeprefix(f"{here}{os.sep}") for problem in found.problems] == [
        "in: has no recordings (.c3d, .trc, .csv, .tsv, .txt, .npz, .mat)",
        "nowhere: there is no such file or folder; check the name",
    ]


def test_the_folder_of_sources_cannot_be_that_of_outputs(here: Path) -> None:
    make("in/a.c3d")
    with pytest.raises(OptionError, match="is the folder for the filled files, too"):
        find_sources(["in"], here / "in")


@pytest.mark.skipif(os.name == "nt", reason="names are UTF-16 there")
def test_names_that_are_no_text(here: Path) -> None:
    name = os.fsdecode(b"w\xe4lk.c3d")
    try:
        make(f"in/{name}")
    except OSError:
        pytest.skip("the file system takes UTF-8 only")
    assert names("in") == [name]
