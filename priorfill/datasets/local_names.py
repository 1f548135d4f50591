"""Names of files of an archive or a server, as the local system takes them."""

from __future__ import annotations

import re
import unicodedata
from pathlib import PurePosixPath

from priorfill.runtime.held_files import WINDOWS
from priorfill.runtime.windows_names import name_fault

__all__ = ["MAX_NAME", "leads_out", "local_path", "plain_path", "same_name"]

MAX_NAME = 255
"""Longest name of a file or folder: bytes of UTF-8 on most file systems of Linux, characters on
those of Windows and macOS. A name that only the latter take is refused everywhere."""

_FORBIDDEN = re.compile(r'[\x00-\x1f<>:"|?*]|[. ](?=[. ]*$)')
"""Characters that Windows allows in no name, and those that it removes from the end of one."""

_DRIVE = re.compile("[A-Za-z]:")


def leads_out(name: str) -> bool:
    r"""Return whether a name may lead out of the folder that it belongs in, on any system.

    Parameters
    ----------
    name : str
        A relative path with slashes or backslashes.

    Examples
    --------
    >>> [leads_out(name) for name in ("a/b.c3d", "a/../../b.c3d", r"\\server\b.c3d", "C:b.c3d")]
    [False, True, True, True]
    """
    path = plain_path(name)
    return path.is_absolute() or ".." in path.parts or _DRIVE.match(name) is not None


def plain_path(name: str) -> PurePosixPath:
    """Return a path of an archive or a server.

    Backslashes separate folders, too: no file of Windows has one in its name, and some of its
    programs put them into archives.

    Parameters
    ----------
    name : str
        A path with slashes or backslashes.
    """
    return PurePosixPath(name.replace("\\", "/"))


def local_path(name: str) -> PurePosixPath:
    """Return a relative path with what the system does not take in names replaced.

    On Windows, characters that it allows in no name become ``_``, as do dots and spaces at the end
    of one, and ``aux.c3d``, the name of a device, becomes ``aux_.c3d``.

    Parameters
    ----------
    name : str
        A relative path with slashes or backslashes.
    """
    path = plain_path(name)
    return PurePosixPath(*map(_allowed, path.parts)) if WINDOWS else path


def same_name(name: str | PurePosixPath) -> str:
    """Return a key that is equal for names that some system takes for the same.

    Parameters
    ----------
    name : str or PurePosixPath
        A relative path.
    """
    return unicodedata.normalize("NFC", str(name)).casefold()


def _allowed(name: str) -> str:
    """Return a name that Windows takes."""
    name = _FORBIDDEN.sub("_", name)
    if name_fault(name):  # a device
        stem, dot, suffix = name.partition(".")
        name = f"{stem.rstrip()}_{dot}{suffix}"
    return name
