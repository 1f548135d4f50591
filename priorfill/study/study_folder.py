"""The folder of a study: where outputs, records and the state of the study are.

::

    OUT/P01/walk.c3d                   the filled files, in the folders of the sources
    OUT/P01/walk.c3d.html              a page for each, if wanted
    OUT/P01/walk.c3d.uncertainty.npz   the expected errors of each, if wanted
    OUT/summary.html .csv .json        the summary
    OUT/.priorfill/study.json          marks the folder as that of a study
    OUT/.priorfill/records/P01/walk.c3d.json    the record of a job
    OUT/.priorfill/survey.json         facts of the sources
    OUT/.priorfill/growth.json         rounds of a study whose database grows
    OUT/.priorfill/lock                held while a study runs
"""

from __future__ import annotations

import errno
import json
import os
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from priorfill.errors import OptionError, OutputError
from priorfill.formats.bids.names import filled_name
from priorfill.runtime.atomic_file import check_writable, replace_file
from priorfill.runtime.file_lock import LockHeldError, acquire_lock

if TYPE_CHECKING:
    from filelock import BaseFileLock

__all__ = ["MARK", "STATE", "StudyFolder"]

STATE = ".priorfill"
"""Folder in the folder of outputs that keeps the state of a study."""

MARK = "study.json"
"""File in it that marks a folder as that of a study."""

LOCK = "lock"
"""File in it that is locked while a study runs; tasks of an array have their own."""

_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP)
"""Errors of file systems without locks."""

_WAIT_SECONDS = 3.0
"""Time (s) in which a lock that others hold only to look at it is free again."""

_PAUSE_SECONDS = 0.05
"""Time (s) between two looks at a lock."""


@dataclass(frozen=True)
class StudyFolder:
    """The folder of a study.

    Attributes
    ----------
    path : Path
        The folder, absolute.
    suffix : str
        Suffix of the filled files; by default that of the sources.

    Examples
    --------
    >>> StudyFolder(Path("out")).record("P01/walk.c3d").as_posix()
    'out/.priorfill/records/P01/walk.c3d.json'
    """

    path: Path
    suffix: str = ""

    @classmethod
    def at(cls, path: Path | str, suffix: str = "") -> StudyFolder:
        """Return the folder at a path, which may be relative."""
        return cls(Path(os.path.abspath(path)), suffix)  # noqa: PTH100, does not resolve links

    @property
    def state(self) -> Path:
        """Folder that keeps the state of the study."""
        return self.path / STATE

    @property
    def records(self) -> Path:
        """Folder of the records."""
        return self.state / "records"

    @property
    def survey(self) -> Path:
        """What a survey found."""
        return self.state / "survey.json"

    @property
    def growth(self) -> Path:
        """The rounds of a study whose database grows."""
        return self.state / "growth.json"

    @property
    def summary(self) -> Path:
        """The page of the summary, where no other is wanted."""
        return self.path / "summary.html"

    def output(self, name: str) -> Path:
        """Return the filled file of a job; of a recording of BIDS it is named as a derivative."""
        place = self.path / name
        if self.suffix:
            return place.with_suffix(self.suffix)
        return place.with_name(filled_name(place.name))

    def record(self, name: str) -> Path:
        """Return the record of a job."""
        return self.records / f"{name}.json"

    def report(self, name: str) -> Path:
        """Return the page of a job."""
        return self.path / f"{name}.html"

    def uncertainty(self, name: str) -> Path:
        """Return the file of the expected errors of a job."""
        return self.path / f"{name}.uncertainty.npz"

    def check(self, size: int) -> None:
        """Check that the folder takes files.

        Parameters
        ----------
        size : int
            Bytes that the study may write.

        Raises
        ------
        OptionError
            If it is a file.
        OutputError
            If it takes no files, or has too little room.
        """
        if self.path.exists() and not self.path.is_dir():
            raise OptionError(f"{self.path}: is a file; give a folder for the filled files")
        check_writable(self.state, size)

    def mark(self) -> None:
        """Mark the folder as that of a study, so that no other study takes it for sources."""
        mark = self.state / MARK
        if not mark.exists():
            with replace_file(mark, overwrite=True) as temporary:
                text = json.dumps({"version": 1})
                temporary.write_text(text + "\n", encoding="utf-8", newline="\n")

    @contextmanager
    def locked(self, task: int | None = None) -> Iterator[None]:
        """Let one study at a time use the folder, or the tasks of an array.

        Where the file system has no locks, nothing is locked: two studies at once fill files
        twice, to the same bytes.

        Parameters
        ----------
        task : int, optional
            Number of the task.

        Raises
        ------
        OutputError
            If another study, or the same task, uses it.
        """
        own = self.state / (LOCK if task is None else f"{LOCK}-{task}")
        others = [self.state / LOCK] if task is not None else [*self.state.glob(f"{LOCK}-*")]
        with ExitStack() as stack:
            for place in (*others, own):
                lock = self._acquired(place, _WAIT_SECONDS if place is not own else 0.0)
                if lock is None:
                    continue
                if place is own:
                    stack.callback(lock.release)
                else:
                    lock.release()
            yield

    def _acquired(self, place: Path, seconds: float) -> BaseFileLock | None:
        """Return a lock; None where the file system has none."""
        deadline = time.monotonic() + seconds
        while True:
            try:
                return acquire_lock(place)
            except LockHeldError as error:
                if time.monotonic() > deadline:
                    raise OutputError(
                        f"{self.path}: another process fills a study there ({error.holder}); wait "
                        "for its end, or choose another folder"
                    ) from None
            except OSError as error:
                if error.errno in _NO_LOCKS:
                    return None
                raise OutputError(
                    f"{place}: cannot be written ({error.strerror}); check the folder's permissions"
                ) from error
            time.sleep(_PAUSE_SECONDS)
