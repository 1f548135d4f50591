"""Put files into a database one by one, and report the result of each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from priorfill.cli.db.common import count, skipped, total
from priorfill.cli.db.files import find_files
from priorfill.cli.option_names import with_options
from priorfill.cli.output import print_line, some_names
from priorfill.cli.progress import progress
from priorfill.cli.reading_many import read_one_of_many, refuse_missing, with_path
from priorfill.errors import (
    ClipError,
    DatabaseError,
    DuplicateClipError,
    FormatError,
    MissingFileError,
    OptionError,
    PriorfillError,
)

if TYPE_CHECKING:
    from priorfill.clip import Clip
    from priorfill.database import ClipOrigin, ClipRecord, PriorDatabase

__all__ = ["ADD", "Target", "Verb", "put_files", "read_file", "without_artefacts"]


@dataclass(frozen=True)
class Verb:
    """Forms of the verb that describes what is done with files."""

    infinitive: str
    participle: str
    gerund: str


ADD = Verb("add", "added", "Adding")


class Target:
    """The database that files go to, opened or created when the first of them needs it.

    Nothing is created if there is nothing to add.

    Parameters
    ----------
    folder : Path
        Its folder.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.no_names: Counter[str] = Counter()  # subjects of files that are no names
        self._database: PriorDatabase | None = None

    @property
    def is_open(self) -> bool:
        """Whether the database has been opened."""
        return self._database is not None

    @property
    def exists(self) -> bool:
        """Whether there is a database, or a folder that may be one."""
        return self.is_open or self.folder.exists()

    def open(self) -> PriorDatabase:
        """Return the database, open for writing."""
        from priorfill.database import PriorDatabase

        if self._database is None:
            self.folder.parent.mkdir(parents=True, exist_ok=True)
            self._database = PriorDatabase.open_or_create(self.folder)
        return self._database

    def add(self, clip: Clip, origin: ClipOrigin) -> ClipRecord:
        """Add a clip; count its subject in `no_names` if it is none."""
        record = self.open().add(clip, origin)
        if origin.subject is None and clip.subject and not record.subject:
            self.no_names[clip.subject] += 1
        return record

    def print_no_names(self) -> None:
        """Print a note on subjects of files that are no names."""
        if self.no_names:
            print_line(
                f"note: {some_names(sorted(self.no_names), ', ')} is no name of a subject; "
                f"{count(self.no_names.total(), 'clip')} added without one. Name the subject "
                "(--subject, or: priorfill db edit)",
                err=True,
            )

    def close(self) -> None:
        """Close the database."""
        if self._database is not None:
            self._database.close()


def put_files(
    folder: Path,
    paths: Sequence[Path],
    put: Callable[[Target, Path], tuple[ClipRecord, str]],
    verb: Verb,
    *,
    suffixes: Sequence[str] | None = None,
    verbose: bool = False,
) -> None:
    """Put files into a database and print how many; exit with 1 if one failed.

    A file that cannot be used is named, and the others are processed. If the database itself
    fails, the rest is not tried, as it would fail too. Where a path leads to nothing, all of those
    are named, nothing is done, and the exit status is 2.

    Parameters
    ----------
    folder : Path
        The database's folder.
    paths : sequence of Path
        Files, folders and patterns.
    put : callable
        Puts one file in; returns its record and text to print after the file's name.
    verb : Verb
        What `put` does.
    suffixes : sequence of str, optional
        Lower-case suffixes of the files taken from folders; by default, recordings are taken.
    verbose : bool
        Whether to print a line for each file.

    Raises
    ------
    DatabaseError
        If the database cannot be used.
    """
    from priorfill import formats

    if suffixes is None:
        found = find_files(paths, formats.SUFFIXES, formats.is_recording)
    else:
        found = find_files(paths, suffixes, lambda path: True)
    refuse_missing(found.missing)
    for reason in found.failed:
        print_line(f"priorfill: {reason}", err=True)
    files, failures = found.files, len(found.failed)
    records: list[ClipRecord] = []
    duplicates = partial = 0
    target = Target(folder)
    try:
        with progress(len(files), f"{verb.gerund} clips") as show:
            for number, path in enumerate(files):
                show(number, None)
                try:
                    record, text = put(target, path)
                except DuplicateClipError as error:
                    duplicates += 1
                    line = f"skipped {with_path(path, error)}"
                except (FormatError, ClipError, OptionError) as error:
                    failures += 1
                    print_line(f"priorfill: {with_path(path, error)}", err=True)
                    continue
                except (DatabaseError, OSError) as error:
                    if not target.is_open:
                        raise
                    done = f"{count(len(records), 'clip')} {verb.participle}"
                    raise _stopped(target, error, path, done) from error
                else:
                    records.append(record)
                    partial += bool(text)
                    line = f"{verb.participle} {path}{text}"
                if verbose:  # click flushes: once the line is out, the clip is on the disk
                    print_line(line)
    finally:
        target.close()
    print_line(
        f"{verb.participle} {total(records)}"
        + (f" ({partial} of them in part: see --verbose)" if partial and not verbose else "")
        + skipped(duplicates)
        + (f", could not {verb.infinitive} {failures}" if failures else "")
    )
    target.print_no_names()
    if failures:
        click.get_current_context().exit(1)


def read_file(path: Path, subject: str | None, **reading: Any) -> Clip:
    """Read a clip for a database.

    Parameters
    ----------
    path : Path
        The file.
    subject : str or None
        The subject under a name of the user's choice; in a file of several subjects it selects one
        of them.
    **reading
        The options of `priorfill.cli.reading.file_options`.

    Raises
    ------
    FormatError, ClipError
        If this file cannot be read.
    click.UsageError
        If an option is invalid.
    """
    from priorfill.cli.reading import as_reading

    options = as_reading(**reading)
    try:
        return read_one_of_many(path, **options)
    except MissingFileError as error:  # was there when the command began
        raise FormatError(str(error)) from error
    except OptionError as error:
        # wrong for every file, so it is not this file's fault
        raise click.UsageError(with_options(str(error))) from error
    except ClipError:
        if subject is None:
            raise
        try:
            return read_one_of_many(path, **options, subject=subject)
        except PriorfillError:
            pass  # the first error is more helpful: it names the subjects, or is unrelated to them
        raise
    except OSError as error:
        if isinstance(error, PriorfillError):
            raise
        raise FormatError(f"{path}: cannot be read ({error.strerror or error})") from error


def without_artefacts(clip: Clip) -> tuple[Clip, str]:
    """Return a clip without artefacts, and text about them to print after its name."""
    from priorfill import artefacts

    cleared, found = artefacts.without_artefacts(clip)
    lost = int((cleared.missing & ~clip.missing).sum())
    markers = sorted({label for one in found for label in one.markers}, key=clip.labels.index)
    if not lost:
        return clip, ""
    names = some_names(markers, " ")
    samples = count(lost, "sample")
    return cleared, f", without {samples} of {names} that are artefacts (see: priorfill inspect)"


def _stopped(target: Target, error: Exception, path: Path, done: str) -> DatabaseError:
    """Return an error that states how far an unfinished command got."""
    if isinstance(error, PriorfillError):
        reason = str(error)
    else:
        why = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        reason = f"{target.folder}: cannot be written ({why}); check free space and permissions"
    return DatabaseError(f"{reason}; stopped at {path}, {done} before")
