"""Catalogue and segments that do not belong together: nothing is written, nothing is removed."""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from platforms import WINDOWS

from priorfill.clip import Clip
from priorfill.database import ClipOrigin, PriorDatabase
from priorfill.database.segment_list import SegmentList
from priorfill.errors import DatabaseCorruptError, DatabaseError

CATALOGUE, SEGMENT = "catalogue.sqlite", "segments/000001.f32"
MAKERS = [getattr(os, name) for name in ("mkfifo", "mkdir") if hasattr(os, name)]


def small_clip(seed: int) -> Clip:
    rng = np.random.default_rng(seed)
    t = np.arange(130)[:, None, None] / 120
    swing = 200 * np.sin(2 * np.pi * rng.uniform(0.5, 2, (1, 4, 3)) * t)
    labels = ("LASI", "RASI", "SACR", "C7")
    return Clip(rng.uniform(-500, 500, (1, 4, 3)) + swing, labels, 120.0, name=f"clip{seed}")


def add(folder: Path, *seeds: int) -> None:
    with PriorDatabase.open_or_create(folder) as database:
        for seed in seeds:
            database.add(small_clip(seed))


def files(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != "lock"
    }


def copy(source: Path, target: Path, name: str) -> None:
    shutil.copyfile(source / name, target / name)


@pytest.fixture(scope="module")
def made(in_memory: Path) -> Path:
    """`a` with three clips, `older` its copy of two, `twin` with another third, and `other`."""
    root = in_memory / "made"
    root.mkdir()
    add(root / "a", 1, 2)
    shutil.copytree(root / "a", root / "older")
    shutil.copytree(root / "a", root / "twin")
    add(root / "a", 3)
    add(root / "twin", 4)
    add(root / "other", 5, 6, 7)
    PriorDatabase.create(root / "new").close()
    return root


@pytest.fixture
def root(made: Path, in_memory: Path) -> Iterator[Path]:
    folder = in_memory / "root"
    shutil.copytree(made, folder)
    yield folder
    shutil.rmtree(folder)


def empty(root: Path) -> None:
    (root / "a" / CATALOGUE).write_bytes(b"")


def exchange(*names: str, by: str) -> Callable[[Path], None]:
    def act(root: Path) -> None:
        for name in names:
            copy(root / by, root / "a", name)

    return act


def remove(name: str) -> Callable[[Path], None]:
    return lambda root: (root / "a" / name).unlink()


def lengthen(root: Path) -> None:
    with (root / "a" / SEGMENT).open("ab") as file:
        file.write(bytes(400))


def older_without_checksum(root: Path) -> None:
    copy(root / "older", root / "a", CATALOGUE)
    (root / "a" / "catalogue.checksum").unlink()


DAMAGE = {
    "empty catalogue": (empty, "is empty, so nothing is known of the segments; restore"),
    "no catalogue": (remove(CATALOGUE), "is missing, so nothing is known of the segments"),
    "foreign catalogue": (exchange(CATALOGUE, by="other"), "belongs to another database"),
    "new catalogue": (
        exchange(CATALOGUE, "catalogue.checksum", by="new"),
        "belongs to another database",
    ),
    "older catalogue": (exchange(CATALOGUE, by="older"), "is older than catalogue.checksum"),
    "older catalogue and checksum": (
        exchange(CATALOGUE, "catalogue.checksum", by="older"),
        "the catalogue is older than the segment",
    ),
    "older catalogue alone": (older_without_checksum, "the catalogue is older than the segment"),
    "catalogue of a twin": (
        exchange(CATALOGUE, "catalogue.checksum", by="twin"),
        "does not belong to this catalogue",
    ),
    "foreign segment": (exchange(SEGMENT, by="other"), "is not the segment of this database"),
    "segment of a twin": (exchange(SEGMENT, by="twin"), "does not belong to this catalogue"),
    "older segment": (exchange(SEGMENT, by="older"), "but the catalogue counts"),
    "no segment": (remove(SEGMENT), "is missing"),
    "longer segment": (lengthen, "the catalogue is older than the segment"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damage_is_noticed_before_anything_is_written(root: Path, name: str) -> None:
    act, message = DAMAGE[name]
    act(root)
    folder = root / "a"
    before = files(folder)
    with pytest.raises(DatabaseCorruptError, match=message) as caught:
        PriorDatabase.open(folder, write=True)
    assert "\n" not in str(caught.value)
    assert files(folder) == before
    try:
        with PriorDatabase.open(folder) as reader:
            assert reader.verify()
    except DatabaseCorruptError:
        pass
    assert files(folder) == before


@pytest.mark.windows
def test_files_that_are_not_ours_stay(root: Path) -> None:
    folder = root / "a"
    names = ["catalogue.sqlite.bak", "catalogue-old.sqlite", "notes.txt", "segments/notes.txt"]
    names += ["segments/000009.f32", "segments/7.f32"]
    for name in names:
        shutil.copyfile(root / "other" / SEGMENT, folder / name)
    before = {name: files(folder)[name] for name in names}
    with PriorDatabase.open(folder, write=True) as database:
        database.remove(database.clips()[:1])
        assert database.compact() > 0
        database.add(small_clip(8))
        assert database.verify() == []
        assert {record.segment for record in database.clips()} == {10}
    after = files(folder)
    assert {name: after[name] for name in names} == before


def test_a_segment_of_this_database_that_the_catalogue_does_not_list(root: Path) -> None:
    """The catalogue was restored from before a compaction."""
    folder = root / "a"
    kept = {name: (folder / name).read_bytes() for name in (CATALOGUE, SEGMENT)}
    with PriorDatabase.open(folder, write=True) as database:
        database.remove(database.clips()[:1])
        database.compact()
    (folder / "catalogue-2.sqlite").unlink()
    for name, data in kept.items():
        (folder / name).write_bytes(data)
    before = files(folder)
    with pytest.raises(DatabaseCorruptError, match=r"000002.f32: .* does not list"):
        PriorDatabase.open(folder, write=True)
    assert files(folder) == before


# --- under an open writer ---


def renamed(root: Path) -> None:
    (root / "a").rename(root / "moved")


def folder_replaced(root: Path) -> None:
    renamed(root)
    (root / "twin").rename(root / "a")


def file_replaced(root: Path) -> None:
    (root / "twin" / CATALOGUE).replace(root / "a" / CATALOGUE)


@pytest.mark.parametrize(
    "act",
    [
        renamed,
        folder_replaced,
        file_replaced,
        empty,
        remove(CATALOGUE),
        remove(SEGMENT),
        exchange(CATALOGUE, by="twin"),  # of equal size and number of changes
        exchange(CATALOGUE, by="other"),
        exchange(CATALOGUE, by="older"),
        exchange(SEGMENT, by="twin"),
        exchange(SEGMENT, by="other"),
    ],
)
def test_what_is_exchanged_under_a_writer_is_noticed(
    root: Path, act: Callable[[Path], None]
) -> None:
    with PriorDatabase.open(root / "a", write=True) as database:
        database.clips()
        try:
            act(root)
        except PermissionError:
            assert WINDOWS  # which does not permit it, as the writer has the file open
            return
        before = files(root)
        for _ in range(2):
            with pytest.raises(DatabaseError) as caught:
                database.add(small_clip(8))
            assert "\n" not in str(caught.value)
    assert files(root) == before


def test_a_foreign_catalogue_does_not_vanish_in_a_compaction(root: Path) -> None:
    folder = root / "a"
    with PriorDatabase.open(folder, write=True) as database:
        database.remove(database.clips()[:1])
        shutil.copyfile(root / "other" / CATALOGUE, folder / "catalogue-2.sqlite")
        database.compact()
        assert database.verify() == []
    assert (folder / "catalogue-2.sqlite").read_bytes() == (root / "other" / CATALOGUE).read_bytes()


# --- what a catalogue states ---


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("content", "/../../x"),
        ("content", "AB" * 32),
        ("segment", -1),
        ("segment", 10**12),
        ("offset", -4),
        ("offset", 10**17),
        ("offset", 3),
        ("frames", "[1e9, 5, 3]"),
        ("frames", "[-33, 17, 9]"),
        ("frames", "[33]"),
        ("frames", "[33, 10000000000, 9]"),
        ("frames", "[" * 5000),
        ("original_rate", float("inf")),
        ("original_rate", -120.0),
        ("original_frames", -1),
        ("present", "[1, 2]"),
        ("measured", "[99999, 1, 1, 1]"),
        ("checksums", "[1]"),
    ],
)
def test_impossible_values_are_damage(root: Path, column: str, value: object) -> None:
    """Also where the checksums were made to fit."""
    folder = root / "a"
    connection = sqlite3.connect(folder / CATALOGUE)
    connection.execute(f"UPDATE clips SET {column} = ? WHERE name = 'clip1'", (value,))
    connection.commit()
    connection.close()
    (folder / "catalogue.checksum").unlink()
    with PriorDatabase.open(folder) as database:
        database._catalogue._is_verified = True
        assert database.damaged == ("clip1",)
        assert len(database.clips()) == 2
        assert any("clip1" in problem for problem in database.verify())


def test_names_that_cannot_be_printed(root: Path) -> None:
    odd = "a\x1b[31m\udcff\u202eb\u00a0c"
    clip = small_clip(8)
    with PriorDatabase.open(root / "a", write=True) as database:
        record = database.add(clip, ClipOrigin(subject=odd, session="s\n1"))
        assert (record.subject, record.session) == ("a_[31m__b c", "s_1")
        assert database.verify() == []
    connection = sqlite3.connect(root / "a" / CATALOGUE)
    connection.execute("UPDATE clips SET name = 'a' || char(27) WHERE name = 'clip1'")
    connection.commit()
    connection.close()
    with PriorDatabase.open(root / "a") as database:
        assert all("\x1b" not in problem for problem in database.verify())


@pytest.mark.parametrize(
    "text",
    [
        None,
        5,
        "",
        "[]",
        "{}",
        "[" * 10000,
        SegmentList().to_text().replace("0", "1"),
        SegmentList(files=("../../etc/passwd",)).to_text(),
        SegmentList(files=("notes.txt",)).to_text(),
    ],
)
def test_a_list_of_segments_that_is_damaged(text: object) -> None:
    with pytest.raises(ValueError, match="its list of segments is"):
        SegmentList.from_text(text)


@pytest.mark.parametrize("make", MAKERS)
def test_a_pipe_or_folder_in_place_of_a_segment(root: Path, make: Callable[[Path], None]) -> None:
    (root / "a" / SEGMENT).unlink()
    make(root / "a" / SEGMENT)
    with PriorDatabase.open(root / "a") as database:
        assert len(database.clips()) == 3
        assert all("is missing" in problem for problem in database.verify())
    with pytest.raises(DatabaseCorruptError, match="is missing"):
        add(root / "a", 8)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes with names")
def test_a_pipe_in_place_of_the_checksum(root: Path) -> None:
    (root / "a" / "catalogue.checksum").unlink()
    os.mkfifo(root / "a" / "catalogue.checksum")
    with PriorDatabase.open(root / "a") as database:
        assert database.verify() == []
    add(root / "a", 8)
    assert (root / "a" / "catalogue.checksum").is_file()


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize("write", [False, True])
def test_a_pipe_or_folder_in_place_of_the_catalogue(
    root: Path, make: Callable[[Path], None], write: bool
) -> None:
    (root / "a" / CATALOGUE).unlink()
    make(root / "a" / CATALOGUE)
    with pytest.raises(DatabaseCorruptError, match="is missing"):
        PriorDatabase.open(root / "a", write=write)
