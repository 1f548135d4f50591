"""The errors that priorfill raises.

::

    PriorfillError
    ├── FormatError (ValueError)         a file that cannot be read as what it claims to be
    ├── ClipError (ValueError)           a clip whose contents make no sense
    │   └── MultipleSubjectsError         a file of several people, of whom none was chosen
    ├── OptionError (ValueError)         an option that is out of range or contradicts another
    ├── MarkerSetError (ValueError)      a marker-set definition that is wrong or unknown
    ├── MethodError (ValueError)         a method that cannot work on a clip
    ├── EvaluationError (RuntimeError)   an evaluation that cannot go on
    ├── OutputError (OSError)            a result that cannot be written where it should go
    ├── FetchError (OSError)             a library that cannot be downloaded, or not as it should be
    └── DatabaseError                    anything about a prior database
        ├── DatabaseNotFoundError (FileNotFoundError)
        ├── DatabaseFormatError (ValueError)   another format version, or not a database
        ├── DatabaseCorruptError (ValueError)  stored data does not match its checksum
        ├── DatabaseLockedError (BlockingIOError)
        └── DuplicateClipError (ValueError)    the database holds a clip of this content already

Every message is one line that says what is wrong, where, and what to do about it. The
command line prints it and exits with status 1.
"""

from __future__ import annotations

from collections.abc import Sequence

__all__ = [
    "ClipError",
    "DatabaseCorruptError",
    "DatabaseError",
    "DatabaseFormatError",
    "DatabaseLockedError",
    "DatabaseNotFoundError",
    "DuplicateClipError",
    "EvaluationError",
    "FetchError",
    "FormatError",
    "MarkerSetError",
    "MethodError",
    "OptionError",
    "OutputError",
    "PriorfillError",
    "MultipleSubjectsError",
]


class PriorfillError(Exception):
    """Root of every error that priorfill raises on purpose."""


class FormatError(PriorfillError, ValueError):
    """A file cannot be read as the format that it claims to be."""


class ClipError(PriorfillError, ValueError):
    """A clip's contents make no sense (no frames, rate 0, infinite coordinates, ...)."""


class MultipleSubjectsError(ClipError):
    """A file holds several people, and none was chosen.

    Parameters
    ----------
    message : str
        What is wrong.
    subjects : sequence of str
        Who is there.
    """

    def __init__(self, message: str, subjects: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.subjects = tuple(subjects)


class OptionError(PriorfillError, ValueError):
    """An option is out of range or contradicts another."""


class MarkerSetError(PriorfillError, ValueError):
    """A marker-set definition is malformed or unknown."""


class MethodError(PriorfillError, ValueError):
    """A method cannot work on a clip; the message says why and what would make it work."""


class EvaluationError(PriorfillError, RuntimeError):
    """An evaluation cannot go on: a process of it was ended from outside."""


class OutputError(PriorfillError, OSError):
    """A result cannot be written where it should go."""


class FetchError(PriorfillError, OSError):
    """A library of recordings cannot be downloaded, or what came is not what it should be."""


class DatabaseError(PriorfillError):
    """Something about a prior database."""


class DatabaseNotFoundError(DatabaseError, FileNotFoundError):
    """There is no database at the path given."""


class DatabaseFormatError(DatabaseError, ValueError):
    """The directory is no database, or one of another format version."""


class DatabaseCorruptError(DatabaseError, ValueError):
    """Stored data does not match its checksum."""


class DatabaseLockedError(DatabaseError, BlockingIOError):
    """Another process is writing to the database."""


class DuplicateClipError(DatabaseError, ValueError):
    """The database holds a clip with the same content already."""
