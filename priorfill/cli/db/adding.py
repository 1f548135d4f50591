"""Put files into a database one by one, and say what became of each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from priorfill.cli.batch import Reader, with_path
from priorfill.cli.db.common import count, skipped, total
from priorfill.cli.db.files import find_files
from priorfill.cli.output import some_names
from priorfill.cli.progress import progress
from priorfill.errors import (
    ClipError,
    DatabaseError,
    DuplicateClipError,
    FormatError,
    OptionError,
    PriorfillError,
)

if TYPE_CHECKING:
    from priorfill.clip import Clip
    from priorfill.database import ClipRecord, PriorDatabase

__all__ = ["Target", "put_files", "read_file", "sound"]


class Target:
    """The database that files go to: made or opened when the first of them asks for it.

    So nothing is made where there is nothing to add.

    Parameters
    ----------
    folder : Path
        Its folder.
    reader : Reader
        What reads the files.
    """

    def __init__(self, folder: Path, reader: Reader) -> None:
        self.folder, self.reader = folder, reader
        self._database: PriorDatabase | None = None

    @property
    def is_open(self) -> bool:
        """Whether somebody has asked for it."""
        return self._database is not None

    @property
    def exists(self) -> bool:
        """Whether there is something to look into."""
        return self.is_open or self.folder.exists()

    def open(self) -> PriorDatabase:
        """Return the database, open for writing."""
        from priorfill.database import PriorDatabase

        if self._database is None:
            self._database = PriorDatabase.open_or_create(self.folder)
        return self._database

    def close(self) -> None:
        """Give the database back."""
        if self._database is not None:
            self._database.close()


def put_files(
    folder: Path,
    paths: Sequence[Path],
    put: Callable[[Target, Path], tuple[ClipRecord, str]],
    *,
    done: str,
    doing: str,
    to_do: str,
    suffixes: Sequence[str] | None = None,
) -> None:
    """Put files into a database and print what became of each; exit with 1 if one failed.

    A file that cannot be used is named and the others go on. Where the database itself fails,
    the rest is not tried: it would fail too.

    Parameters
    ----------
    folder : Path
        The database's.
    paths : sequence of Path
        Files, folders and patterns.
    put : callable
        Puts one file in; returns its row and what to print behind the file's name.
    done, doing, to_do : str
        The verb, as in ``added``, ``Adding`` and ``add``.
    suffixes : sequence of str, optional
        Suffixes, lower case, of what to take from folders; by default, recordings are taken.

    Raises
    ------
    DatabaseError
        Where the database cannot be used (any more).
    """
    from priorfill import formats

    if suffixes is None:
        files, failed = find_files(paths, formats.SUFFIXES, formats.recognised)
    else:
        files, failed = find_files(paths, suffixes, lambda path: True)
    for reason in failed:
        click.echo(f"priorfill: {reason}", err=True)
    failures = len(failed)
    records: list[ClipRecord] = []
    duplicates = 0
    reader = Reader(len(files))
    target = Target(folder, reader)
    try:
        with reader, progress(len(files), f"{doing} clips") as show:
            for number, path in enumerate(files):
                show(number, None)
                try:
                    record, text = put(target, path)
                except DuplicateClipError as error:
                    duplicates += 1
                    line = f"skipped {with_path(path, error)}"
                except (FormatError, ClipError, OptionError) as error:
                    failures += 1
                    click.echo(f"priorfill: {with_path(path, error)}", err=True)
                    continue
                except (DatabaseError, OSError) as error:
                    if not target.is_open:
                        raise
                    raise _stopped(
                        target, error, path, f"{count(len(records), 'clip')} {done}"
                    ) from error
                else:
                    records.append(record)
                    line = f"{done} {path}{text}"
                # flushed by click: a line that is out is a clip that is on the disk
                click.echo(line)
    finally:
        target.close()
    click.echo(
        f"{done} {total(records)}{skipped(duplicates)}"
        + (f", could not {to_do} {failures}" if failures else "")
    )
    if failures:
        click.get_current_context().exit(1)


def read_file(reader: Reader, path: Path, subject: str | None, **reading: Any) -> Clip:
    """Read a clip for a database.

    Parameters
    ----------
    reader : Reader
        What reads it.
    path : Path
        The file.
    subject : str or None
        Whose motion it is. Usually the user's own word for the person, whatever the file says; in
        a file of several people it chooses one of them.
    **reading
        The options of `priorfill.cli.reading.file_options`.

    Raises
    ------
    FormatError, ClipError
        Where this file cannot be read.
    PriorfillError
        Where an option makes no sense.
    """
    from priorfill.cli.reading import as_reading

    options = as_reading(**reading)
    try:
        return reader.read(path, **options)
    except OptionError as error:
        # wrong for every file, so not this one's fault
        raise PriorfillError(str(error)) from error
    except ClipError:
        if subject is None:
            raise
        try:
            return reader.read(path, **options, subject=subject)
        except PriorfillError:
            pass  # the first error says more: it names the subjects, or has nothing to do with them
        raise
    except OSError as error:
        if isinstance(error, PriorfillError):
            raise
        raise FormatError(f"{path}: cannot be read ({error.strerror or error})") from error


def sound(clip: Clip) -> tuple[Clip, str]:
    """Return a clip without samples in trouble, and what to print of them behind its name."""
    from priorfill.artefacts import without_artefacts

    cleared, artefacts = without_artefacts(clip)
    lost = int((cleared.missing & ~clip.missing).sum())
    markers = sorted({label for one in artefacts for label in one.markers}, key=clip.labels.index)
    if not lost:
        return clip, ""
    names = some_names(markers, " ")
    return cleared, f", without {lost} samples in trouble of {names} (see: priorfill inspect)"


def _stopped(target: Target, error: Exception, path: Path, before: str) -> DatabaseError:
    """Return an error that says where an unfinished job stands."""
    if isinstance(error, PriorfillError):
        reason = str(error)
    else:
        why = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        reason = f"{target.folder}: cannot be written ({why}); check free space and permissions"
    return DatabaseError(f"{reason}; stopped at {path}, {before} before")
