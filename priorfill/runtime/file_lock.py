"""File locks that name their holder.

On Windows, the lock is on the first byte of the file, which nobody else can read meanwhile. The
holder's name follows that byte.
"""

from __future__ import annotations

import os
import socket
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from priorfill.runtime.held_files import wait_until_writable

if TYPE_CHECKING:
    from filelock import BaseFileLock

__all__ = ["LockHeldError", "acquire_lock"]

_MAX_HOLDER_BYTES = 200


class LockHeldError(Exception):
    """Another process, or another lock object of this one, holds the lock.

    Attributes
    ----------
    holder : str
        The holder, such as ``process 4711 on lab-pc``; ``another process`` if it left no name.
    """

    def __init__(self, holder: str) -> None:
        super().__init__(holder)
        self.holder = holder


def acquire_lock(path: Path) -> BaseFileLock:
    """Acquire an exclusive lock without waiting.

    The operating system releases the lock when the process ends, however it ends. The file stays:
    if it were removed, two processes could lock two different files.

    Parameters
    ----------
    path : Path
        The lock file; created, with its folder, if it does not exist. It names the holder.

    Returns
    -------
    filelock.BaseFileLock
        The lock; ``release()`` lets the next process in.

    Raises
    ------
    LockHeldError
        If the lock is held.
    OSError
        If the file cannot be opened or the file system has no locks.
    """
    from filelock import FileLock, Timeout  # only writers need it

    lock = FileLock(
        path,
        thread_local=False,
        fallback_to_soft=False,  # such locks can outlive their holder
        preserve_lock_file=True,
        on_acquired=_write_holder,
    )
    wait_until_writable(path)  # what is only read there would count as locked
    try:
        lock.acquire(timeout=0)
    except Timeout:
        raise LockHeldError(_read_holder(path)) from None
    return lock


def _write_holder(descriptor: int) -> None:
    holder = f"process {os.getpid()} on {socket.gethostname()}\n".encode()
    with suppress(OSError):  # the disk is full: the lock holds without a name
        os.ftruncate(descriptor, 0)
        os.lseek(descriptor, 0, os.SEEK_SET)
        os.write(descriptor, b"\n" + holder)


def _read_holder(path: Path) -> str:
    holder = ""
    with suppress(OSError), path.open("rb", buffering=0) as file:
        file.seek(1)
        holder = file.read(_MAX_HOLDER_BYTES).decode("utf-8", "replace").strip()
    return holder or "another process"
