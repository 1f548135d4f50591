"""Read a file's bytes, and say in a line why that cannot be done."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from priorfill.errors import FormatError, OutputError, PriorfillError

__all__ = ["BEGINNING", "check_unchanged", "read_contents", "told"]

BEGINNING = 512
"""Bytes that are looked at before the rest is read: a block of a C3D file."""


def check_unchanged(path: Path, digest: str, expected: str) -> None:
    """Raise OutputError if a clip's source is not what was read any more, by its SHA-256."""
    if digest != expected:
        raise OutputError(f"{path.name}: has changed since it was read; read and fill it again")


@contextmanager
def told(path: Path) -> Iterator[None]:
    """Say in a line why a file cannot be opened or read.

    Raises
    ------
    FormatError
        If there is no such file, or it cannot be read.
    """
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):
            # a pipe, which may never say anything
            raise FormatError(f"{path}: is no file; give the name of one")
        yield
    except PriorfillError:  # an OutputError is an OSError
        raise
    except FileNotFoundError:
        raise FormatError(f"{path}: there is no such file; check the name") from None
    except IsADirectoryError:
        raise FormatError(f"{path}: is a folder; give the name of a file") from None
    except OSError as error:
        raise FormatError(
            f"{path}: cannot be read ({error.strerror}); check its permissions"
        ) from error


def read_contents(
    path: Path, *, most: int, begins: Callable[[bytes], bool] = lambda start: True
) -> bytes:
    """Return a file's contents.

    Parameters
    ----------
    path : Path
        The file.
    most : int
        Bytes that it may have.
    begins : callable
        Tells by the first `BEGINNING` bytes if the file is what is looked for. Where it is not,
        these are returned alone: what they are is for the caller to say, however large the rest.

    Raises
    ------
    FormatError
        If there is no such file, it cannot be read, or is too large.
    """
    with told(path), path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        start = file.read(BEGINNING)
        if not begins(start):
            return start
        if size > most:
            raise FormatError(
                f"{path}: has {size / 1e9:.1f} GB, and at most {most / 1e9:g} are read; "
                "cut the recording into parts"
            )
        file.seek(0)
        return file.read()
