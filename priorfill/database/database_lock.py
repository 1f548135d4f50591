"""The lock of a database's one writer."""

from __future__ import annotations

import errno
from pathlib import Path

from priorfill.errors import DatabaseError, DatabaseLockedError
from priorfill.runtime.file_lock import LockHeldError, acquire_lock

__all__ = ["LOCK", "DatabaseLock"]

LOCK = "lock"
"""Name of the file."""

_NO_LOCKS = frozenset({errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP})
_NO_LOCKS_WINDOWS = frozenset({1, 50})
"""Errors of file systems without locks; on Windows "invalid function" and "not supported"."""


class DatabaseLock:
    """Held from construction until `release`.

    Parameters
    ----------
    folder : Path
        The database's folder.

    Raises
    ------
    DatabaseLockedError
        If another process holds it.
    DatabaseError
        If the folder cannot be written to.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        try:
            self._lock = acquire_lock(folder / LOCK)
        except LockHeldError as error:
            raise DatabaseLockedError(
                f"{folder}: {error.holder} is writing to this database; wait until it has ended"
            ) from None
        except OSError as error:
            if error.errno in _NO_LOCKS or getattr(error, "winerror", None) in _NO_LOCKS_WINDOWS:
                raise DatabaseError(
                    f"{folder}: the drive or share has no file locks ({error.strerror or error}), "
                    "so two writers could damage the database; put it on another one"
                ) from error
            raise DatabaseError(
                f"{folder}: cannot be written to ({error.strerror or error}); check its "
                "permissions, or copy it to a place where you may write"
            ) from error
        self._file = self._identity()

    def check(self) -> None:
        """Check that the folder is still the one that was locked.

        Raises
        ------
        DatabaseError
            If it was moved or replaced.
        """
        if self._identity() != self._file:
            raise DatabaseError(
                f"{self._folder}: was moved or replaced while it was open, so nothing was written; "
                "open the database again"
            )

    def _identity(self) -> tuple[int, int] | None:
        try:
            found = (self._folder / LOCK).stat()
        except OSError:
            return None
        return found.st_dev, found.st_ino

    def release(self) -> None:
        """Let the next writer in."""
        self._lock.release()
