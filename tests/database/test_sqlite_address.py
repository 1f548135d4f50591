"""SQLite opens a catalogue wherever the system does: names with special characters, shares."""

from __future__ import annotations

import errno
import sqlite3
from contextlib import closing
from pathlib import Path, PurePath, PurePosixPath, PureWindowsPath
from urllib.parse import unquote_to_bytes

import pytest
from db_processes import make_clip
from platforms import WINDOWS

from priorfill.database import PriorDatabase, create_database, database_lock
from priorfill.database.sqlite_address import sqlite_address
from priorfill.errors import DatabaseError, DatabaseFormatError, DatabaseNotFoundError
from priorfill.runtime import windows_names

pytestmark = pytest.mark.windows

NAMES = ["50% #1 & größer", "a%20b;c=d", "mode=memory&cache=shared", "日本 Ünï", "file~'`{}[]"]


@pytest.mark.parametrize(
    "path",
    [
        PureWindowsPath(r"\\server\share\lab priors\catalogue.sqlite"),
        PureWindowsPath(r"\\?\UNC\server\share\50%#größe.sqlite"),
        PureWindowsPath(r"\\?\C:\long\catalogue.sqlite"),
        PureWindowsPath("Z:/Labor/catalogue.sqlite"),
        PurePosixPath("//server/catalogue.sqlite"),
        PurePosixPath("/data/a?b#c%41/catalogue.sqlite"),
    ],
)
@pytest.mark.parametrize("mode", ["ro", "rw"])
def test_the_path_reaches_the_system_as_it_is(path: PurePath, mode: str) -> None:
    address, _, parameters = sqlite_address(path, mode).partition("?")
    assert parameters == f"mode={mode}"
    assert "/" not in address  # which would begin the name of a server, or a fragment
    assert "#" not in address
    assert unquote_to_bytes(address.removeprefix("file:")).decode() == str(path)


@pytest.mark.parametrize("name", NAMES)
def test_a_database_in_a_folder_of_any_name(tmp_path: Path, name: str) -> None:
    folder = tmp_path / name
    with PriorDatabase.create(folder) as database:
        database.add(make_clip(0))
    with PriorDatabase.open(folder, write=True) as database:
        database.remove(database.clips())
        database.compact()
        database.add(make_clip(1))
    with PriorDatabase.open(folder) as database:
        assert [record.name for record in database.clips()] == ["clip1"]
        assert database.verify() == []


def test_a_file_that_does_not_exist_is_not_made(tmp_path: Path) -> None:
    for mode in ("ro", "rw"):
        with (
            pytest.raises(sqlite3.OperationalError, match="unable to open"),
            closing(sqlite3.connect(sqlite_address(tmp_path / "none", mode), uri=True)) as file,
        ):
            file.execute("SELECT 1 FROM sqlite_schema")
    assert list(tmp_path.iterdir()) == []


def test_no_write_ahead_log_and_full_flushes(tmp_path: Path) -> None:
    """A write-ahead log needs memory that processes share, which a network does not have."""
    with PriorDatabase.create(tmp_path / "db") as database:
        database.add(make_clip(0))
        connection = database._catalogue._connection
        assert connection is not None
        found = [
            connection.execute(f"PRAGMA {name}").fetchone()[0]
            for name in ("journal_mode", "synchronous", "fullfsync")
        ]
    assert found == ["delete", 3, 1]


@pytest.mark.skipif(not WINDOWS, reason="other systems have one root, which is always there")
@pytest.mark.parametrize("root", ["\\\\no-such-server\\share\\", "Q:\\"])
def test_a_share_or_drive_that_is_gone(root: str) -> None:
    with pytest.raises(DatabaseNotFoundError) as caught:
        PriorDatabase.open(f"{root}lab priors")
    assert f"there is no {root}; check the drive, or the connection" in str(caught.value)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("aux", "aux is the name of a device in Windows; choose another name"),
        ("priors?", "that Windows allows in no name; choose"),
        ("p" * 240, "and Windows takes 259; choose a folder with a shorter path"),
    ],
)
def test_folders_that_windows_does_not_take(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, text: str
) -> None:
    monkeypatch.setattr(create_database, "WINDOWS", True)
    monkeypatch.setattr(windows_names, "long_paths_enabled", lambda: False)
    with pytest.raises(DatabaseFormatError) as caught:
        PriorDatabase.create(tmp_path / name)
    assert text in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.ENOSYS])
def test_a_share_without_locks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    PriorDatabase.create(tmp_path / "db").close()

    def fail(path: Path) -> None:
        raise OSError(number, "No locks available", str(path))

    monkeypatch.setattr(database_lock, "acquire_lock", fail)
    with pytest.raises(DatabaseError, match=r"has no file locks \(No locks available\), so two"):
        PriorDatabase.open(tmp_path / "db", write=True)
    with PriorDatabase.open(tmp_path / "db") as reader:
        assert reader.clips() == ()
