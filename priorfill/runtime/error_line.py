"""Errors as the one line that a user reads: what is wrong, where, and what to do."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from priorfill.errors import PriorfillError
from priorfill.runtime.held_files import WINDOWS, is_held
from priorfill.runtime.windows_names import MAX_PATH

__all__ = ["DEBUG", "error_line", "system_error"]

DEBUG = "PRIORFILL_DEBUG"
"""Environment variable: if set, errors are shown with a traceback."""

NO_RUNTIME = "DLL load failed"
"""What Python says on Windows if a library lacks another one. Wheels of numba and ezc3d lack
MSVCP140.dll, which is part neither of Windows nor of Python."""

_REMEDIES = {
    errno.EACCES: "check its permissions",
    errno.EPERM: "check its permissions",
    errno.EROFS: "choose another folder",
    errno.ENOSPC: "free some space",
    errno.EDQUOT: "free some space",
    errno.EFBIG: "raise the limit on the size of files (ulimit -f)",
    errno.EMFILE: "raise the limit on open files (ulimit -n)",
    errno.ENAMETOOLONG: "choose a shorter name",
}
"""What to do about an error of the system."""


def error_line(error: BaseException, command: str = "the command") -> str:
    """Return an error in one line: what is wrong, where, and what to do.

    Parameters
    ----------
    error : BaseException
        What ended a command or a job; one that is not expected is a bug.
    command : str
        The command whose output shows more about a bug.
    """
    if isinstance(error, KeyboardInterrupt):
        return str(error) or "interrupted"
    if isinstance(error, PriorfillError):
        text = str(error)
    elif isinstance(error, OSError):
        text = system_error(error)
    elif isinstance(error, MemoryError):
        text = "there is not enough memory; use a shorter clip or a smaller database"
    elif isinstance(error, ImportError) and NO_RUNTIME in str(error):
        text = (
            "numba and ezc3d need Microsoft's Visual C++ Redistributable (x64), which is missing; "
            "install it: winget install Microsoft.VCRedist.2015+.x64"
        )
    else:
        text = (
            f"bug in priorfill ({type(error).__name__}: {error}); "
            f"please report it with the output of {command} with {DEBUG}=1"
        )
    return " ".join(line.strip() for line in text.split("\n"))


def _missing_root(path: str) -> str:
    """Return the drive or share of a path if Windows has none; else an empty text."""
    root = Path(path).absolute().anchor if WINDOWS else ""
    return "" if not root or Path(root).exists() else root


def system_error(error: OSError) -> str:
    """Return an error of the system as a message: where, what, and what to do."""
    what = error.strerror or str(error)
    if error.filename:
        remedy = _REMEDIES.get(error.errno or 0, "check the path")
        root = _missing_root(os.fsdecode(error.filename)) if error.errno == errno.ENOENT else ""
        if root:
            what, remedy = f"there is no {root}", "check the drive, or the connection to the share"
        elif WINDOWS and len(os.fsdecode(error.filename)) > MAX_PATH:
            remedy = "choose a shorter path, or enable long paths (see docs/windows.md)"
        elif is_held(error):
            remedy += ", and close it in other programs"
        return f"{os.fsdecode(error.filename)}: {what}; {remedy}"
    try:
        Path.cwd()
    except OSError:
        return f"the current folder was removed ({what}); change to another one"
    return f"{what}; {_REMEDIES.get(error.errno or 0, 'check the disk, and the paths given')}"
