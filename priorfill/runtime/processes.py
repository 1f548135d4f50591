"""Whether a process of this computer is running."""

from __future__ import annotations

import ctypes
import os
import sys

__all__ = ["is_running"]

_QUERY_LIMITED_INFORMATION = 0x1000
_SYNCHRONIZE = 0x00100000
_INVALID_PARAMETER = 87
_WAIT_OBJECT_0 = 0
_MAX_PROCESS = 2**32
"""Access rights, error, result of a wait, and end of the numbers of processes of Windows."""


def is_running(process: int) -> bool:
    """Return whether a process runs; True if that cannot be known.

    Parameters
    ----------
    process : int
        Its number, at least 1.

    Examples
    --------
    >>> import os
    >>> is_running(os.getpid())
    True
    """
    if sys.platform == "win32":  # where os.kill(process, 0) would end the process
        return _is_running_on_windows(process)
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):  # it belongs to another user; the number is too large
        pass
    return True


if sys.platform == "win32":

    def _is_running_on_windows(process: int) -> bool:
        if process >= _MAX_PROCESS:
            return True
        kernel = ctypes.WinDLL("kernel32", use_last_error=True)
        kernel.OpenProcess.restype = ctypes.c_void_p  # a handle is as wide as a pointer
        access = _QUERY_LIMITED_INFORMATION | _SYNCHRONIZE
        handle = kernel.OpenProcess(access, False, ctypes.c_uint32(process))
        if not handle:
            return ctypes.get_last_error() != _INVALID_PARAMETER  # else it is another user's
        try:
            # a process that has ended can be opened while someone still has a handle of it
            ended: int = kernel.WaitForSingleObject(ctypes.c_void_p(handle), 0)
            return ended != _WAIT_OBJECT_0
        finally:
            kernel.CloseHandle(ctypes.c_void_p(handle))
