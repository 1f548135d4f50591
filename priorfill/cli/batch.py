"""Read many files, of which none can stop the others."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from priorfill.errors import FormatError, PriorfillError

if TYPE_CHECKING:
    from priorfill.clip import Clip
    from priorfill.runtime.worker import Worker

__all__ = ["Reader", "with_path"]

FEWEST = 6
"""Files from which on they are read in another process: to start it takes as long as to read so
many. Of fewer, whoever waits sees which one it is."""

PATIENCE = 60.0
"""Seconds that a file may take to be read, however small."""

PACE = 1e6
"""Bytes that are read in a second at the very least: text, on a busy machine, takes a tenth."""

PRELOADED = ("priorfill.formats", "scipy.io")


class Reader:
    """Reads files, in another process where there are many: what is in them cannot end this one.

    One process reads them all. After a crash, a hang, or want of memory there is a new one, and the
    file is one that cannot be read.

    Parameters
    ----------
    files : int
        How many there are to be.
    """

    def __init__(self, files: int) -> None:
        self._apart = files >= FEWEST
        self._worker: Worker | None = None

    def __enter__(self) -> Reader:
        return self

    def __exit__(self, *error: object) -> None:
        if self._worker is not None:
            self._worker.stop()

    def read(self, path: Path, **options: Any) -> Clip:
        """Read a clip as `priorfill.formats.read` does.

        Raises
        ------
        PriorfillError
            As that does; a FormatError also where reading crashes or does not end.
        """
        if not self._apart:
            from priorfill import formats

            return formats.read(path, **options)
        from priorfill.runtime.worker import (
            DONE,
            HANG,
            MEMORY,
            RAISED,
            Worker,
        )

        if self._worker is None:
            self._worker = Worker(read_apart, seconds=PATIENCE, memory=_memory(), preload=PRELOADED)
        size = path.stat().st_size if path.is_file() else 0
        kind, value = self._worker.do((path, options), seconds=PATIENCE + size / PACE)
        if kind == DONE:
            if isinstance(value, Exception):
                raise value
            clip: Clip = value
            return clip
        if kind == MEMORY:
            reason = "needs more memory than there is; cut the recording into parts"
        elif kind == RAISED:
            reason = f"cannot be read: a fault of priorfill itself ({value}); please report it"
        elif kind == HANG:
            reason = f"cannot be read: reading {value} and was ended; export it again"
        else:
            reason = f"cannot be read: the process that read it crashed ({value}); export it again"
        raise FormatError(f"{path}: {reason}")


def with_path(path: Path, error: Exception) -> str:
    """Return an error's message, with the file's path if it does not begin with it."""
    text = " ".join(str(error).split())
    for start in (str(path), path.name, path.stem):
        text = text.removeprefix(f"{start}: ")
    return f"{path}: {text}"


def read_apart(item: tuple[Path, dict[str, Any]]) -> Clip | PriorfillError | OSError:
    """Read a clip, or return why that cannot be done; the task of the other process."""
    from priorfill import formats

    path, options = item
    try:
        return formats.read(path, **options)
    except (PriorfillError, OSError) as error:
        return error


def _memory() -> int:
    """Return the bytes of memory of this machine."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
