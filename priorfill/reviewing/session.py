"""The review of a file: fill as decided, decide again, save. It knows nothing of the web."""

from __future__ import annotations

import hashlib
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Unpack

from priorfill import formats
from priorfill.database import PriorDatabase
from priorfill.errors import OptionError, OutputError, SameFileError
from priorfill.filling.bids_derivative import derivative_output
from priorfill.filling.check_overrides import check_overrides
from priorfill.filling.companion_files import write_companions
from priorfill.filling.fill_cache import FillCache
from priorfill.filling.fill_file import FileOptions, FileToFill
from priorfill.filling.fill_options import FillKeywords, FillOptions
from priorfill.filling.further_outputs import FURTHER_OUTPUTS
from priorfill.filling.overrides import Overrides
from priorfill.filling.overrides_file import overrides_text, read_overrides
from priorfill.filling.result import Result
from priorfill.formats.bids.names import dataset_root, derivative_path, filled_name
from priorfill.formats.file_bytes import check_unchanged, source_errors_explained
from priorfill.report.report_data import PageContents, page_data
from priorfill.runtime.atomic_file import check_target, check_writable, is_same_file
from priorfill.runtime.file_pair import file_state, finish_pairs, write_pair

__all__ = [
    "Checkpoint",
    "FillStoppedError",
    "Progress",
    "ReviewSession",
    "SavedReview",
    "default_output",
    "default_overrides",
]

Progress = Callable[[int, int], None]
"""Called with the number of gap groups done and of all."""

Checkpoint = Callable[[], None]
"""Called often; raises `FillStoppedError` to stop a fill."""

_OTHER_OUTPUTS = (*(kind.name for kind in FURTHER_OUTPUTS), "add_to_database", "program")
"""Fields of `FileOptions` for outputs that a review does not write."""


class FillStoppedError(Exception):
    """Raised by a checkpoint to stop a fill."""


@dataclass(frozen=True)
class SavedReview:
    """What a review saved last.

    Attributes
    ----------
    output, overrides : Path
        The filled file, and the decisions as a file of overrides.
    complete : bool
        Whether everything requested was filled.

    Examples
    --------
    >>> SavedReview(Path("a.c3d"), Path("a.overrides.toml"), complete=True).complete
    True

    See Also
    --------
    priorfill.review : Review the fill of a file.
    """

    output: Path
    overrides: Path
    complete: bool


def default_output(source: Path) -> Path:
    """Return where the filled file is saved if nothing else is given.

    Parameters
    ----------
    source : Path
        The file with gaps. In a BIDS dataset, the filled one is in a derivative dataset.

    Examples
    --------
    >>> default_output(Path("walk.c3d")).name
    'walk_filled.c3d'
    """
    if filled_name(source.name) != source.name:
        root = dataset_root(source)
        if root is None:
            return source.with_name(filled_name(source.name))
        return derivative_path(source, root / "derivatives" / "priorfill")
    return source.with_name(f"{source.stem}_filled{source.suffix}")


def default_overrides(output: Path) -> Path:
    """Return where decisions are saved if nothing else is given.

    Parameters
    ----------
    output : Path
        The filled file.

    Examples
    --------
    >>> default_overrides(Path("walk_filled.c3d")).name
    'walk_filled.overrides.toml'
    """
    return output.with_name(f"{output.stem}.overrides.toml")


class ReviewSession:
    """A file under review. One thread at a time may call its methods.

    Parameters
    ----------
    source : Path or str
        The file with gaps.
    output : Path or str, optional
        The file to save; next to the source by default.
    database, same_subject, files, **arguments
        As for `priorfill.fill_file`, but for ``overrides``: the path of the file of overrides to
        save, next to the output by default. If it exists, the review begins with its decisions.

    Raises
    ------
    PriorfillError
        As `priorfill.fill_file` does, before anything is filled.
    """

    def __init__(
        self,
        source: Path | str,
        output: Path | str | None = None,
        *,
        database: Path | str | None = None,
        same_subject: Sequence[Path | str] = (),
        files: FileOptions | None = None,
        **arguments: Unpack[FillKeywords],
    ) -> None:
        self.source = Path(source)
        self.output = default_output(self.source)
        if output is not None:
            self.output = derivative_output(self.source, Path(str(output)))
        overrides = arguments.pop("overrides", None)
        given = isinstance(overrides, (str, Path))
        self.overrides = Path(str(overrides)) if given else default_overrides(self.output)
        self.command: tuple[str, ...] = ()
        self.saved: SavedReview | None = None
        self._files = files or FileOptions()
        self._saving = threading.Lock()
        self._cache = FillCache()
        self._ours: dict[Path, list[int] | None] = {}
        self._check_outputs()
        if not isinstance(overrides, Overrides):
            exists = self.overrides.exists()
            overrides = read_overrides(self.overrides) if exists else Overrides(())
        self.decisions = overrides.to_entries()
        self._saved_entries = self.decisions if self.overrides.exists() else []
        self._work = FileToFill.read(
            self.source,
            self.output,
            database=database,
            same_subject=same_subject,
            files=self._files,
            **arguments,
        )
        self._database_clips = _clip_names(self._work.database)
        self._filled: tuple[Overrides, Result] | None = None
        self.data: dict[str, Any] = {}

    def check(self, decisions: Sequence[Mapping[str, Any]]) -> Overrides:
        """Return decisions as overrides.

        Parameters
        ----------
        decisions : sequence of mapping
            With the keys of a file of overrides.

        Raises
        ------
        OptionError
            Where a decision is wrong, or does not fit the file.
        """
        overrides = Overrides.from_entries(decisions)
        check_overrides(
            overrides,
            self._work.clips,
            method=self._work.arguments.get("method", "auto"),
            database_clips=None if self._work.database is None else self._database_clips,
            same_subject=bool(self._work.same_subject),
        )
        return overrides

    def fill(
        self,
        decisions: Sequence[Mapping[str, Any]],
        progress: Progress | None = None,
        checkpoint: Checkpoint | None = None,
    ) -> dict[str, Any]:
        """Fill the file as decided; return what the page shows of it.

        Parameters
        ----------
        decisions : sequence of mapping
            With the keys of a file of overrides.
        progress : callable, optional
            Called with the number of gap groups done and of all.
        checkpoint : callable, optional
            Called often, also from threads. What it raises stops the fill, and the session stays
            as it was.

        Raises
        ------
        PriorfillError
            Where a decision is wrong, or a method or the database cannot be used.
        """
        overrides = self.check(decisions)
        self._fill(overrides, progress, checkpoint)
        return self.data

    def save(
        self,
        decisions: Sequence[Mapping[str, Any]],
        progress: Progress | None = None,
        checkpoint: Checkpoint | None = None,
    ) -> SavedReview:
        """Write the filled file and the decisions: both or neither.

        Parameters
        ----------
        decisions, progress, checkpoint
            As for `fill`, which is called if these are not the decisions of the last fill.

        Raises
        ------
        OutputError
            Where a file cannot be written, or the source has changed since it was read.
        """
        overrides = self.check(decisions)
        if self._filled is None or not _same_values(self._filled[0], overrides):
            self._fill(overrides, progress, checkpoint)
        assert self._filled is not None
        result = self._filled[1]
        with self._saving:
            self._check_source()
            decided = replace(overrides, made_for=result.provenance.made_for)
            replacing = self._may_replace()
            with write_companions(self.output, result, overwrite=replacing):
                write_pair(
                    self.output,
                    lambda path: formats.write(
                        path, result.clip, result.filled, rewrite=self._files.rewrite
                    ),
                    self.overrides,
                    overrides_text(decided).encode(),
                    overwrite=replacing,
                )
            self._ours = {path: file_state(path) for path in (self.output, self.overrides)}
            self._saved_entries = overrides.to_entries()
            self.data |= {"decisions": self._saved_entries, "unsaved": False}
            self.saved = SavedReview(self.output, self.overrides, result.complete)
        return self.saved

    def finish(self, seconds: float) -> None:
        """Wait for files that are being written.

        Parameters
        ----------
        seconds : float
            How long at most.
        """
        if self._saving.acquire(timeout=seconds):
            self._saving.release()

    def _fill(
        self, overrides: Overrides, progress: Progress | None, checkpoint: Checkpoint | None
    ) -> None:
        """Fill, and keep the result."""
        arguments = self._work.arguments.copy()
        options = arguments.get("options") or FillOptions()
        arguments["options"] = replace(
            options, progress=progress, checkpoint=checkpoint, cache=self._cache
        )
        arguments["overrides"] = overrides if overrides.entries else None
        result = replace(self._work, arguments=arguments).fill()
        contents = PageContents(
            before=self._work.clips,
            review=True,
            decisions=overrides.to_entries(),
            database_clips=self._database_clips,
        )
        data = page_data(result, contents)
        data["unsaved"] = data["decisions"] != self._saved_entries
        data["saves"] = {"output": str(self.output), "overrides": str(self.overrides)}
        if self.command:
            data["command"] = list(self.command)
        self._filled, self.data = (overrides, result), data

    def _check_outputs(self) -> None:
        """Raise an error for what would prevent saving."""
        for name in _OTHER_OUTPUTS:
            if getattr(self._files, name):
                raise OptionError(f"a review writes no such output; leave `{name}` out")
        known = formats.format_of(self.source) if self.source.is_file() else None
        if known != "bids" and formats.output_format(self.output, known) == "bids":
            raise OptionError(
                f"{self.output}: a review saves only a Motion-BIDS file as one; fill "
                f"{self.source.name} into a new one, and review that"
            )
        finish_pairs(self.output.parent)
        target = check_target(self.overrides, overwrite=self._files.overwrite, source=self.source)
        if is_same_file(target, Path(os.path.realpath(self.output))):
            raise SameFileError(
                f"{self.output}: is the file for the decisions, too; choose another"
            )
        check_writable(self.overrides, 0)

    def _check_source(self) -> None:
        """Raise OutputError if the source has changed since it was read."""
        known = self._work.clips[0].source
        if known is not None:
            with source_errors_explained(self.source):
                digest = hashlib.sha256(self.source.read_bytes()).hexdigest()
            check_unchanged(self.source, digest, known.sha256)
            check_target(self.output, overwrite=True, source=self.source)
            check_target(self.overrides, overwrite=True, source=self.source)

    def _may_replace(self) -> bool:
        """Return whether existing files may be replaced: those of this review, or all."""
        if self._files.overwrite:
            return True
        for path, state in self._ours.items():
            if file_state(path) not in (None, state):
                raise OutputError(
                    f"{path}: was changed after it was saved; move it elsewhere, and save again"
                )
        return bool(self._ours)


def _clip_names(database: Path | str | None) -> tuple[str, ...]:
    """Return the names of the clips of a database."""
    if database is None:
        return ()
    with PriorDatabase.open(database) as opened:
        return tuple(dict.fromkeys(record.name for record in opened.clips()))


def _same_values(one: Overrides, other: Overrides) -> bool:
    """Return whether two lists of overrides differ in notes at most."""
    pairs = [[replace(entry, note="") for entry in each.entries] for each in (one, other)]
    return pairs[0] == pairs[1]
