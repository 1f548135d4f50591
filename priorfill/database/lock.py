"""The lock that makes sure a database has one writer."""

from __future__ import annotations

import fcntl
import os
import socket
from contextlib import suppress
from pathlib import Path

from priorfill.errors import DatabaseLockedError

__all__ = ["WriterLock"]


class WriterLock:
    """An exclusive lock on a file that also says who holds it.

    The operating system drops it when the process ends, however it ends; the file itself
    stays, because removing it would let two writers lock two different files.

    Parameters
    ----------
    path : Path
        The lock file; made if it is not there.

    Raises
    ------
    DatabaseLockedError
        Where another process holds the lock.
    """

    def __init__(self, path: Path) -> None:
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.pread(self._file, 200, 0).decode("utf-8", "replace").strip()
            os.close(self._file)
            raise DatabaseLockedError(
                f"{path.parent}: {holder or 'another process'} is writing to this database; "
                "wait until it has ended"
            ) from None
        except BaseException:
            os.close(self._file)
            raise
        me = f"process {os.getpid()} on {socket.gethostname()}\n".encode()
        with suppress(OSError):  # a full disk: then the lock holds without a name
            os.ftruncate(self._file, 0)
            os.pwrite(self._file, me, 0)

    def release(self) -> None:
        """Let the next writer in."""
        os.close(self._file)
