"""Text of files made safe for terminals and spreadsheets."""

from __future__ import annotations

import unicodedata

__all__ = ["csv_cell", "escaped", "escaped_lines"]

_HIDDEN = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})
"""Unicode categories without a glyph: control characters (C0, DEL, C1), format characters
(bidirectional controls, zero-width characters, tags), lone surrogates (bytes of a file name that is
not UTF-8), line and paragraph separators."""

_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r", "\n")
"""First characters by which spreadsheets take a cell for a formula (OWASP, CSV Injection)."""


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
    csv_cell : A text as a cell of a CSV file.
    """
    if text.isprintable():
        return text
    return "".join(
        character.encode("unicode_escape", "surrogatepass").decode("ascii")
        if unicodedata.category(character) in _HIDDEN
        else character
        for character in text
    )


def escaped_lines(text: str) -> str:
    """Return a text of several lines, each of them escaped."""
    return "\n".join(escaped(line) for line in text.split("\n"))


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
