"""Text of files made safe for terminals and spreadsheets."""

from __future__ import annotations

import os
from collections.abc import Iterable

from priorfill.errors import escaped

__all__ = ["csv_cell", "escaped", "shell_command"]

_DIVIDING = frozenset(" \t&()^;,=@{}'%$`#|<>\u2018\u2019\u201a\u201b")
"""Characters at which cmd or PowerShell divides an argument, or which they interpret, unless the
argument is in double quotes; for PowerShell, typographic quotes are quotes. Within double quotes,
cmd still replaces %NAME% and PowerShell $NAME."""

_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r", "\n")
"""First characters by which spreadsheets take a cell for a formula (OWASP, CSV Injection)."""


def csv_cell(text: str) -> str:
    r"""Return a text as the contents of a CSV cell that no spreadsheet evaluates.

    Parameters
    ----------
    text : str
        The text, not a number.

    Returns
    -------
    str
        The escaped text, after an apostrophe if it would be taken for a formula.

    Examples
    --------
    >>> csv_cell("=1+1")
    "'=1+1"

    See Also
    --------
    escaped : A text made safe for a terminal.
    """
    cell = escaped(text)
    return f"'{cell}" if text.lstrip(" ").startswith(_FORMULA_STARTS) else cell


def shell_command(words: Iterable[object], *, windows: bool = os.name == "nt") -> str:
    """Return a command as a user can paste it into a shell.

    Parameters
    ----------
    words : iterable of str or Path
        The program and its arguments.
    windows : bool
        Quote for the shells of Windows, where only double quotes are understood by all.

    Returns
    -------
    str
        The command, with quotes where they are needed.

    Examples
    --------
    >>> shell_command(["priorfill", "inspect", "my walk.c3d"], windows=True)
    'priorfill inspect "my walk.c3d"'

    See Also
    --------
    escaped : A text made safe for a terminal.
    """
    texts = [str(word) for word in words]
    if not windows:
        import shlex

        return shlex.join(texts)
    return " ".join(_in_double_quotes(text) for text in texts)


def _in_double_quotes(text: str) -> str:
    """Return an argument in double quotes where it needs them."""
    if text and not _DIVIDING & set(text):
        return text
    # backslashes before a quotation mark would make it part of the argument
    return f'"{text}{chr(92) * (len(text) - len(text.rstrip(chr(92))))}"'
