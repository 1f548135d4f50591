"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from priorfill.errors import OutputError, PriorfillError

__all__ = ["check_target", "finish_file", "replace_file"]

_TOKEN_BYTES = 6
"""Random bytes in a temporary name: two writers of one target do not meet."""


def check_target(path: Path | str, *, overwrite: bool = False, source: Path | None = None) -> Path:
    """Check that a file can be written where it should go; return the place behind links.

    Parameters
    ----------
    path : Path or str
        The file to write.
    overwrite : bool
        Whether it may replace an existing file.
    source : Path or None
        A file that it must not be.

    Raises
    ------
    OutputError
        Where it is the source, its folder is missing, or it is a folder or exists already (and
        `overwrite` is false).
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
        raise OutputError(f"{given}: exists already; choose another name or use --overwrite")
    return target


@contextmanager
def replace_file(path: Path | str, *, overwrite: bool = False) -> Iterator[Path]:
    """Hand out a temporary file that becomes `path` when the block ends well.

    The temporary file lies in the target's folder (a rename is atomic only within one file
    system) and keeps the target's suffix in lower case (ezc3d appends one otherwise). At the
    end it is flushed to the disk, renamed, and the folder is flushed too. After any
    exception, an interrupt included, it is gone and `path` is as it was. A target that is a
    symbolic link stays one: the file that it points to is replaced.

    Parameters
    ----------
    path : Path or str
        The file to write.
    overwrite : bool
        Replace an existing file.

    Yields
    ------
    Path
        The temporary file, which exists and is empty.

    Raises
    ------
    OutputError
        Where the folder is missing, `path` is a folder or exists already (and `overwrite`
        is false), or the system refuses to write.
    """
    given = Path(path)
    target = check_target(given, overwrite=overwrite)
    folder = target.parent
    temporary = folder / (
        f".{target.stem}.{secrets.token_hex(_TOKEN_BYTES)}.part{target.suffix.lower()}"
    )
    try:
        # not tempfile: its files are private (0600), a result should follow the umask
        temporary.open("xb").close()
        yield temporary
        _flush(temporary)  # may take long, and the check is to be the last thing before the rename
        # an earlier check can be outdated: somebody else may have written meanwhile
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
    """Give a file that is written to its end the name that it is known by, and flush both.

    Parameters
    ----------
    temporary : Path
        The file, in the folder of the target.
    target : Path
        What it is to be called; replaced if it is there.

    Raises
    ------
    OSError
        Where the system refuses.
    """
    _flush(temporary)
    temporary.replace(target)
    _flush_folder(target.parent)


def _flush(path: Path) -> None:
    """Force the contents of `path` to the disk."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _flush_folder(folder: Path) -> None:
    """Force the entries of `folder` to the disk, where the system can do that."""
    if os.name == "nt":  # folders cannot be opened there
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
