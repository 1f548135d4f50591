"""Answers of a program that are not as its documentation says."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from priorfill.errors import IntegrationError, PriorfillError

__all__ = ["asking"]


@contextmanager
def asking(program: str, what: str) -> Iterator[None]:
    """Turn what goes wrong while a program is asked for something into an IntegrationError.

    Another version of the program, an error in it, or a lost connection raises exceptions of any
    kind, and so does the conversion of an answer of another type or length. Also a decorator.

    Parameters
    ----------
    program : str
        Its name.
    what : str
        What it is asked for.

    Raises
    ------
    IntegrationError
        Where anything but an error of priorfill was raised.

    Examples
    --------
    >>> with asking("Nexus", "the frame rate"):
    ...     float(None)
    Traceback (most recent call last):
    priorfill.errors.IntegrationError: Nexus was asked for the frame rate, and its answer ...
    """
    try:
        yield
    except (PriorfillError, MemoryError):
        raise
    except Exception as error:
        reason = str(error) or type(error).__name__
        raise IntegrationError(
            f"{program} was asked for {what}, and its answer is not as documented ({reason}); "
            f"see whether {program} has the trial open and shows no error, then repeat the command"
        ) from error
