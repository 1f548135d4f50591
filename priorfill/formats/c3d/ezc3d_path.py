"""Paths that ezc3d can open."""

from __future__ import annotations

import ctypes
import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir

from priorfill.errors import OutputError
from priorfill.runtime.held_files import WINDOWS
from priorfill.runtime.windows_names import MAX_PATH

__all__ = ["ezc3d_path"]

_SHARED_FOLDERS = ("PUBLIC", "PROGRAMDATA")
"""Environment variables of Windows with folders that take files of every user, and that no user's
name is part of."""


@contextmanager
def ezc3d_path(path: Path, *, write: bool = False) -> Iterator[str]:
    """Yield a path of ASCII characters for a file.

    ezc3d takes paths as bytes: on Windows in the code page of the system, elsewhere in UTF-8, which
    names of files need not be. A file whose path has other characters, or is longer than Windows
    takes, is copied.

    Parameters
    ----------
    path : Path
        The file.
    write : bool
        The file is written in the block, and copied to its place at the end, instead of being read.

    Raises
    ------
    OutputError
        If there is no folder for the copy.
    """
    if str(path).isascii() and not (WINDOWS and len(str(path)) > MAX_PATH):
        yield str(path)
        return
    with _temporary_folder() as folder:
        plain = Path(folder) / "file.c3d"
        if not write:
            shutil.copyfile(path, plain)
        yield str(plain)
        if write:
            shutil.copyfile(plain, path)


def _temporary_folder() -> TemporaryDirectory[str]:
    """Return a new folder whose path ezc3d can open, although the user's name may have umlauts."""
    usual = gettempdir()
    if not WINDOWS:
        return TemporaryDirectory()
    shared = [os.environ.get(name, "") for name in _SHARED_FOLDERS]
    for folder in (usual, _short_path(usual), *shared):
        if folder and folder.isascii():
            try:
                # a virus scanner may still have the file open
                return TemporaryDirectory(dir=folder, ignore_cleanup_errors=True)
            except OSError:
                continue
    raise OutputError(
        f"{usual}: C3D files need a temporary folder whose path is ASCII; "
        "name one in the environment variable TEMP"
    )


def _short_path(path: str) -> str:
    """Return the path of a folder in names of 8 and 3 characters; empty if it has none."""
    if sys.platform == "win32":
        buffer = ctypes.create_unicode_buffer(MAX_PATH + 1)
        if ctypes.windll.kernel32.GetShortPathNameW(path, buffer, len(buffer)):
            return buffer.value
    return ""
