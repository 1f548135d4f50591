"""Text of files made safe for terminals and spreadsheets."""

from __future__ import annotations

from priorfill.errors import escaped

__all__ = ["csv_cell", "escaped"]

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
