"""Files that are open cannot be replaced or removed: what Windows does, shown on Linux."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from priorfill.runtime import held_files

ACCESS_DENIED, SHARING_VIOLATION, MAPPED = 5, 32, 1224
"""Numbers of Windows for these errors."""


@contextmanager
def as_on_windows() -> Iterator[list[str]]:
    """Refuse what Windows refuses for files that this process has open or mapped.

    An open file is neither removed, renamed nor replaced; a mapped one is not shortened either.
    SQLite, which removes its journals itself, is not affected, and other processes are not seen.

    Yields
    ------
    list of str
        The refused calls: name of the function and of the file.
    """
    refused: list[str] = []

    def refuse(call: str, path: Any, number: int) -> None:
        refused.append(f"{call} {Path(path).name}")
        error = PermissionError(13, f"refused by the test ({number})", os.fspath(path))
        error.winerror = number  # type: ignore[attr-defined]
        raise error

    def removing(call: str, really: Callable[..., None]) -> Callable[..., None]:
        def patched(path: Any, *more: Any, **options: Any) -> None:
            if not options and (is_open(path) or is_mapped(path)):
                refuse(call, path, SHARING_VIOLATION)
            really(path, *more, **options)

        return patched

    def renaming(call: str, really: Callable[..., None]) -> Callable[..., None]:
        def patched(source: Any, target: Any, *more: Any, **options: Any) -> None:
            if is_open(source) or is_mapped(source):
                refuse(call, source, SHARING_VIOLATION)
            if is_open(target) or is_mapped(target):
                refuse(call, target, ACCESS_DENIED)
            really(source, target, *more, **options)

        return patched

    def shortening(really: Callable[..., None]) -> Callable[..., None]:
        def patched(path: Any, length: int) -> None:
            if is_mapped(path):
                refuse("truncate", path, MAPPED)
            really(path, length)

        return patched

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(held_files, "_PAUSES_S", ())  # what holds a file here does not let go
        for name in ("unlink", "remove"):
            patch.setattr(os, name, removing(name, getattr(os, name)))
        for name in ("rename", "replace"):
            patch.setattr(os, name, renaming(name, getattr(os, name)))
        patch.setattr(os, "truncate", shortening(os.truncate))
        yield refused


def is_open(path: Any) -> bool:
    """Return whether this process has a file open."""
    return isinstance(path, (str, os.PathLike)) and os.path.realpath(path) in _open_files()


def _open_files() -> Iterator[str]:
    for link in Path("/proc/self/fd").iterdir():
        with suppress(OSError):  # it was that of the listing
            yield str(link.readlink())


def is_mapped(path: Any) -> bool:
    """Return whether this process has a file mapped."""
    if not isinstance(path, (str, os.PathLike)):
        return False
    name = os.path.realpath(path)
    maps = Path("/proc/self/maps").read_text(encoding="utf-8", errors="surrogateescape")
    return any(line.endswith(f" {name}") for line in maps.splitlines())
