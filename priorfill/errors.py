"""The errors that priorfill raises.

::

    PriorfillError
    ├── FormatError (ValueError)          a file cannot be read in the format it appears to have
    │   └── MissingFileError (OptionError, FileNotFoundError)   there is no file of that name
    ├── ClipError (ValueError)            the contents of a clip are unusable
    │   ├── MultipleSubjectsError         a file holds several subjects, and none is chosen
    │   └── MarkerNotFoundError (KeyError)      a clip has no marker of that label
    ├── OptionError (ValueError)          an option is out of range or contradicts another
    │   ├── ArgumentTypeError (TypeError)       an argument is of another type than is needed
    │   └── MarkerSetError                a marker-set definition is malformed
    ├── MethodError (ValueError)          a method is not applicable to a clip
    ├── EvaluationError (RuntimeError)    an evaluation cannot continue
    ├── StudyError (ValueError)           a study cannot begin, for one or several reasons
    ├── OutputError (OSError)             a result cannot be written to its destination
    │   └── SameFileError (OptionError)         it is a file that is read, or another result's
    │       └── SourceAsOutputError             the destination is the file that is read
    ├── IntegrationError (RuntimeError)   a program that has a trial open cannot be used
    ├── FetchError (OSError)              a data set cannot be downloaded, or is not as expected
    │   └── DatasetDefinitionError (OptionError)    the definition of a data set is malformed
    └── DatabaseError                     a problem with a prior database
        ├── DatabaseNotFoundError (FileNotFoundError)
        ├── DatabaseStateError (FileNotFoundError)
        ├── DatabaseFormatError (ValueError)    unknown format version, or not a database
        ├── DatabaseCorruptError (ValueError)   stored data does not match its checksum
        ├── DatabaseLockedError (BlockingIOError)
        └── DuplicateClipError (ValueError)     the database already holds a clip with this content

Every message is one line that states what is wrong, where, and what to do, with control characters
as escape sequences. The command line prints the message and exits with status 2 for an
`OptionError` or a `DatabaseNotFoundError` (the command itself is wrong), and 1 for others.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence

__all__ = [
    "ArgumentTypeError",
    "ClipError",
    "DatabaseCorruptError",
    "DatabaseError",
    "DatabaseFormatError",
    "DatabaseLockedError",
    "DatabaseNotFoundError",
    "DatabaseStateError",
    "DatasetDefinitionError",
    "DuplicateClipError",
    "EvaluationError",
    "FetchError",
    "FormatError",
    "IntegrationError",
    "MarkerNotFoundError",
    "MarkerSetError",
    "MethodError",
    "MissingFileError",
    "MultipleSubjectsError",
    "OptionError",
    "OutputError",
    "PriorfillError",
    "SameFileError",
    "SourceAsOutputError",
    "StudyError",
    "escaped",
]

MAX_MESSAGE = 2000
"""Maximum number of characters of a message; what a file contains can be any length, and is cut."""

_HIDDEN = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})
"""Unicode categories without a glyph: control characters (C0, DEL, C1), format characters
(bidirectional controls, zero-width characters, tags), lone surrogates (bytes of a file name that is
not UTF-8), line and paragraph separators."""


def escaped(text: str) -> str:
    r"""Return a text in one line in which control and format characters are visible.

    Labels, file names and messages can hold characters that move the cursor of a terminal, change
    its title, or reorder what is seen. Each is replaced by its escape sequence in Python's
    notation; letters of all scripts stay.

    Parameters
    ----------
    text : str
        The text.

    Returns
    -------
    str
        The text with control characters, format characters, line separators and lone surrogates as
        ``\xHH``, ``\uHHHH`` or ``\UHHHHHHHH`` (``\t``, ``\n`` and ``\r`` for these three).

    Examples
    --------
    >>> print(escaped("LKNE" + chr(27) + "[31m"))
    LKNE\x1b[31m

    See Also
    --------
    priorfill.runtime.display.csv_cell : A text as a cell of a CSV file.
    """
    if text.isprintable():
        return text
    return "".join(
        character.encode("unicode_escape", "surrogatepass").decode("ascii")
        if unicodedata.category(character) in _HIDDEN
        else character
        for character in text
    )


class PriorfillError(Exception):
    """Base class of all errors that priorfill raises deliberately.

    Examples
    --------
    >>> import priorfill as pf
    >>> try:
    ...     pf.read("no_such_file.c3d")
    ... except pf.PriorfillError as error:
    ...     print(error)
    no_such_file.c3d: there is no such file; check the name

    See Also
    --------
    priorfill.errors : The tree of errors.
    """

    def __str__(self) -> str:
        """Return the message in one line, whatever the file it quotes contains."""
        return _one_line(super().__str__())


def _one_line(message: str) -> str:
    text = escaped(message)
    half = MAX_MESSAGE // 2
    return text if len(text) <= MAX_MESSAGE else f"{text[:half]} ... {text[-half:]}"


class FormatError(PriorfillError, ValueError):
    """A file cannot be read in the format that it appears to have."""


class ClipError(PriorfillError, ValueError):
    """The contents of a clip are unusable (no frames, rate 0, infinite coordinates, ...)."""


class MultipleSubjectsError(ClipError):
    """A file holds several subjects, and none is chosen.

    Parameters
    ----------
    message : str
        The message.
    subjects : sequence of str
        Names of the subjects in the file.
    """

    def __init__(self, message: str, subjects: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.subjects = tuple(subjects)


class MarkerNotFoundError(ClipError, KeyError):
    """A clip has no marker of that label."""

    def __str__(self) -> str:
        """Return the message, without the quotes that a KeyError puts around it."""
        return _one_line(str(self.args[0]))


class OptionError(PriorfillError, ValueError):
    """An option is out of range or contradicts another."""


class ArgumentTypeError(OptionError, TypeError):
    """An argument is of another type than is needed, such as a path in place of a clip."""


class MissingFileError(FormatError, OptionError, FileNotFoundError):
    """There is no file of the name that was given."""


class MarkerSetError(OptionError):
    """A marker-set definition is malformed."""


class MethodError(PriorfillError, ValueError):
    """A method is not applicable to a clip; the message states why, and a remedy."""


class EvaluationError(PriorfillError, RuntimeError):
    """An evaluation cannot continue, because one of its processes was terminated from outside."""


class StudyError(PriorfillError, ValueError):
    """A study cannot begin.

    Attributes
    ----------
    problems : tuple of PriorfillError
        All reasons; the message names the first.
    """

    def __init__(self, problems: Sequence[PriorfillError]) -> None:
        more = f" (and {len(problems) - 1} more problems)" if len(problems) > 1 else ""
        super().__init__(f"{problems[0]}{more}")
        self.problems = tuple(problems)


class OutputError(PriorfillError, OSError):
    """A result cannot be written to its destination."""


class SameFileError(OutputError, OptionError):
    """The destination of a result is a file that is read, or that of another result."""


class SourceAsOutputError(SameFileError):
    """The destination of a result is the file that is read."""


class IntegrationError(PriorfillError, RuntimeError):
    """A program that has a trial open cannot be reached, or does not do what is documented."""


class FetchError(PriorfillError, OSError):
    """A data set cannot be downloaded, or its contents are not as expected."""


class DatasetDefinitionError(FetchError, OptionError):
    """The definition of a data set is malformed."""


class DatabaseError(PriorfillError):
    """Base class of errors about a prior database."""


class DatabaseNotFoundError(DatabaseError, FileNotFoundError):
    """There is no database at the given path."""


class DatabaseStateError(DatabaseError, FileNotFoundError):
    """A database does not have an earlier state any more."""


class DatabaseFormatError(DatabaseError, ValueError):
    """The directory is not a database, or has an unknown format version."""


class DatabaseCorruptError(DatabaseError, ValueError):
    """Stored data does not match its checksum."""


class DatabaseLockedError(DatabaseError, BlockingIOError):
    """Another process is writing to the database."""


class DuplicateClipError(DatabaseError, ValueError):
    """The database already holds a clip with the same content."""
