"""A folder for the temporary files of a child process, which is removed also if it is killed."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from priorfill.runtime.atomic_file import remove_abandoned, remove_folder, temporary_name

__all__ = ["remove_abandoned_scratch", "scratch_folder"]


@contextmanager
def scratch_folder() -> Iterator[None]:
    """Let `tempfile` of this process use a folder of its own, which is removed at the end.

    Readers and writers copy files there that libraries cannot open in place. Where there is no
    room for it, those fail that need it.
    """
    remove_abandoned_scratch()
    try:
        usual = tempfile.gettempdir()
        folder = Path(usual, temporary_name(""))
        folder.mkdir(mode=0o700)
    except OSError:
        yield
        return
    tempfile.tempdir = str(folder)
    try:
        yield
    finally:
        tempfile.tempdir = usual
        remove_folder(folder)


def remove_abandoned_scratch() -> None:
    """Remove the folders of processes that have been killed."""
    with suppress(OSError):  # there is none
        remove_abandoned(Path(tempfile.gettempdir()))
