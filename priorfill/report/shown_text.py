"""Text of files as the page shows it: without control characters, and not too long."""

from __future__ import annotations

import math
import re

from priorfill.errors import escaped

__all__ = ["MAX_LABEL", "MAX_TEXT", "message_text", "shown", "time_text"]

MAX_LABEL = 80
"""Characters of a label or name that the page shows."""

MAX_TEXT = 2000
"""Characters of a sentence that the page shows."""

_ARGUMENT = re.compile(r"(?<![^\s(])`([a-z][a-z_]*)`(?![^\s.,:;)])")
"""An argument in a message of the library; labels with other characters are left alone."""


def shown(text: str, limit: int = MAX_TEXT) -> str:
    r"""Return a text as the page shows it.

    Parameters
    ----------
    text : str
        From a file, or quoting one.
    limit : int
        Number of characters above which the middle is left out.

    Returns
    -------
    str
        In one line, with control and format characters as escape sequences.

    Examples
    --------
    >>> shown("LKNE" + chr(0x202E))
    'LKNE\\u202e'
    >>> shown("ABCDEFGHIJ", limit=7)
    'ABC…HIJ'
    """
    if len(text) > limit:  # before characters are escaped: a text can be many megabytes long
        text = f"{text[:limit]}…{text[-limit:]}"
    safe = escaped(text)
    half = (limit - 1) // 2
    return safe if len(safe) <= limit else f"{safe[:half]}…{safe[-half:]}"


def message_text(text: str) -> str:
    """Return a message or note of the library as the page shows it.

    Readers of a page need not know Python, where arguments are written in backquotes.

    Parameters
    ----------
    text : str
        From a result.

    Examples
    --------
    >>> message_text("Up is assumed to be +Z (see `up`).")
    'Up is assumed to be +Z (see option up).'
    """
    return shown(_ARGUMENT.sub(r"option \1", text[: 2 * MAX_TEXT]))


def time_text(seconds: float, rate: float) -> str:
    """Return a time with decimals that tell two frames apart, two at least, as the page does.

    Parameters
    ----------
    seconds : float
        The time.
    rate : float
        Frame rate (Hz).

    Examples
    --------
    >>> time_text(2 / 240, 240.0), time_text(0.5, 100.0)
    ('0.008 s', '0.50 s')
    """
    # rates stored as float32 are not exactly 100 Hz
    digits = min(6, max(2, math.ceil(math.log10(rate) - 1e-3)))
    return f"{seconds:.{digits}f} s"
