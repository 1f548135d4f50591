"""Bytes of a file, with a one-line message where it cannot be read."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from priorfill.clip import Source
from priorfill.errors import FormatError, MissingFileError, OutputError, PriorfillError
from priorfill.runtime.held_files import WINDOWS, is_held
from priorfill.runtime.windows_names import MAX_PATH

__all__ = [
    "HEAD_BYTES",
    "MAX_BYTES",
    "check_regular",
    "check_size",
    "check_unchanged",
    "is_folder",
    "is_there",
    "no_such_file",
    "os_errors_explained",
    "read_bounded",
    "read_bytes",
    "read_source",
    "source_errors_explained",
]

HEAD_BYTES = 512
"""Bytes examined before the rest of a file is read: one block of a C3D file."""

MAX_BYTES = 1 << 30
"""Size limit of a text or array file, and of what an array file unpacks to. Ten hours of 50
markers at 100 Hz take about this much as text, and parsing takes several times that in memory."""


def check_unchanged(path: Path, digest: str, expected: str) -> None:
    """Raise OutputError if the SHA-256 of a clip's source differs from that of the file read."""
    if digest != expected:
        raise OutputError(f"{path.name}: has changed since it was read; read and fill it again")


def check_size(size: int, name: str) -> None:
    """Raise FormatError if a size (bytes) exceeds `MAX_BYTES`."""
    if size > MAX_BYTES:
        raise FormatError(
            f"{name}: holds {size / 2**30:.1f} GiB; at most {MAX_BYTES / 2**30:.0f} GiB are read: "
            "export it in parts"
        )


def is_folder(path: Path) -> bool:
    """Return whether a path leads to a folder; what a folder without permission hides is none."""
    return os.path.isdir(path)  # noqa: PTH112, Path.is_dir raises PermissionError


def is_there(path: Path) -> bool:
    """Return whether a path leads to anything.

    A link whose contents are absent, and what a folder without permission hides, count: reading
    them reports the reason.
    """
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    except OSError:
        return True
    return True


def check_regular(path: Path) -> None:
    """Raise FormatError if a path is a pipe or device, which might block or never end."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise FormatError(f"{path}: is not a regular file; give the name of one")


def no_such_file(path: Path) -> FormatError:
    """Return the error for a file that does not exist, or seems so because its path is long."""
    if path.is_symlink():
        return FormatError(
            f"{path}: is a link to a file that is not there; get that first (such as with "
            "`datalad get`)"
        )
    remedy = "check the name"
    if WINDOWS and len(os.path.abspath(path)) > MAX_PATH:  # noqa: PTH100, does not resolve links
        remedy += ", or enable long paths (LongPathsEnabled, see docs/windows.md)"
    return MissingFileError(f"{path}: there is no such file; {remedy}")


@contextmanager
def os_errors_explained(path: Path) -> Iterator[None]:
    """Turn an OSError from opening or reading a file into a FormatError of one line.

    Raises
    ------
    MissingFileError
        If the file does not exist.
    FormatError
        If it is not a regular file, or cannot be read.
    """
    try:
        check_regular(path)
        yield
    except PriorfillError:  # an OutputError is an OSError
        raise
    except FileNotFoundError:
        raise no_such_file(path) from None
    except OSError as error:
        if path.is_dir():  # Windows does not permit to open it
            raise FormatError(f"{path}: is a folder; give the name of a file") from None
        remedy = "check its permissions"
        if is_held(error):
            remedy += ", and close it in other programs"
        raise FormatError(f"{path}: cannot be read ({error.strerror}); {remedy}") from error


@contextmanager
def source_errors_explained(path: Path) -> Iterator[None]:
    """As `os_errors_explained`, for a file that was read before: its name was right.

    Raises
    ------
    FormatError
        If the file no longer exists, or cannot be read.
    """
    try:
        with os_errors_explained(path):
            yield
    except MissingFileError as error:
        raise FormatError(str(error)) from None


def read_bytes(
    path: Path, *, max_bytes: int, accept: Callable[[bytes], bool] = lambda head: True
) -> bytes:
    """Return a file's contents.

    Parameters
    ----------
    path : Path
        The file.
    max_bytes : int
        Size limit (bytes).
    accept : callable
        Checks the first `HEAD_BYTES` bytes. If it returns False, only these bytes are returned,
        however large the file, and the caller's parser reports what is wrong with them.

    Raises
    ------
    FormatError
        If the file does not exist, cannot be read, or exceeds `max_bytes`.
    """
    with os_errors_explained(path), path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        head = file.read(HEAD_BYTES)
        if not accept(head):
            return head
        if size > max_bytes:
            raise FormatError(
                f"{path}: has {size / 1e9:.1f} GB, and at most {max_bytes / 1e9:g} are read; "
                "cut the recording into parts"
            )
        file.seek(0)
        return file.read()


def read_bounded(path: Path) -> bytes:
    """Return the contents of a text or array file.

    Raises
    ------
    FormatError
        If it cannot be read, or exceeds `MAX_BYTES`.
    """
    with suppress(OSError):  # read_bytes reports it better
        check_size(path.stat().st_size, path.name)
    return read_bytes(path, max_bytes=MAX_BYTES)


def read_source(source: Source) -> bytes:
    """Return the contents of the text or array file that a clip was read from.

    Raises
    ------
    FormatError
        If it no longer exists.
    OutputError
        If it has changed since.
    """
    with source_errors_explained(source.path):
        data = read_bounded(source.path)
    check_unchanged(source.path, hashlib.sha256(data).hexdigest(), source.sha256)
    return data
