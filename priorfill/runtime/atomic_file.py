"""Files that are written completely or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from priorfill.errors import OutputError, PriorfillError

__all__ = ["check_target", "finish_file", "flush_folder", "replace_file"]

_TOKEN_BYTES = 6
"""Random bytes in a temporary name, so that two writers of one target do not collide."""


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
        If the path is the source, a folder, or an existing file (without `overwrite`), or if its
        folder does not exist.
    """
    given = Path(path)
    target = Path(os.path.realpath(given))
    if source is not None and target.exists() and source.exists() and target.samefile(source):
        raise OutputError(f"{given}: is the file that the clip was read from; choose another name")
    if not target.parent.is_dir():
        raise OutputError(f"{given}: the folder {target.parent} does not exist; create it first")
    if target.is_dir():
        raise OutputError(f"{given}: is a folder; give the name of a file")
    if target.exists() and not overwrite:
        raise OutputError(f"{given}: exists already; choose another name or use `overwrite`")
    return target


@contextmanager
def replace_file(path: Path | str, *, overwrite: bool = False) -> Iterator[Path]:
    """Provide a temporary file that replaces `path` if the block succeeds.

    The temporary file is in the target's folder (a rename is atomic only within one file system)
    and has the target's suffix in lower case (otherwise ezc3d appends one). On success it is
    flushed to the disk and renamed, and the folder is flushed too. After any exception, including
    an interrupt, it is removed and `path` is unchanged. If the target is a symbolic link, the file
    it points to is replaced.

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
        If the folder does not exist, `path` is a folder or an existing file (without
        `overwrite`), or the system refuses to write.
    """
    given = Path(path)
    target = check_target(given, overwrite=overwrite)
    folder = target.parent
    temporary = folder / (
        f".{target.stem}.{secrets.token_hex(_TOKEN_BYTES)}.part{target.suffix.lower()}"
    )
    try:
        # not tempfile, whose files are private (0600): results follow the umask
        temporary.open("xb").close()
        yield temporary
        # flushing is slow, so the second check follows it, right before the rename: another process
        # may have written the target since the first check
        _flush(temporary)
        if target.exists() and not overwrite:
            raise OutputError(f"{given}: appeared while writing; choose another name")
        finish_file(temporary, target)
    except PriorfillError:
        raise
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(
            f"{given}: cannot be written ({reason}); check the folder's permissions and space"
        ) from error
    finally:
        with suppress(OSError):
            temporary.unlink()


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
    temporary.replace(target)
    flush_folder(target.parent)


def _flush(path: Path) -> None:
    """Force the contents of `path` to the disk."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def flush_folder(folder: Path) -> None:
    """Force the entries of `folder` (new and renamed files) to the disk.

    Windows cannot open folders; there this does nothing.
    """
    if os.name == "nt":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
