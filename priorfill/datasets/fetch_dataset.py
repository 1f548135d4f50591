"""Download the recordings of a data set into a folder, which records what it has."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any

from priorfill.datasets.dataset_definitions import Dataset, DatasetFile, check_address
from priorfill.datasets.local_names import local_path, same_name
from priorfill.datasets.retry_policy import FileFetchError, RetryPolicy
from priorfill.datasets.unpack import unpack
from priorfill.errors import FetchError, OptionError
from priorfill.runtime.atomic_file import replace_file
from priorfill.runtime.file_lock import LockHeldError, acquire_lock

if TYPE_CHECKING:
    from priorfill.datasets.download import Downloader

__all__ = ["RECORD", "FetchOptions", "FetchResult", "choose_files", "fetch"]

RECORD = "priorfill-fetch.json"
"""File with what the folder has of a data set: size, hash and recordings of each file."""

_LOCK = ".priorfill-fetch.lock"
_RECORD_VERSION = 1
_ARCHIVE = ".zip"

FileProgress = Callable[[DatasetFile, int, int | None], None]
"""Called with a file, its received bytes, and those of the complete file, if known."""


@dataclass(frozen=True)
class FetchOptions:
    """What to download, and from where.

    Attributes
    ----------
    only : sequence of str
        Shell patterns of the files' paths, or of the last parts of these; empty: all files.
    limit : int or None
        Maximum number of files to download.
    mirror : str or None
        Address to use instead of the data set's own.
    policy : RetryPolicy
        Waiting times and number of attempts.
    """

    only: Sequence[str] = ()
    limit: int | None = None
    mirror: str | None = None
    policy: RetryPolicy = field(default_factory=RetryPolicy)


@dataclass(frozen=True)
class FetchResult:
    """The result for one file of a data set.

    Attributes
    ----------
    file : DatasetFile
        The file.
    path : Path
        Where it is, or would be.
    recordings : tuple of Path
        Its recordings; empty if it could not be downloaded.
    new : bool
        Whether it was downloaded now.
    size : int
        Bytes of the file.
    failure : str
        Why it could not be downloaded; empty if it was.
    """

    file: DatasetFile
    path: Path
    recordings: tuple[Path, ...] = ()
    new: bool = False
    size: int = 0
    failure: str = ""


@dataclass(frozen=True)
class _RecordedFile:
    """The record of one file; `recordings` maps paths to sizes."""

    size: int
    sha256: str
    recordings: dict[str, int]


def choose_files(dataset: Dataset, only: Sequence[str] = ()) -> tuple[DatasetFile, ...]:
    """Return the files of a data set that match any of some patterns.

    Parameters
    ----------
    dataset : Dataset
        The data set.
    only : sequence of str
        See `FetchOptions`.

    Raises
    ------
    OptionError
        If a pattern matches no file.
    """
    for pattern in only:
        if not any(_matches(file, pattern) for file in dataset.files):
            names = ", ".join(file.path for file in dataset.files)
            raise OptionError(f"{dataset.name}: no file matches {pattern!r}; its files are {names}")
    return tuple(
        file
        for file in dataset.files
        if not only or any(_matches(file, pattern) for pattern in only)
    )


def fetch(
    dataset: Dataset,
    folder: Path,
    options: FetchOptions | None = None,
    *,
    progress: FileProgress = lambda file, done, total: None,
    notify: Callable[[str], None] = lambda text: None,
    sleep: Callable[[float], None] = time.sleep,
) -> Iterator[FetchResult]:
    """Download files of a data set one after another, and unpack them.

    Files that the folder has are checked and not downloaded again; interrupted downloads are
    resumed. A file that was put there by other means is accepted. The first checksum seen of a file
    is recorded, and later ones are compared with it.

    Parameters
    ----------
    dataset : Dataset
        The data set.
    folder : Path
        Where to; created if it does not exist.
    options : FetchOptions, optional
        What to download, and from where.
    progress : callable
        Called with a file, its received bytes, and those of the complete file, if known.
    notify : callable
        Called with a sentence before a wait, and where recordings get other names.
    sleep : callable
        Waits for a number of seconds.

    Yields
    ------
    FetchResult
        For each file, including files that could not be downloaded when others may be.

    Raises
    ------
    FetchError
        If no other file could be downloaded either: the server does not answer or refuses, the
        disk is full, or the folder has another data set or is in use.
    OutputError
        If a file cannot be written.

    See Also
    --------
    find_dataset, known_datasets
    """
    from priorfill.datasets.download import Downloader  # imports requests

    options = options or FetchOptions()
    files = choose_files(dataset, options.only)
    base = dataset.base if options.mirror is None else check_address(options.mirror)
    with _locked(folder), Downloader(options.policy, notify, sleep) as downloader:
        recorded = _read_record(folder, dataset.name)
        downloaded = 0
        for file in files:
            path = folder / local_path(file.path)
            recordings = _existing_recordings(folder, recorded.get(file.path))
            if recordings is not None and not path.exists():
                # the archive was removed after it was unpacked
                yield FetchResult(file, path, recordings, size=recorded[file.path].size)
                continue
            new = not path.exists()
            if new and options.limit is not None and downloaded >= options.limit:
                continue
            known = recorded.get(file.path)
            try:
                sha256 = (
                    _download(file, path, base, downloader, known, progress)
                    if new
                    else _check(file, path, known)
                )
                taken = _recordings_of_others(recorded, file)
                entry = _unpack(path, folder, sha256, taken, notify)
            except FileFetchError as error:
                yield FetchResult(file, path, failure=str(error))
                continue
            finally:
                downloaded += new
            recorded[file.path] = entry
            _write_record(folder, dataset.name, recorded)
            recordings = tuple(folder / name for name in entry.recordings)
            yield FetchResult(file, path, recordings, new, entry.size)


def _check(file: DatasetFile, path: Path, known: _RecordedFile | None) -> str:
    """Return the checksum of a file in the folder, which must be right."""
    from pooch import file_hash

    found = str(file_hash(path))
    if file.sha256 and found != file.sha256:
        raise FileFetchError(
            f"{path}: its checksum is {found}, not {file.sha256}; remove it and try again"
        )
    if known is not None and found != known.sha256:
        raise FileFetchError(
            f"{path}: has changed since it was downloaded; remove it and try again"
        )
    return found


def _download(
    file: DatasetFile,
    path: Path,
    base: str,
    downloader: Downloader,
    known: _RecordedFile | None,
    progress: FileProgress,
) -> str:
    """Download a file; return its checksum."""
    _make_folder(path.parent)
    return downloader.get(
        base + file.path,
        path,
        size=file.size,
        sha256=file.sha256 or ("" if known is None else known.sha256),
        progress=lambda done, total: progress(file, done, total),
    )


def _recordings_of_others(recorded: dict[str, _RecordedFile], file: DatasetFile) -> dict[str, str]:
    """Return whose the recordings of all other files are, by their names."""
    return {
        same_name(name): path
        for path, entry in recorded.items()
        if path != file.path
        for name in entry.recordings
    }


def _unpack(
    path: Path,
    folder: Path,
    sha256: str,
    taken: dict[str, str],
    notify: Callable[[str], None],
) -> _RecordedFile:
    """Unpack a file if it is an archive; return what to record of it."""
    is_archive = path.suffix.lower() == _ARCHIVE
    recordings = unpack(path, folder, taken=taken, notify=notify) if is_archive else [path]
    sizes = {one.relative_to(folder).as_posix(): one.stat().st_size for one in recordings}
    return _RecordedFile(path.stat().st_size, sha256, sizes)


def _existing_recordings(folder: Path, entry: _RecordedFile | None) -> tuple[Path, ...] | None:
    """Return the recordings of a file if all of them exist, else None."""
    if entry is None:
        return None
    sizes = {folder / name: size for name, size in entry.recordings.items()}
    complete = all(path.is_file() and path.stat().st_size == size for path, size in sizes.items())
    return tuple(sizes) if complete else None


def _matches(file: DatasetFile, pattern: str) -> bool:
    """Return whether a pattern matches a file's path or the last part of it."""
    return fnmatchcase(file.path, pattern) or fnmatchcase(file.path.rpartition("/")[2], pattern)


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FetchError(
            f"{folder}: cannot be created ({error.strerror}); choose another folder"
        ) from error


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Create a folder if necessary, and keep other downloads out of it."""
    _make_folder(folder)
    try:
        lock = acquire_lock(folder / _LOCK)
    except LockHeldError as error:
        raise FetchError(
            f"{folder}: {error.holder} is downloading into it; wait until it has ended"
        ) from None
    except OSError as error:
        raise FetchError(
            f"{folder}: cannot be written ({error.strerror}); choose another folder"
        ) from error
    try:
        yield
    finally:
        lock.release()


def _read_record(folder: Path, name: str) -> dict[str, _RecordedFile]:
    """Return the record of a folder by path; empty if it has none or a damaged one.

    Without a record all files of the folder are checked again.

    Raises
    ------
    FetchError
        If the record is of another data set.
    """
    content: Any = {}
    with suppress(OSError, ValueError, RecursionError):
        content = json.loads((folder / RECORD).read_text(encoding="utf-8"))
    if not isinstance(content, dict) or content.get("version") != _RECORD_VERSION:
        return {}
    if content.get("dataset") != name:
        raise FetchError(
            f"{folder}: has files of the data set {content.get('dataset')}; choose another folder"
        )
    with suppress(TypeError, AttributeError):
        return {path: _RecordedFile(**entry) for path, entry in content["files"].items()}
    return {}


def _write_record(folder: Path, name: str, recorded: dict[str, _RecordedFile]) -> None:
    content = {
        "version": _RECORD_VERSION,
        "dataset": name,
        "files": {path: asdict(entry) for path, entry in sorted(recorded.items())},
    }
    with replace_file(folder / RECORD, overwrite=True) as temporary:
        temporary.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8", newline="\n")
