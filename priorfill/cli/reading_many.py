"""Read one of many files so that its failure does not stop the others."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from priorfill.cli.exit_status import EXIT_USAGE
from priorfill.cli.output import print_line
from priorfill.errors import FormatError, PriorfillError

if TYPE_CHECKING:
    from priorfill.clip import Clip

__all__ = ["read_one_of_many", "refuse_missing", "with_path"]


def refuse_missing(reasons: Sequence[str]) -> None:
    """Print why arguments lead to no file, and end with the status of wrong usage if any does.

    Parameters
    ----------
    reasons : sequence of str
        A message for each.
    """
    for reason in reasons:
        print_line(f"priorfill: {reason}", err=True)
    if reasons:
        click.get_current_context().exit(EXIT_USAGE)


def read_one_of_many(path: Path, **options: Any) -> Clip:
    """Read a clip as `priorfill.formats.read` does; every failure to read is a FormatError.

    The file is read in this process. The parsers check what a file claims against its size before
    they use it, so that a damaged file raises an error instead of crashing, hanging or filling the
    memory; what they miss is caught here.

    Raises
    ------
    PriorfillError
        As `priorfill.formats.read` raises it.
    FormatError
        Also if the file needs too much memory or triggers a bug of a parser.
    OSError
        If the file cannot be opened.
    """
    from priorfill import formats

    try:
        return formats.read(path, **options)
    except (PriorfillError, OSError):
        raise
    except MemoryError as error:
        raise FormatError(
            f"{path}: needs more memory than is available; cut the recording into parts"
        ) from error
    except Exception as error:
        raise FormatError(
            f"{path}: cannot be read because of a bug in priorfill "
            f"({type(error).__name__}: {error}); please report it"
        ) from error


def with_path(path: Path, error: Exception | str) -> str:
    """Return an error's message, preceded by the file's path unless it starts with it."""
    text = " ".join(str(error).split())
    for start in (str(path), path.name, path.stem):
        text = text.removeprefix(f"{start}: ")
    return f"{path}: {text}"
