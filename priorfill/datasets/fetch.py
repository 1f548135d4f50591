"""Get the recordings of a library into a folder, which remembers what it has."""

from __future__ import annotations

import fcntl
import json
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from priorfill.datasets.catalogue import Dataset, DatasetFile, check_address
from priorfill.datasets.download import (
    Downloader,
    FileFetchError,
    RetryPolicy,
    hash_of,
)
from priorfill.datasets.unpack import unpack
from priorfill.errors import FetchError
from priorfill.runtime.atomic_file import replace_file

__all__ = ["RECORD", "Fetched", "choose_files", "fetch"]

RECORD = "priorfill-fetch.json"
"""What a folder has of a library: name, size and hash of each file, and its recordings."""

_LOCK = ".priorfill-fetch.lock"

_VERSION = 1
"""Of the form of the record."""

_ARCHIVE = ".zip"


@dataclass(frozen=True)
class Fetched:
    """What became of a file of a library.

    Attributes
    ----------
    file : LibraryFile
        The file.
    path : Path
        Where it is, or would be.
    recordings : tuple of Path
        The recordings that came of it; empty where it could not be had.
    new : bool
        Whether something was downloaded for it.
    size : int
        Bytes of the file.
    failure : str
        Why it could not be had; empty if it could.
    """

    file: DatasetFile
    path: Path
    recordings: tuple[Path, ...] = ()
    new: bool = False
    size: int = 0
    failure: str = ""


@dataclass(frozen=True)
class _Entry:
    """What the record says of a file: its recordings by path, with their sizes."""

    size: int
    sha256: str
    recordings: dict[str, int]


def choose_files(library: Dataset, only: Sequence[str] = ()) -> tuple[DatasetFile, ...]:
    """Return the files of a library that patterns ask for.

    Parameters
    ----------
    library : Library
        The library.
    only : sequence of str
        Shell patterns of paths, or of their last parts; without any, all files.

    Raises
    ------
    FetchError
        Where a pattern fits none.
    """
    for pattern in only:
        if not any(_fits(file, pattern) for file in library.files):
            names = ", ".join(file.path for file in library.files)
            raise FetchError(f"{library.name}: no file fits {pattern!r}; its files are {names}")
    return tuple(
        file for file in library.files if not only or any(_fits(file, pattern) for pattern in only)
    )


def fetch(
    library: Dataset,
    folder: Path,
    *,
    only: Sequence[str] = (),
    limit: int | None = None,
    mirror: str | None = None,
    manners: RetryPolicy | None = None,
    progress: Callable[[DatasetFile, int, int | None], None] = lambda file, done, total: None,
    tell: Callable[[str], None] = lambda text: None,
    sleep: Callable[[float], None] = time.sleep,
) -> Iterator[Fetched]:
    """Get files of a library, one after another, and unpack them.

    What the folder has is checked and not asked for again; what it has in part is completed. A
    file that another program put there is taken as it is. The first checksum of a file that is seen
    is remembered, and later ones are compared with it.

    Parameters
    ----------
    library : Library
        Which.
    folder : Path
        Where to; made if it is not there.
    only : sequence of str
        Shell patterns of the files; all by default.
    limit : int or None
        How many files to download at most.
    mirror : str or None
        Address to ask instead of the library's own.
    manners : Manners or None
        How the server is treated.
    progress : callable
        Called with a file, the bytes of it that are there, and those it has, if known.
    tell : callable
        Called with a sentence when there is something to wait for.
    sleep : callable
        Waits for so many seconds.

    Yields
    ------
    Fetched
        For each file; also where this one could not be had and others may.

    Raises
    ------
    FetchError
        Where going on makes no sense: the server does not answer or refuses, the disk is full, the
        folder is another library's or in use.
    OutputError
        Where something cannot be written.
    """
    files = choose_files(library, only)
    base = library.base if mirror is None else check_address(mirror)
    downloader = Downloader(manners or RetryPolicy(), tell, sleep)
    with _locked(folder):
        entries = _read_record(folder, library.name)
        downloaded = 0
        for file in files:
            path = folder / file.path
            there = _recordings_there(folder, entries.get(file.path))
            if there is not None and not path.exists():
                # the archive was removed after it was unpacked
                yield Fetched(file, path, there, size=entries[file.path].size)
                continue
            new = not path.exists()
            if new and limit is not None and downloaded >= limit:
                continue
            try:
                entry = _get(file, path, folder, base, downloader, entries.get(file.path), progress)
            except FileFetchError as error:
                yield Fetched(file, path, failure=str(error))
                continue
            finally:
                downloaded += new
            entries[file.path] = entry
            _write_record(folder, library.name, entries)
            recordings = tuple(folder / name for name in entry.recordings)
            yield Fetched(file, path, recordings, new, entry.size)


def _get(
    file: DatasetFile,
    path: Path,
    folder: Path,
    base: str,
    downloader: Downloader,
    known: _Entry | None,
    progress: Callable[[DatasetFile, int, int | None], None],
) -> _Entry:
    """Download a file if it is not there, compare its checksum, and unpack it."""
    if path.exists():
        found = hash_of(path)
        if file.sha256 and found != file.sha256:
            raise FileFetchError(
                f"{path}: its checksum is {found}, not {file.sha256}; remove it and try again"
            )
        if known is not None and found != known.sha256:
            raise FileFetchError(
                f"{path}: has changed since it was downloaded; remove it and try again"
            )
    else:
        _make(path.parent)
        found = downloader.get(
            base + file.path,
            path,
            size=file.size,
            sha256=file.sha256 or ("" if known is None else known.sha256),
            progress=lambda done, total: progress(file, done, total),
        )
    archive = path.suffix.lower() == _ARCHIVE
    recordings = unpack(path, folder) if archive else [path]
    return _Entry(
        path.stat().st_size,
        found,
        {one.relative_to(folder).as_posix(): one.stat().st_size for one in recordings},
    )


def _recordings_there(folder: Path, entry: _Entry | None) -> tuple[Path, ...] | None:
    """Return the recordings of a file, if all are there."""
    if entry is None:
        return None
    paths = {folder / name: size for name, size in entry.recordings.items()}
    whole = all(path.is_file() and path.stat().st_size == size for path, size in paths.items())
    return tuple(paths) if whole else None


def _fits(file: DatasetFile, pattern: str) -> bool:
    """Tell if a pattern fits a file's path or its last part."""
    return fnmatchcase(file.path, pattern) or fnmatchcase(file.path.rpartition("/")[2], pattern)


def _make(folder: Path) -> None:
    """Make a folder and those above it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FetchError(
            f"{folder}: cannot be made ({error.strerror}); choose another folder (--to)"
        ) from error


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Make a folder if need be, and keep a second download out of it."""
    _make(folder)
    try:
        lock = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    except OSError as error:
        raise FetchError(
            f"{folder}: cannot be written ({error.strerror}); choose another folder (--to)"
        ) from error
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    except BlockingIOError:
        raise FetchError(
            f"{folder}: another process is downloading into it; wait until it has ended"
        ) from None
    finally:
        os.close(lock)


def _read_record(folder: Path, name: str) -> dict[str, _Entry]:
    """Read what a folder has.

    Raises
    ------
    FetchError
        Where it is of another library. A record that is damaged counts as none: then everything
        is looked at again.
    """
    content: Any = {}
    with suppress(OSError, ValueError):
        content = json.loads((folder / RECORD).read_text(encoding="utf-8"))
    if not isinstance(content, dict) or content.get("version") != _VERSION:
        return {}
    if content.get("library") != name:
        raise FetchError(
            f"{folder}: has files of the library {content.get('library')}; "
            "choose another folder (--to)"
        )
    with suppress(TypeError, AttributeError):
        return {path: _Entry(**entry) for path, entry in content["files"].items()}
    return {}


def _write_record(folder: Path, name: str, entries: dict[str, _Entry]) -> None:
    """Write what a folder has."""
    content = {
        "version": _VERSION,
        "library": name,
        "files": {path: asdict(entry) for path, entry in sorted(entries.items())},
    }
    with replace_file(folder / RECORD, overwrite=True) as temporary:
        temporary.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
