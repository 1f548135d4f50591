"""Names of files that Windows does not take, or takes for something else."""

from __future__ import annotations

import ctypes
import re
import sys
from contextlib import suppress
from pathlib import PureWindowsPath

__all__ = ["MAX_PATH", "length_fault", "long_paths_enabled", "name_fault"]

MAX_PATH = 259
"""Longest path (characters) that Windows takes unless long paths are enabled."""

_FORBIDDEN = re.compile(r'[\x00-\x1f<>:"|?*]')
"""A colon would write to a stream hidden behind the file before it."""

_DEVICES = frozenset(
    {"CON", "PRN", "AUX", "NUL", "CONIN$", "CONOUT$"}
    | {f"{port}{number}" for port in ("COM", "LPT") for number in "123456789¹²³"}
)
"""Names of devices, also with a suffix (Windows before 11) and in any folder."""


def name_fault(path: str) -> str:
    r"""Return what Windows would not take in a path; empty if it takes it.

    Parameters
    ----------
    path : str
        A path as Windows writes it; whether it exists does not matter.

    Returns
    -------
    str
        A phrase, such as ``NUL is the name of a device``.

    Examples
    --------
    >>> name_fault("C:\\Users\\Jürgen\\walk 1.c3d")
    ''
    >>> name_fault("clips/nul.c3d")
    'nul.c3d is the name of a device in Windows'
    """
    whole = PureWindowsPath(path)
    for name in whole.parts[1:] if whole.anchor else whole.parts:
        found = _FORBIDDEN.search(name)
        if found is not None:
            return f"{name} has a character ({found[0]!r}) that Windows allows in no name"
        if name != ".." and name.endswith((".", " ")):
            return f"{name!r} ends with a character that Windows removes from names"
        if name.split(".")[0].rstrip().upper() in _DEVICES:
            return f"{name} is the name of a device in Windows"
    return ""


def length_fault(path: str, longest: int) -> str:
    """Return what Windows would not take in the length of a path; empty if it takes it.

    Parameters
    ----------
    path : str
        The path.
    longest : int
        Length of the longest path that will be used there (characters).
    """
    if longest <= MAX_PATH or path.startswith("\\\\?\\") or long_paths_enabled():
        return ""
    return (
        f"the longest path there would have {longest} characters, and Windows takes {MAX_PATH}; "
        "choose a folder with a shorter path, or enable long paths (LongPathsEnabled, see "
        "docs/windows.md)"
    )


def long_paths_enabled() -> bool:
    """Return whether the system takes paths of more than `MAX_PATH` characters."""
    if sys.platform == "win32":
        with suppress(AttributeError):  # of wine, which takes them
            return bool(ctypes.WinDLL("ntdll").RtlAreLongPathsEnabled())
    return True
