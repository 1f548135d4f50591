"""The folder of a study: where outputs, records and the state of the study are.

::

    OUT/P01/walk.c3d                   the filled files, in the folders of the sources
    OUT/P01/walk.c3d.html              a page for each, if wanted
    OUT/P01/walk.c3d.uncertainty.npz   the expected errors of each, if wanted
    OUT/summary.html .csv .json        the summary
    OUT/.priorfill/study.json          marks the folder as that of a study
    OUT/.priorfill/records/P01/walk.c3d.json    the record of a job
    OUT/.priorfill/lock                held while a study runs
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from priorfill.errors import OutputError
from priorfill.runtime.atomic_file import check_writable, replace_file
from priorfill.runtime.file_lock import LockHeldError, acquire_lock

__all__ = ["MARK", "STATE", "StudyFolder"]

STATE = ".priorfill"
"""Folder in the folder of outputs that keeps the state of a study."""

MARK = "study.json"
"""File in it that marks a folder as that of a study."""


@dataclass(frozen=True)
class StudyFolder:
    """The folder of a study.

    Attributes
    ----------
    path : Path
        The folder, absolute.

    Examples
    --------
    >>> StudyFolder(Path("out")).record("P01/walk.c3d").as_posix()
    'out/.priorfill/records/P01/walk.c3d.json'
    """

    path: Path

    @property
    def state(self) -> Path:
        """Folder that keeps the state of the study."""
        return self.path / STATE

    @property
    def records(self) -> Path:
        """Folder of the records."""
        return self.state / "records"

    @property
    def summary(self) -> Path:
        """The page of the summary, where no other is wanted."""
        return self.path / "summary.html"

    def output(self, name: str) -> Path:
        """Return the filled file of a job."""
        return self.path / name

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
        OutputError
            If it is a file, takes no files, or has too little room.
        """
        if self.path.exists() and not self.path.is_dir():
            raise OutputError(f"{self.path}: is a file; give a folder for the filled files")
        check_writable(self.path / MARK, size)

    def mark(self) -> None:
        """Mark the folder as that of a study, so that no other study takes it for sources."""
        mark = self.state / MARK
        if not mark.exists():
            with replace_file(mark, overwrite=True) as temporary:
                temporary.write_text(json.dumps({"version": 1}) + "\n", "utf-8", newline="\n")

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Let one study at a time use the folder.

        Raises
        ------
        OutputError
            If another one does.
        """
        with ExitStack() as stack:
            try:
                lock = acquire_lock(self.state / "lock")
            except LockHeldError as error:
                raise OutputError(
                    f"{self.path}: another study is being filled there ({error.holder}); wait for "
                    "it to end, or choose another folder"
                ) from None
            except OSError as error:
                raise OutputError(
                    f"{self.state / 'lock'}: cannot be written ({error.strerror}); check the "
                    "folder's permissions"
                ) from error
            stack.callback(lock.release)
            yield
