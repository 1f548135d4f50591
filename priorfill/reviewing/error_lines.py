"""Errors as one line in the words of the page."""

from __future__ import annotations

import re
from collections.abc import Callable

from priorfill.errors import PriorfillError, escaped
from priorfill.reviewing.session import FillStoppedError

__all__ = ["error_line"]

_DECISION = re.compile(r"^overrides: (gaps?) (?=[0-9])")
"""Start of messages on overrides, which the page calls decisions."""


def error_line(error: BaseException, words: Callable[[str], str] = str) -> str:
    """Return an error as one line for the page.

    Parameters
    ----------
    error : BaseException
        What a fill or save raised.
    words : callable
        Replaces arguments in backquotes by what the user knows.

    Examples
    --------
    >>> from priorfill.errors import OptionError
    >>> error_line(OptionError("overrides: gap 2: has no marker; give a label"))
    'decision 2: has no marker; give a label'
    """
    if isinstance(error, FillStoppedError):
        return "the fill was stopped"
    if isinstance(error, PriorfillError):
        return words(_DECISION.sub(_as_decision, str(error)))
    if isinstance(error, MemoryError):
        return "there is not enough memory; use a shorter clip or a smaller database"
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename else ""
        return escaped(f"{where}{error.strerror or error}; check the disk and the folder")
    return escaped(f"bug in priorfill ({type(error).__name__}: {error}); please report it")


def _as_decision(found: re.Match[str]) -> str:
    return "decisions " if found[1] == "gaps" else "decision "
