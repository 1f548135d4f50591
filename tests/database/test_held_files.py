"""Files that a program has open or mapped: Windows neither replaces nor removes them.

Linux shows it by `windows_files.as_on_windows`.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import sqlite3
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from db_cli import run
from db_processes import make_clip
from windows_files import as_on_windows

from priorfill.database import ClipRecord, PriorDatabase, catalogue, prior_database
from priorfill.database.catalogue import Catalogue
from priorfill.database.segments import SegmentReader
from priorfill.errors import DatabaseError
from priorfill.runtime import held_files

pytestmark = [
    pytest.mark.windows,
    pytest.mark.skipif(
        sys.platform not in ("linux", "win32"), reason="open files are looked up in /proc"
    ),
]

FIXTURE = Path(__file__).parents[1] / "fixtures" / "database-1"


@pytest.fixture(autouse=True)
def windows() -> Iterator[None]:
    with nullcontext() if sys.platform == "win32" else as_on_windows():
        yield


@pytest.fixture(scope="module")
def made(in_memory: Path) -> Path:
    """A database of three clips."""
    with PriorDatabase.create(in_memory / "made") as database:
        for seed in range(3):
            database.add(make_clip(seed))
    return in_memory / "made"


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    return shutil.copytree(made, tmp_path / "db")


def files(folder: Path) -> set[str]:
    there = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    return there - {"lock", "priorfill-database.json"}


def contents(database: PriorDatabase) -> dict[str, bytes]:
    return {r.name: database.checked_positions(r).tobytes() for r in database.clips()}


def reopened(folder: Path) -> dict[str, bytes]:
    """What a new reader gets; the next writer has been there before."""
    PriorDatabase.open(folder, write=True).close()
    with PriorDatabase.open(folder) as database:
        assert database.verify() == []
        return contents(database)


def remove_and_compact(folder: Path, name: str) -> int:
    with PriorDatabase.open(folder, write=True) as database:
        database.remove([record for record in database.clips() if record.name == name])
        return database.compact()


def interrupted_add(folder: Path, seed: int) -> None:
    """Append a clip, and end before its commit, as if the writer was killed."""
    with pytest.MonkeyPatch.context() as patch, PriorDatabase.open(folder, write=True) as database:

        def fail(*_: object) -> None:
            raise KeyboardInterrupt

        patch.setattr(Catalogue, "change", fail)
        with pytest.raises(KeyboardInterrupt):
            database.add(make_clip(seed))


def leftover(folder: Path) -> int:
    with PriorDatabase.open(folder) as database:
        return database.info().leftover_bytes


def test_a_compaction_leaves_what_a_reader_has_open(folder: Path) -> None:
    with PriorDatabase.open(folder) as reader:
        before = contents(reader)
        assert remove_and_compact(folder, "clip1") == 0  # nothing is freed yet
        assert contents(reader) == before
        assert reader.verify() == []
        assert {"segments/000001.f32", "catalogue.sqlite"} < files(folder)
        assert sorted(reopened(folder)) == ["clip0", "clip2"]
        size = (folder / "segments" / "000001.f32").stat().st_size
        size += (folder / "catalogue.sqlite").stat().st_size
        assert leftover(folder) == size
        with PriorDatabase.open(folder, write=True) as database:
            database.add(make_clip(3))
        assert contents(reader) == before
    after = reopened(folder)
    assert sorted(after) == ["clip0", "clip2", "clip3"]
    assert after["clip0"] == before["clip0"]
    assert leftover(folder) == 0
    assert files(folder) == {
        "segments/000002.f32",
        "catalogue-2.sqlite",
        "catalogue-2.checksum",
    }


def test_readers_of_several_states(folder: Path) -> None:
    readers, states = [], []
    for seed in range(3):
        readers.append(PriorDatabase.open(folder))
        states.append(contents(readers[-1]))
        remove_and_compact(folder, f"clip{seed}")
        with PriorDatabase.open(folder, write=True) as database:
            database.add(make_clip(seed + 3))
    for number in (1, 0, 2):
        for reader, state in zip(readers, states, strict=True):
            if reader is not None:
                assert contents(reader) == state
                assert reader.verify() == []
        readers[number].close()
        readers[number] = None  # type: ignore[call-overload]
        assert sorted(reopened(folder)) == ["clip3", "clip4", "clip5"]
    assert leftover(folder) == 0
    assert len(files(folder)) == 3


def test_a_compaction_removes_what_was_left_before(folder: Path) -> None:
    with PriorDatabase.open(folder, write=True) as database:
        with PriorDatabase.open(folder):
            database.remove(database.clips()[:1])
            assert database.compact() == 0
        left = database.info().leftover_bytes
        catalogue = (folder / "catalogue.sqlite").stat().st_size
        assert database.compact() == left - catalogue > 0  # it counts positions
        assert database.info().leftover_bytes == 0


@pytest.mark.parametrize("how", ["mapped", "open"])
def test_what_a_killed_writer_appended(folder: Path, how: str) -> None:
    """A map forbids cutting it off: the next clip goes to another segment."""
    segment = folder / "segments" / "000001.f32"
    with PriorDatabase.open(folder) as database:
        before = contents(database)
    interrupted_add(folder, 6)
    held: Any = np.memmap(segment, mode="r") if how == "mapped" else segment.open("rb")
    is_mapped = how == "mapped"
    for seed in (4, 5):
        with PriorDatabase.open(folder, write=True) as database:
            assert (database.info().leftover_bytes > 0) == is_mapped
            database.add(make_clip(seed))
            assert database.verify() == []
    found = reopened(folder)
    assert found.keys() == {*before, "clip4", "clip5"}
    assert {name: found[name] for name in before} == before
    assert (folder / "segments" / "000002.f32").exists() == is_mapped
    if not is_mapped:
        held.close()
    del held
    assert reopened(folder) == found
    assert leftover(folder) == 0
    remove_and_compact(folder, "clip4")
    assert reopened(folder).keys() == found.keys() - {"clip4"}
    assert len(files(folder)) == 3


def test_a_mapped_tail_in_a_compaction(folder: Path) -> None:
    segment = folder / "segments" / "000001.f32"
    interrupted_add(folder, 6)
    held = np.memmap(segment, mode="r")
    remove_and_compact(folder, "clip0")
    assert segment.exists()
    del held
    assert reopened(folder).keys() == {"clip1", "clip2"}
    assert not segment.exists()
    assert leftover(folder) == 0


def test_what_readers_hold_is_not_forgotten_by_a_killed_writer(folder: Path) -> None:
    with PriorDatabase.open(folder) as reader:
        remove_and_compact(folder, "clip0")
        left = leftover(folder)
        interrupted_add(folder, 6)
        assert reopened(folder).keys() == {"clip1", "clip2"}
        assert leftover(folder) == left > 0
        assert len(reader.clips()) == 3
    assert reopened(folder).keys() == {"clip1", "clip2"}
    assert leftover(folder) == 0
    assert len(files(folder)) == 3


def test_a_cut_that_was_not_made(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As wine does not where a map forbids it."""
    interrupted_add(folder, 6)
    with monkeypatch.context() as patch:
        patch.setattr(os, "truncate", lambda path, size: None)
        with PriorDatabase.open(folder, write=True) as database:
            database.add(make_clip(7))
            assert database.info().leftover_bytes > 0
            assert database.verify() == []
    assert reopened(folder).keys() == {"clip0", "clip1", "clip2", "clip7"}
    assert leftover(folder) == 0


def test_what_a_killed_compaction_wrote(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch, PriorDatabase.open(folder, write=True) as database:
        database.remove(database.clips()[:1])

        def fail(*_: object) -> None:
            (folder / "catalogue-2.sqlite.new").write_bytes(b"")
            raise KeyboardInterrupt

        patch.setattr(Catalogue, "replace", fail)
        with pytest.raises(KeyboardInterrupt):
            database.compact()
    before = None
    with (
        (folder / "catalogue-2.sqlite.new").open("rb"),
        (folder / "segments" / "000002.f32").open("rb"),
    ):
        before = reopened(folder)
        assert len(before) == 2
        assert leftover(folder) > 0
        with PriorDatabase.open(folder, write=True) as database:
            database.compact()
        assert (folder / "catalogue-3.sqlite").exists()
        assert reopened(folder) == before
    assert reopened(folder) == before
    assert files(folder) == {
        "segments/000003.f32",
        "catalogue-3.sqlite",
        "catalogue-3.checksum",
    }


def test_a_reader_that_opens_during_a_compaction(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It has the old catalogue open when the old segments go."""
    hold = SegmentReader.hold
    calls = []

    def late(self: SegmentReader, segments: set[int]) -> bool:
        calls.append(segments)
        if len(calls) == 1:
            remove_and_compact(folder, "clip1")
        return hold(self, segments)

    monkeypatch.setattr(SegmentReader, "hold", late)
    with PriorDatabase.open(folder) as reader:
        assert contents(reader).keys() == {"clip0", "clip2"}
        assert reader.verify() == []
    assert len(calls) == 2


@pytest.mark.parametrize("error", [DatabaseError("damaged"), FileNotFoundError(2, "gone")])
def test_a_reader_whose_catalogue_is_replaced_while_it_opens(
    folder: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    calls: list[Any] = []

    def late(*given: Any, **more: Any) -> Catalogue:
        calls.append(given)
        if len(calls) == 1:
            remove_and_compact(folder, "clip1")
            raise error
        return Catalogue(*given, **more)

    monkeypatch.setattr(prior_database, "Catalogue", late)
    with PriorDatabase.open(folder) as reader:
        assert contents(reader).keys() == {"clip0", "clip2"}


def test_a_checksum_file_that_is_open(folder: Path) -> None:
    """It cannot be replaced: the catalogue is checked row by row until it can."""
    with (folder / "catalogue.checksum").open("rb"):
        with PriorDatabase.open(folder, write=True) as database:
            database.add(make_clip(7))
        assert reopened(folder).keys() == {"clip0", "clip1", "clip2", "clip7"}
    assert len(reopened(folder)) == 4
    assert files(folder) == {"segments/000001.f32", "catalogue.sqlite", "catalogue.checksum"}


def test_a_conversion_while_a_reader_has_the_old_version(tmp_path: Path) -> None:
    folder = tmp_path / "db"
    shutil.copytree(FIXTURE, folder)
    with PriorDatabase.open(folder) as reader:
        before = contents(reader)
        PriorDatabase.open(folder, write=True).close()
        assert contents(reader) == before
        assert reopened(folder) == before
        assert (folder / "catalogue.sqlite").exists()
    assert reopened(folder) == before
    assert not (folder / "catalogue.sqlite").exists()
    assert leftover(folder) == 0


def test_a_record_of_what_was_removed_is_read_as_before(folder: Path) -> None:
    with PriorDatabase.open(folder) as reader:
        gone: ClipRecord = reader.clips()[0]
        expected = reader.positions(gone).tobytes()
        with PriorDatabase.open(folder, write=True) as database:
            database.remove(database.clips())
            database.compact()
        assert reader.positions(gone).tobytes() == expected


@pytest.mark.parametrize("times", [1, 100])
def test_a_scanner_that_opens_a_segment_for_itself(
    folder: Path, monkeypatch: pytest.MonkeyPatch, times: int
) -> None:
    """For a moment it is waited for; then one line names the segment."""
    really, left = Path.open, [0]

    def refused(path: Path, *given: Any, **more: Any) -> Any:
        if path.suffix == ".f32" and left[0]:
            left[0] -= 1
            error = PermissionError(13, "Permission denied", str(path))
            error.winerror = 32
            raise error
        return really(path, *given, **more)

    monkeypatch.setattr(Path, "open", refused)
    monkeypatch.setattr(held_files, "_PAUSES_S", (0.0, 0.0))
    with PriorDatabase.open(folder, write=True) as database:
        left[0] = times
        if times == 1:
            database.add(make_clip(5))
        else:
            with pytest.raises(DatabaseError, match=r"000001.f32: another program has it open"):
                database.add(make_clip(5))
        left[0] = 0
        database.add(make_clip(6))
        assert database.verify() == []
    assert len(reopened(folder)) == 3 + (times == 1) + 1


def test_other_errors_are_not_hidden(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with PriorDatabase.open(folder, write=True) as database:
        database.remove(database.clips()[:1])
        with monkeypatch.context() as patch:

            def fail(*_: object, **__: object) -> None:
                raise OSError(5, "Input/output error")

            patch.setattr(os, "unlink", fail)
            with pytest.raises((OSError, DatabaseError)):
                database.compact()
    assert len(reopened(folder)) == 2
    assert leftover(folder) == 0


def test_commands_name_what_is_left(folder: Path) -> None:
    with PriorDatabase.open(folder):
        assert run("db", "remove", "-d", folder, "clip1").exit_code == 0
        done = run("db", "compact", "-d", folder)
        assert done.exit_code == 0
        assert done.stdout == "0 bytes freed\n"
        assert "of replaced or unfinished files wait to be removed" in done.stderr
        checked = run("db", "verify", "-d", folder)
        assert checked.exit_code == 0
        assert "wait to be removed" in checked.stderr
        assert "2 clips checked, no damage found" in checked.stdout
        assert "of it waiting to be removed" in run("db", "info", "-d", folder).stdout
    assert run("db", "compact", "-d", folder).stderr == ""
    assert "waiting" not in run("db", "info", "-d", folder).stdout


def keep_for_itself(monkeypatch: pytest.MonkeyPatch, file: Path) -> None:
    """Refuse to open a file, as Windows does if another program shares it with nobody."""
    really = Path.open

    def refused(path: Path, *given: Any, **more: Any) -> Any:
        if path == file:
            error = PermissionError(13, "Permission denied", str(path))
            error.winerror = 32
            raise error
        return really(path, *given, **more)

    monkeypatch.setattr(Path, "open", refused)
    monkeypatch.setattr(held_files, "_PAUSES_S", ())


def test_a_leftover_that_another_program_keeps_for_itself(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with PriorDatabase.open(folder):
        remove_and_compact(folder, "clip1")
    with monkeypatch.context() as patch:
        keep_for_itself(patch, folder / "segments" / "000001.f32")
        with PriorDatabase.open(folder, write=True) as database:
            database.add(make_clip(5))
        assert leftover(folder) > 0
    assert len(reopened(folder)) == 3
    assert leftover(folder) == 0


@pytest.mark.parametrize("name", ["priorfill-database.json", "catalogue.checksum"])
def test_small_files_that_another_program_keeps_for_itself(
    folder: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """No damage is reported: a copy would not help."""
    keep_for_itself(monkeypatch, folder / name)
    checked = run("db", "verify", "-d", folder)
    assert checked.exit_code == 1
    assert f"{name}: cannot be read (Permission denied)" in checked.stdout + checked.stderr
    assert "close it in other programs" in checked.stdout + checked.stderr
    assert "restore" not in checked.stdout + checked.stderr


def test_a_manifest_that_is_open_during_a_conversion(tmp_path: Path) -> None:
    folder = shutil.copytree(FIXTURE, tmp_path / "old")
    with (
        (folder / "priorfill-database.json").open("rb"),
        pytest.raises(DatabaseError, match=r"priorfill-database.json: another program has it open"),
    ):
        PriorDatabase.open(folder, write=True)
    assert len(reopened(folder)) == 4


def test_a_catalogue_that_another_program_has_locked(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(catalogue, "BUSY_SECONDS", 0.05)
    with closing(sqlite3.connect(folder / "catalogue.sqlite", isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(DatabaseError, match=r"locked\); close it in other programs"):
            PriorDatabase.open(folder, write=True)
    assert len(reopened(folder)) == 3


@pytest.mark.skipif(sys.platform != "win32", reason="other systems share files with everybody")
@pytest.mark.parametrize("file", ["catalogue.sqlite", "lock"])
def test_a_database_that_is_being_copied(folder: Path, file: str) -> None:
    """A program that lets others only read is waited for."""
    kernel = ctypes.WinDLL("kernel32")
    kernel.CreateFileW.restype = ctypes.c_void_p
    name = ctypes.c_wchar_p(str(folder / file))
    read, share_read, existing = ctypes.c_uint32(0x80000000), 1, 3
    handle = kernel.CreateFileW(name, read, share_read, None, existing, 0, None)
    timer = threading.Timer(0.3, kernel.CloseHandle, [ctypes.c_void_p(handle)])
    timer.start()
    with PriorDatabase.open(folder, write=True) as database:
        database.add(make_clip(5))
    timer.join()
    assert len(reopened(folder)) == 4
