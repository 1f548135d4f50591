"""Force what was written from the system's memory to the disk."""

from __future__ import annotations

import errno
import os
from pathlib import Path

_FULL_FLUSH: int | None = None
try:
    import fcntl

    _FULL_FLUSH = getattr(fcntl, "F_FULLFSYNC", None)
except ImportError:  # Windows
    pass

__all__ = ["flush_file", "flush_folder"]

_UNSUPPORTED = frozenset(
    {errno.EINVAL, errno.ENOSYS, errno.ENOTSUP, errno.ENOTTY, errno.EOPNOTSUPP}
)
"""Errors of a file system that has no such call. After any other, data may be lost, and a second
call could hide that: systems report a failed write once."""


def flush_file(descriptor: int) -> None:
    """Force the contents of an open file to the disk.

    On macOS, ``fsync`` leaves them in the memory of the drive, which forgets them when the power
    fails; ``F_FULLFSYNC`` does not. Where the file system lacks that (network, exFAT), ``fsync``
    has to do.

    Parameters
    ----------
    descriptor : int
        Of a file open for writing; Python's own buffer must be flushed before.

    Raises
    ------
    OSError
        If the system could not write them.
    """
    if _FULL_FLUSH is not None:
        try:
            fcntl.fcntl(descriptor, _FULL_FLUSH)
        except OSError as error:
            if error.errno not in _UNSUPPORTED:
                raise
        else:
            return
    os.fsync(descriptor)


def flush_folder(folder: Path) -> None:
    """Force the entries of a folder (new and renamed files) to the disk.

    Where this is impossible, it does nothing: on Windows, on some network file systems, and in
    folders that may be written to but not listed.

    Parameters
    ----------
    folder : Path
        The folder.

    Raises
    ------
    OSError
        If the system could not write them.
    """
    if os.name == "nt":
        return
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except PermissionError:
        return
    try:
        flush_file(descriptor)
    except OSError as error:
        if error.errno not in _UNSUPPORTED:
            raise
    finally:
        os.close(descriptor)
