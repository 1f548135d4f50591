"""Paths that ezc3d can open."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

__all__ = ["ezc3d_path"]


@contextmanager
def ezc3d_path(path: Path, *, write: bool = False) -> Iterator[str]:
    """Yield a path of ASCII characters for a file.

    ezc3d takes paths as bytes: on Windows in the code page of the system, elsewhere in UTF-8, which
    names of files need not be. A file whose path has other characters is copied.

    Parameters
    ----------
    path : Path
        The file.
    write : bool
        The file is written in the block, and copied to its place at the end, instead of being read.
    """
    if str(path).isascii():
        yield str(path)
        return
    with TemporaryDirectory() as folder:
        plain = Path(folder) / "file.c3d"
        if not write:
            shutil.copyfile(path, plain)
        yield str(plain)
        if write:
            shutil.copyfile(plain, path)
