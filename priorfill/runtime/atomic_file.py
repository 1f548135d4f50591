"""Files that are written completely or not at all."""

from __future__ import annotations

import errno
import os
import re
import secrets
import shutil
import socket
import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from priorfill.errors import OutputError, PriorfillError, SourceAsOutputError
from priorfill.runtime.disk_flush import flush_file, flush_folder
from priorfill.runtime.held_files import WINDOWS, is_held, is_open_elsewhere, retry_while_held
from priorfill.runtime.processes import is_running
from priorfill.runtime.windows_names import length_fault, name_fault

__all__ = [
    "NOTE_SUFFIX",
    "check_target",
    "check_writable",
    "finish_file",
    "finish_new_file",
    "hand_on_permissions",
    "is_abandoned",
    "is_same_file",
    "remove_abandoned",
    "remove_folder",
    "replace_file",
    "temporary_name",
]

_TOKEN_BYTES = 6
"""Random bytes in a temporary name, so that two writers of one target do not collide."""

_TEMPORARY = re.compile(r"\.priorfill-([0-9a-f]{8})-([0-9]+)-[0-9a-f]{12}\.part(\.[^.]*)?")
"""Name of a temporary file: checksum of the computer's name, process, random bytes, suffix."""

NOTE_SUFFIX = ".pair"
"""Suffix of a note on a temporary folder that must not be removed (`priorfill.runtime.file_pair`).
"""

_MAX_IDLE_S = 24 * 3600.0
"""Time after which a temporary file of another computer, whose processes are unknown, counts as
abandoned. Writing a file takes seconds."""


def check_target(path: Path | str, *, overwrite: bool = False, source: Path | None = None) -> Path:
    """Check that a file can be written; return its path with links resolved.

    Parameters
    ----------
    path : Path or str
        The file to write.
    overwrite : bool
        Whether it may replace an existing file.
    source : Path or None
        A file that must not be overwritten.

    Raises
    ------
    OutputError
        If the path is the source, no regular file, write-protected, or an existing file (without
        `overwrite`), or if its folder neither exists nor can be created.
    """
    given = Path(str(path))  # Path(Path("out/C:x")) is C:x in Python 3.11
    if WINDOWS and (fault := name_fault(str(given))):
        raise OutputError(f"{given}: {fault}; choose another name")
    target = Path(os.path.realpath(given))
    if source is not None and target.exists() and source.exists() and _is_same(target, source):
        raise SourceAsOutputError(
            f"{given}: is the file that the clip was read from; choose another name"
        )
    if WINDOWS:
        _check_length(given, target)
    existing = _existing_folder(target)
    if not existing.exists():
        raise OutputError(f"{given}: there is no {existing}; check the drive, or the share")
    if not existing.is_dir():
        raise OutputError(f"{given}: {existing} is a file, no folder; choose another name")
    if target.is_dir():
        raise OutputError(f"{given}: is a folder; give the name of a file")
    if target.exists() and not target.is_file():
        raise OutputError(f"{given}: is not a regular file; give the name of one")
    if target.exists() and not overwrite:
        raise OutputError(f"{given}: exists already; choose another name or use `overwrite`")
    if target.exists() and not os.access(target, os.W_OK):
        raise OutputError(f"{given}: is write-protected; choose another name")
    if target.exists() and is_open_elsewhere(target):
        raise _open_elsewhere(given)
    return target


def _is_same(path: Path, other: Path) -> bool:
    """Return whether two paths lead to one file, however they are written."""
    there, here = path.stat(), other.stat()
    if there.st_ino == 0:  # some network drives do not number their files
        return os.path.normcase(path) == os.path.normcase(os.path.realpath(other))
    return os.path.samestat(there, here)


def _check_length(given: Path, target: Path) -> None:
    """Raise OutputError if Windows takes no path as long as the file or its temporary one."""
    longest = max(len(str(target)), len(str(target.parent / temporary_name(target.suffix))))
    if fault := length_fault(str(target), longest):
        raise OutputError(f"{given}: {fault}")


def _open_elsewhere(path: Path) -> OutputError:
    return OutputError(
        f"{path}: is open in another program; close it there, or choose another name"
    )


def _existing_folder(target: Path) -> Path:
    """Return the folder of a file, or the first above it that exists."""
    return next(folder for folder in target.parents if folder.exists() or folder == folder.parent)


def is_same_file(path: Path, other: Path) -> bool:
    """Return whether two paths are those of one file, which need not exist yet.

    Parameters
    ----------
    path, other : Path
        Both with links resolved.
    """
    if path == other:
        return True
    if path.exists() and other.exists():
        return path.samefile(other)
    return str(path).casefold() == str(other).casefold() and _ignores_case(path.parent)


def _ignores_case(folder: Path) -> bool:
    """Return whether names in a folder that differ in case only are those of one file.

    They are on most drives of Windows and macOS, and on memory sticks.
    """
    for place in (folder, *folder.parents):
        other = place.with_name(place.name.swapcase()) if place.name else place
        if place.exists() and other.name != place.name:
            return other.exists() and other.samefile(place)
    return False


def check_writable(path: Path | str, size: int) -> None:
    """Check that a folder takes a new file, by creating and removing one.

    Parameters
    ----------
    path : Path or str
        The file to write later.
    size : int
        Its approximate size (bytes).

    Raises
    ------
    OutputError
        If the folder does not take files, or has less space than that.
    """
    folder = _existing_folder(Path(os.path.realpath(path)))
    temporary = folder / temporary_name("")
    try:
        temporary.open("xb").close()
        _remove_trial(temporary)
        free = shutil.disk_usage(folder).free
    except OSError as error:
        raise _cannot_write(path, error) from error
    if free < size:
        raise OutputError(
            f"{path}: takes about {size / 1e6:.1f} MB, but only {free / 1e6:.1f} MB are free in "
            f"{folder}; free some space, or choose another folder"
        )


def _remove_trial(path: Path) -> None:
    """Remove a file; one that a virus scanner has open is removed by a later process."""
    try:
        retry_while_held(path.unlink)
    except OSError as error:
        if not is_held(error):
            raise


@contextmanager
def replace_file(path: Path | str, *, overwrite: bool = False) -> Iterator[Path]:
    """Provide a temporary file that replaces `path` if the block succeeds.

    The folder of `path` is created if it does not exist. The temporary file is in it (a rename is
    atomic only within one file system) and has the target's suffix in lower case (otherwise ezc3d
    appends one). On success it is flushed to the disk and renamed, and the folder is flushed too.
    After any exception, including an interrupt, it is removed and `path` is unchanged; that of a
    killed process is removed by the next one that writes to the folder. If the target is a
    symbolic link, the file it points to is replaced. A file that is replaced hands on its
    permissions and its owner. On Windows, where a file that a program has open cannot be replaced,
    that is tried for a moment, as virus scanners open files briefly.

    Parameters
    ----------
    path : Path or str
        The file to write.
    overwrite : bool
        Replace an existing file.

    Yields
    ------
    Path
        The temporary file, empty.

    Raises
    ------
    OutputError
        If `path` is no possible target (see `check_target`), appears while the block runs (without
        `overwrite`), is open in another program (on Windows), or the system refuses to write.
    """
    given = Path(str(path))  # Path(Path("out/C:x")) is C:x in Python 3.11
    target = check_target(given, overwrite=overwrite)
    temporary = target.parent / temporary_name(target.suffix.lower())
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        remove_abandoned(target.parent)
        # not tempfile, whose files are private (0600): results follow the umask
        temporary.open("xb").close()
        yield temporary
        if overwrite and target.exists():
            hand_on_permissions(target, temporary)
        if overwrite:
            _replace(given, temporary, target)
        elif not finish_new_file(temporary, target):
            raise OutputError(f"{given}: appeared while writing; choose another name")
    except PriorfillError:
        raise
    except OSError as error:
        raise _cannot_write(given, error) from error
    finally:
        with suppress(OSError):  # what stays is removed by a later process
            retry_while_held(temporary.unlink)


def _replace(given: Path, temporary: Path, target: Path) -> None:
    """Replace a file, and raise OutputError if another program has it open."""
    try:
        finish_file(temporary, target)
    except OSError as error:
        if is_held(error) and target.exists():
            raise _open_elsewhere(given) from error
        raise


def _cannot_write(path: Path | str, error: OSError) -> OutputError:
    reason = error.strerror or str(error)
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return OutputError(f"{path}: cannot be written ({reason}); free some space")
    return OutputError(
        f"{path}: cannot be written ({reason}); check the folder's permissions and space"
    )


def temporary_name(suffix: str) -> str:
    """Return a name that no other writer uses, and that later processes know as temporary.

    Parameters
    ----------
    suffix : str
        Its suffix.
    """
    return f".priorfill-{_computer()}-{os.getpid()}-{secrets.token_hex(_TOKEN_BYTES)}.part{suffix}"


def _computer() -> str:
    return f"{zlib.crc32(socket.gethostname().encode()):08x}"


def remove_abandoned(folder: Path) -> None:
    """Remove temporary files in a folder whose process has been killed.

    Parameters
    ----------
    folder : Path
        The folder; nothing happens if it is not there.
    """
    with suppress(OSError):
        for entry in os.scandir(folder):
            if entry.name.endswith(NOTE_SUFFIX) or not is_abandoned(entry):
                continue
            path = Path(entry.path)
            if not entry.is_dir(follow_symlinks=False):
                with suppress(OSError):
                    path.unlink()
            elif not path.with_name(path.name + NOTE_SUFFIX).exists():
                remove_folder(path)


def remove_folder(path: Path) -> None:
    """Remove a temporary folder; what is open elsewhere is removed by a later process.

    Parameters
    ----------
    path : Path
        The folder.
    """
    shutil.rmtree(path, ignore_errors=True)


def is_abandoned(entry: os.DirEntry[str]) -> bool:
    """Check whether an entry is temporary and its process has ended, as far as can be known.

    Parameters
    ----------
    entry : os.DirEntry
        Of a folder.
    """
    name = _TEMPORARY.fullmatch(entry.name)
    if name is None:
        return False
    if name[1] == _computer():
        return not is_running(int(name[2]))
    return time.time() - entry.stat(follow_symlinks=False).st_mtime > _MAX_IDLE_S


def hand_on_permissions(target: Path, temporary: Path) -> None:
    """Give a file the permissions, and where possible the owner, of the one that it replaces.

    Parameters
    ----------
    target : Path
        The file that is replaced.
    temporary : Path
        The new one.
    """
    shutil.copymode(target, temporary)
    if os.name == "nt":
        return
    there, ours = target.stat(), temporary.stat()
    if (there.st_uid, there.st_gid) != (ours.st_uid, ours.st_gid):
        try:
            os.chown(temporary, there.st_uid, there.st_gid)
        except PermissionError:  # only the superuser gives files away
            with suppress(PermissionError):
                os.chown(temporary, -1, there.st_gid)
        shutil.copymode(target, temporary)  # a change of the owner clears some of them


def finish_new_file(temporary: Path, target: Path) -> bool:
    """Rename a complete file to a name that must be free; return False if it is not.

    Parameters
    ----------
    temporary : Path
        The file, on the same drive.
    target : Path
        The new name.
    """
    _flush(temporary)
    if WINDOWS:  # where a rename replaces nothing, also on file systems without links
        try:
            retry_while_held(lambda: temporary.rename(target))
        except FileExistsError:
            return False
        return True
    try:
        os.link(temporary, target)  # fails if the name is taken; a rename would replace the file
    except FileExistsError:
        # NFS reports a link that it made as existing if the first answer is lost
        if not target.exists() or not target.samefile(temporary):
            return False
    except OSError:  # the file system has no hard links
        return _finish_reserved_file(temporary, target)
    flush_folder(target.parent)
    return True


def _finish_reserved_file(temporary: Path, target: Path) -> bool:
    """Take a name with an empty file, and replace that; return False if the name is taken."""
    try:
        target.open("xb").close()
    except FileExistsError:
        return False
    try:
        finish_file(temporary, target)
    except BaseException:
        target.unlink()
        raise
    return True


def finish_file(temporary: Path, target: Path) -> None:
    """Rename a complete file to its target, and flush the file and its folder.

    Parameters
    ----------
    temporary : Path
        The file, in the target's folder.
    target : Path
        The new name; an existing file is replaced.

    Raises
    ------
    OSError
        If the system refuses.
    """
    _flush(temporary)
    retry_while_held(lambda: temporary.replace(target))
    flush_folder(target.parent)


def _flush(path: Path) -> None:
    """Force the contents of `path` to the disk."""
    with retry_while_held(lambda: path.open("rb+")) as file:
        flush_file(file.fileno())
