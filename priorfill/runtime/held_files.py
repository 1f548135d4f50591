"""Files that a program has open, which Windows neither replaces nor removes."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

__all__ = ["WINDOWS", "is_held", "is_open_elsewhere", "retry_while_held", "wait_until_writable"]

_Result = TypeVar("_Result")

WINDOWS = os.name == "nt"

_ACCESS_DENIED = 5
_SHARING_VIOLATIONS = frozenset({32, 33, 1224})
"""Errors of Windows: a program has the file open, has locked a part of it, or has mapped it. The
replacement of an open file is refused as "access denied"."""

_PAUSES_S = (0.02, 0.05, 0.1, 0.2, 0.4, 0.8)
"""Waits between attempts. Virus scanners, search indexers and synchronised folders open each new
file for some tenths of a second; a program that shows a file keeps it for minutes."""


def is_held(error: OSError) -> bool:
    """Return whether an error may be due to another program that has the file open.

    Windows refuses in the same way where permissions are missing. On other systems, open files
    can be renamed and removed: always False.

    Parameters
    ----------
    error : OSError
        Raised by a call that opens, renames or removes a file.
    """
    number = getattr(error, "winerror", None)
    if number is None:  # open() has only the error of the C library
        return WINDOWS and isinstance(error, PermissionError)
    return number == _ACCESS_DENIED or number in _SHARING_VIOLATIONS


def retry_while_held(action: Callable[[], _Result]) -> _Result:
    """Call a function again for a moment while another program has the file open.

    Parameters
    ----------
    action : callable
        Opens, renames or removes a file; has done nothing if it raises an error.

    Returns
    -------
    object
        What `action` returns.

    Raises
    ------
    OSError
        What the last call raised.
    """
    for pause in _PAUSES_S:
        try:
            return action()
        except OSError as error:
            if not is_held(error):
                raise
        time.sleep(pause)
    return action()


def is_open_elsewhere(path: Path) -> bool:
    """Return whether a program has a file open so that Windows would refuse to replace it.

    On other systems, open files can be replaced: always False. A file that is mapped but not open
    is not noticed.

    Parameters
    ----------
    path : Path
        An existing file; not changed.
    """
    if not WINDOWS:
        return False
    try:
        retry_while_held(lambda: path.rename(path))  # what an open file does not permit
    except OSError as error:
        return getattr(error, "winerror", None) in _SHARING_VIOLATIONS
    return False


def wait_until_writable(path: Path) -> None:
    """Wait for a moment while a program that reads a file lets nobody write to it.

    Copies and backups do so on Windows. Other systems do not know it: returns at once.

    Parameters
    ----------
    path : Path
        A file, which need not exist.
    """
    if WINDOWS:
        with suppress(OSError):  # who writes to it reports why
            retry_while_held(lambda: path.open("r+b").close())
