"""Failures to inject into calls that change a disk."""

from __future__ import annotations

import builtins
import errno
import io
import os
import sqlite3
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

__all__ = ["Fault", "Faults"]

HELD = ("unlink", "remove", "rename", "replace", "rmdir", "truncate")
"""Calls that Windows refuses while another program has the file open."""

SHARING = 32
"""Windows' number for the error of a file that is open elsewhere (ERROR_SHARING_VIOLATION)."""


@dataclass(frozen=True)
class Fault:
    """A failure to inject.

    Attributes
    ----------
    at : int
        Number of the failing call, from 1; 0: none.
    late : bool
        Whether it fails after it was executed; otherwise before, a write after half of its bytes.
    for_ever : bool
        Whether all later calls fail too, without being executed.
    only : str
        Count only calls that have this in their name: ``fsync``, ``sqlite commit``, ...
    held : bool
        Whether only calls on paths are counted, and fail, which Windows refuses while another
        program has the file open.
    full : bool
        Whether the error is that of a full disk.
    strike : callable, optional
        Called at the failing call, before the error is raised.
    error : callable, optional
        Returns the error; by default an OSError, for SQLite an OperationalError.
    """

    at: int = 0
    late: bool = False
    for_ever: bool = False
    only: str = ""
    held: bool = False
    full: bool = False
    strike: Callable[[], None] | None = None
    error: Callable[[], BaseException] | None = None

    def ignores(self, what: str) -> bool:
        """Return whether it has no effect on a call; a full disk removes and renames files."""
        return (self.held and what not in HELD) or (self.full and what in HELD)


class Faults:
    """Counts the calls that change a disk, and makes one of them fail.

    Inside its ``with`` block, functions of `os`, `open` and new SQLite connections are patched.

    Parameters
    ----------
    inside : Path
        Calls on paths count in this folder only; calls on open files always count.
    fault : Fault, optional
        The failure; none by default.

    Attributes
    ----------
    calls : int
        Number of calls since `arm`.
    struck : str
        The call that failed; empty if none has.
    """

    PATHS = ("unlink", "remove", "rename", "replace", "mkdir", "rmdir", "truncate", "link")
    HANDLES = ("fsync", "fdatasync", "ftruncate", "write", "pwrite", "sendfile", "copy_file_range")
    STATEMENTS = ("BEGIN", "COMMIT", "INSERT", "UPDATE", "DELETE", "CREATE", "ROLLBACK", "PRAGMA U")

    def __init__(self, inside: Path, fault: Fault | None = None) -> None:
        self._inside = str(inside.resolve())
        self._undo: list[tuple[Any, str, Any]] = []
        self.arm(fault or Fault())

    def arm(self, fault: Fault) -> None:
        """Restart the count, with another fault."""
        self._fault: Fault | None = fault
        self.calls = 0
        self.struck = ""

    def disarm(self) -> None:
        """Stop injecting failures; open connections and files stay usable."""
        self._fault = None

    def __enter__(self) -> Faults:
        for name in self.PATHS:
            self._patch(os, name, self._on_paths)
        for name in self.HANDLES:
            self._patch(os, name, self._always)
        for module in (io, builtins):
            self._patch(module, "open", self._opening)
        self._patch(sqlite3, "connect", self._connecting)
        return self

    def __exit__(self, *_: object) -> None:
        for module, name, old in reversed(self._undo):
            setattr(module, name, old)
        self._undo.clear()
        self.disarm()

    def call(self, what: str, do: Callable[[], Any], half: Callable[[], Any] | None = None) -> Any:
        """Carry out a counted call, or make it fail."""
        fault = self._fault
        if fault is None or fault.ignores(what):
            return do()
        self.calls += fault.only in what
        if self.struck and fault.for_ever:
            raise self._raised(fault, what)
        if self.calls != fault.at or self.struck or fault.only not in what:
            return do()
        if fault.late:
            done = do()
            if what == "open":
                done.close()
        elif half is not None:
            half()
        if fault.strike is not None:
            fault.strike()
        self.struck = what
        raise self._raised(fault, what)

    def _raised(self, fault: Fault, what: str) -> BaseException:
        if fault.error is not None:
            return fault.error()
        if fault.held:
            return PermissionError(errno.EACCES, "Another program has the file open", what, SHARING)
        if what.startswith("sqlite"):
            reason = "database or disk is full" if fault.full else "disk I/O error"
            return sqlite3.OperationalError(reason)
        if fault.full:
            return OSError(errno.ENOSPC, "No space left on device")
        return OSError(errno.EIO, f"Input/output error ({what})")

    def _patch(self, module: Any, name: str, wrap: Callable[[str, Any], Any]) -> None:
        old = getattr(module, name, None)
        if old is not None:
            self._undo.append((module, name, old))
            setattr(module, name, wrap(name, old))

    def _is_inside(self, path: object) -> bool:
        if not isinstance(path, (str, os.PathLike)):
            return isinstance(path, int)
        return os.path.realpath(path).startswith(self._inside)

    def _on_paths(self, name: str, old: Any) -> Any:
        def patched(path: Any, *more: Any, **options: Any) -> Any:
            if not self._is_inside(path):
                return old(path, *more, **options)
            # what a rename replaces may be open elsewhere; a new name, or a missing file, is not
            target = more[0] if name in ("rename", "replace") and more else path
            what = name if os.path.lexists(target) else f"{name} (no such file yet)"
            return self.call(what, lambda: old(path, *more, **options))

        return patched

    def _always(self, name: str, old: Any) -> Any:
        return lambda *given, **options: self.call(name, lambda: old(*given, **options))

    def _opening(self, name: str, old: Any) -> Any:
        def patched(file: Any, mode: str = "r", *more: Any, **options: Any) -> Any:
            is_counted = set(mode) & set("wxa+") and self._is_inside(file)
            if not is_counted or isinstance(file, int):
                return old(file, mode, *more, **options)
            opened = self.call("open", lambda: old(file, mode, *more, **options))
            return _File(opened, self)

        return patched

    def _connecting(self, name: str, old: Any) -> Any:
        faults = self

        class Connection(sqlite3.Connection):
            """A connection whose changing statements count."""

            def execute(self, sql: str, *more: Any) -> sqlite3.Cursor:
                do = super().execute
                word = sql.lstrip().upper()
                if not word.startswith(Faults.STATEMENTS):
                    return do(sql, *more)
                what = f"sqlite {word.split()[0].lower()}"
                return faults.call(what, lambda: do(sql, *more))  # type: ignore[no-any-return]

            def executemany(self, sql: str, *more: Any) -> sqlite3.Cursor:
                do = super().executemany
                return faults.call("sqlite many", lambda: do(sql, *more))  # type: ignore[no-any-return]

            def executescript(self, sql: str) -> sqlite3.Cursor:
                do = super().executescript
                return faults.call("sqlite script", lambda: do(sql))  # type: ignore[no-any-return]

            def commit(self) -> None:
                faults.call("sqlite commit", super().commit)

        return lambda *given, **options: old(*given, **{"factory": Connection, **options})


class _File:
    """A file whose writes count."""

    def __init__(self, file: Any, faults: Faults) -> None:
        self._file = file
        self._faults = faults

    def write(self, data: Any) -> Any:
        do = self._file.write
        return self._faults.call("write", lambda: do(data), lambda: do(data[: len(data) // 2]))

    def __enter__(self) -> _File:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)
