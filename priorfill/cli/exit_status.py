"""Exit statuses of the command line, and which errors have which."""

from __future__ import annotations

from priorfill.cli.system import TerminatedError
from priorfill.errors import DatabaseNotFoundError, OptionError

__all__ = [
    "EXIT_BROKEN_PIPE",
    "EXIT_FAILED",
    "EXIT_INCOMPLETE",
    "EXIT_INTERRUPTED",
    "EXIT_USAGE",
    "exit_status",
    "is_usage_error",
]

EXIT_FAILED = 1
EXIT_USAGE = 2  # as click has it
EXIT_INCOMPLETE = 3  # done, but not all that was asked for could be
EXIT_INTERRUPTED = 130  # 128 + SIGINT, as in shells
EXIT_BROKEN_PIPE = 141  # 128 + SIGPIPE, also where there is no such signal


def is_usage_error(error: BaseException) -> bool:
    """Return whether the command itself is wrong, whatever its files hold.

    That is an option, an argument, the name of a file or database that is not there, or a file of
    settings that is malformed. What the contents of recordings and databases, or the disk, do not
    allow is none.

    Parameters
    ----------
    error : BaseException
        What ended the command.
    """
    return isinstance(error, (OptionError, DatabaseNotFoundError))


def exit_status(error: BaseException) -> int:
    """Return the exit status of an error.

    Parameters
    ----------
    error : BaseException
        What ended the command.
    """
    if isinstance(error, TerminatedError):
        return error.exit_status
    if isinstance(error, KeyboardInterrupt):
        return EXIT_INTERRUPTED
    return EXIT_USAGE if is_usage_error(error) else EXIT_FAILED
