"""Characters that the encoding of the output lacks, such as those of a Windows code page."""

from __future__ import annotations

import codecs
import io
import sys
from typing import Any

__all__ = ["encodable", "replace_what_is_lacking"]

_REPLACEMENTS = {
    "\N{DEGREE SIGN}": "deg",
    "\N{SUPERSCRIPT TWO}": "^2",
    "\N{PLUS-MINUS SIGN}": "+-",
    "\N{MULTIPLICATION SIGN}": "x",
    "\N{MINUS SIGN}": "-",
    "\N{EN DASH}": "-",
    "\N{EM DASH}": "-",
    "\N{HORIZONTAL ELLIPSIS}": "...",
    "\N{LESS-THAN OR EQUAL TO}": "<=",
    "\N{GREATER-THAN OR EQUAL TO}": ">=",
    "\N{MICRO SIGN}": "u",
    "\N{GREEK SMALL LETTER MU}": "u",
    "\N{GREEK SMALL LETTER SIGMA}": "sigma",
    "\N{LEFT SINGLE QUOTATION MARK}": "'",
    "\N{RIGHT SINGLE QUOTATION MARK}": "'",
    "\N{LEFT DOUBLE QUOTATION MARK}": '"',
    "\N{RIGHT DOUBLE QUOTATION MARK}": '"',
}
"""Signs that have a common spelling in ASCII. Other characters are shown as escape sequences, not
as question marks, with which labels and file names would look the same."""

_HANDLER = "priorfill-readable"
"""Name under which Python knows `_readable`."""


def encodable(text: str, stream: Any) -> str:
    r"""Return a text with what the encoding of a stream lacks replaced.

    Parameters
    ----------
    text : str
        The text.
    stream : file object
        Where it will be printed; UTF-8 if it has no encoding.

    Returns
    -------
    str
        Signs in their ASCII spelling (``<=``), other characters as ``\xHH``, ``\uHHHH`` or
        ``\UHHHHHHHH``.
    """
    if text.isascii():
        return text
    codecs.register_error(_HANDLER, _readable)
    encoding = getattr(stream, "encoding", None) or "utf-8"
    return text.encode(encoding, _HANDLER).decode(encoding)


def replace_what_is_lacking() -> None:
    """Make stdout and stderr replace what their encoding lacks, whatever writes to them.

    The encoding stays as it is: the program that reads a pipe expects that of the system.
    """
    codecs.register_error(_HANDLER, _readable)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_HANDLER)


def _readable(error: UnicodeError) -> tuple[str, int]:
    """Return the replacement of characters that cannot be encoded, for `codecs`."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    characters = error.object[error.start : error.end]
    return "".join(
        _REPLACEMENTS.get(one) or one.encode("ascii", "backslashreplace").decode("ascii")
        for one in characters
    ), error.end
