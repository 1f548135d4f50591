"""A file and a text that belong together: both are replaced or neither, also by a killed process.

Two files cannot be renamed at once. So the complete file waits under a temporary name, and a note
next to it has the text and the names. Once the note is there, the pair counts as written: if the
process is killed before both names are, the next one that writes there finishes its work.
"""

from __future__ import annotations

import base64
import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from priorfill.errors import OutputError
from priorfill.runtime.atomic_file import (
    NOTE_SUFFIX,
    check_target,
    finish_file,
    finish_new_file,
    hand_on_permissions,
    is_abandoned,
    remove_folder,
    replace_file,
    temporary_name,
)

__all__ = ["file_state", "finish_pairs", "write_pair"]

_FORMAT = 1
"""Version of a note."""


@dataclass(frozen=True)
class _Note:
    """What is left to do when both files are complete.

    Attributes
    ----------
    waiting : str
        Name of the complete file, in the temporary folder.
    output : str
        Its new name, in the folder of the note.
    text_path : str
        Absolute path of the text.
    text : str
        The text in base64.
    before, text_before : list of int or None
        State of the file and of the text's file when the note was written; None: there was none.
    format : int
        Version of the note.
    """

    waiting: str
    output: str
    text_path: str
    text: str
    before: list[int] | None
    text_before: list[int] | None
    format: int = _FORMAT


def write_pair(
    output: Path | str,
    write: Callable[[Path], Any],
    text_path: Path | str,
    text: bytes,
    *,
    overwrite: bool = False,
) -> Any:
    """Write a file and a text, both or neither.

    Parameters
    ----------
    output : Path or str
        The file.
    write : callable
        Writes it at the path that it is given, which has the same name in another folder.
    text_path : Path or str
        The file for the text.
    text : bytes
        The text.
    overwrite : bool
        Replace existing files.

    Returns
    -------
    object
        What `write` returns.

    Raises
    ------
    OutputError
        If one of the files cannot be written; then neither is changed.
    """
    given = Path(str(output))
    target = check_target(given, overwrite=overwrite)
    text_target = check_target(text_path, overwrite=overwrite)
    if target == text_target:
        raise OutputError(f"{given}: is the name of both files; choose another one")
    finish_pairs(target.parent)
    with _waiting_folder(given, target) as folder:
        done = _with_name(lambda: write(folder / given.name), folder / given.name, given)
        if target.exists():
            hand_on_permissions(target, folder / given.name)
        _finish(folder / given.name, given, target, text_target, text, overwrite=overwrite)
    return done


def finish_pairs(folder: Path) -> None:
    """Finish the pairs in a folder whose process was killed between the two files.

    Files that somebody has changed in the meantime stay as they are.

    Parameters
    ----------
    folder : Path
        Where the files are.
    """
    with suppress(OSError):
        for entry in os.scandir(folder):
            if entry.name.endswith(NOTE_SUFFIX) and is_abandoned(entry):
                with suppress(OSError, OutputError):  # the next process tries again
                    _finish_one(Path(entry.path))


@contextmanager
def _waiting_folder(given: Path, target: Path) -> Iterator[Path]:
    """Make a temporary folder next to a file; it is removed at the end."""
    folder = target.parent / temporary_name("")
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise _cannot_write(given, error) from error
    try:
        yield folder
    finally:
        remove_folder(folder)


def _with_name(write: Callable[[], Any], written: Path, given: Path) -> Any:
    """Write a file; messages have the name that it gets in the end."""
    try:
        return write()
    except OutputError as error:
        raise OutputError(str(error).replace(str(written), str(given))) from error


def _finish(
    waiting: Path, given: Path, target: Path, text_target: Path, text: bytes, *, overwrite: bool
) -> None:
    """Replace both files, or restore the text if the other one cannot be replaced."""
    note = _Note(
        waiting.name,
        target.name,
        str(text_target),
        base64.b64encode(text).decode("ascii"),
        file_state(target),
        file_state(text_target),
    )
    old_text = text_target.read_bytes() if text_target.exists() else None
    path, own = _note_of(waiting.parent), waiting.with_name(NOTE_SUFFIX)
    try:
        own.write_text(json.dumps(asdict(note)), encoding="utf-8", newline="\n")
        finish_file(own, path)  # from here on, both are written
    except OSError as error:
        raise _cannot_write(given, error) from error
    try:
        _write_text(text_target, text, overwrite=overwrite)
        try:
            if overwrite:
                finish_file(waiting, target)
            elif not finish_new_file(waiting, target):
                raise OutputError(f"{given}: appeared while writing; choose another name")
        except OSError as error:
            _restore(text_target, old_text)
            raise _cannot_write(given, error) from error
    except OSError:
        path.unlink(missing_ok=True)
        raise
    except BaseException:  # an interrupt
        _finish_one(path)
        raise
    path.unlink(missing_ok=True)


def _cannot_write(path: Path, error: OSError) -> OutputError:
    if isinstance(error, OutputError):
        return error
    return OutputError(
        f"{path}: cannot be written ({error.strerror}); close it in other programs, and check the "
        "folder"
    )


def _finish_one(path: Path) -> None:
    """Do what a note says, and remove it."""
    folder = path.with_suffix("")
    note = _read(path)
    if note is not None:
        target, text_target = path.parent / note.output, Path(note.text_path)
        text = base64.b64decode(note.text)
        waiting = folder / note.waiting
        ours = text_target.exists() and text_target.read_bytes() == text
        if (ours or file_state(text_target) == note.text_before) and (
            not waiting.exists() or file_state(target) == note.before
        ):
            if not ours:
                _write_text(text_target, text, overwrite=True)
            if waiting.exists():
                finish_file(waiting, target)
    remove_folder(folder)
    path.unlink(missing_ok=True)


def _read(path: Path) -> _Note | None:
    """Read a note; None if it is none."""
    try:
        note = _Note(**json.loads(path.read_text(encoding="utf-8")))
        base64.b64decode(note.text, validate=True)
        names = (note.waiting, note.output)
        plain = all(Path(name).name == name for name in names)  # in this folder, whoever wrote it
        plain = plain and Path(note.text_path).is_absolute()
    except (ValueError, TypeError, RecursionError):
        return None
    return note if note.format == _FORMAT and plain else None


def _note_of(folder: Path) -> Path:
    return folder.with_name(folder.name + NOTE_SUFFIX)


def file_state(path: Path) -> list[int] | None:
    """Return what tells whether a file has been changed: size and time; None if there is none.

    Parameters
    ----------
    path : Path
        The file.
    """
    try:
        there = path.stat()
    except FileNotFoundError:
        return None
    return [there.st_size, there.st_mtime_ns]


def _write_text(path: Path, text: bytes, *, overwrite: bool) -> None:
    with replace_file(path, overwrite=overwrite) as temporary:
        temporary.write_bytes(text)


def _restore(path: Path, text: bytes | None) -> None:
    """Give a file its old content; None: it was not there."""
    if text is None:
        path.unlink(missing_ok=True)
    else:
        _write_text(path, text, overwrite=True)
