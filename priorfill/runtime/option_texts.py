"""Values of options as text: frame ranges, durations, lists of names, also in messages.

The command line, files of overrides and the library read them in the same way.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence

from priorfill.errors import OptionError

__all__ = [
    "Duration",
    "check_positive",
    "close_or_all",
    "first_names",
    "parse_duration",
    "parse_frames",
    "parse_names",
    "seconds_of",
]

Duration = float | str
"""Seconds, or a number of frames as text (``10f``), whose length depends on the clip's rate."""

_RANGE = re.compile(r"\s*(-?[0-9]{1,10})?\s*[-:\u2013]\s*(-?[0-9]{1,10})?\s*")
"""``92-116``, ``92:116`` (also with an en dash); either end may be omitted."""

_SINGLE = re.compile(r"\s*([0-9]{1,10})\s*")

_AMBIGUOUS = re.compile(r"\s*[-\u2013]\s*([0-9]{1,10})\s*")
"""``-116``: frame -116, or all frames up to 116."""

_DURATION = re.compile(
    r"\s*([0-9]{1,9}(?:\.[0-9]{0,20})?|\.[0-9]{1,20})\s*(s|f|)\s*", re.IGNORECASE
)

_MAX_SUGGESTED = 3
"""Number of similar names in a message."""

_MAX_LISTED = 40
"""Number of names in a message; a file can hold thousands of markers."""

_SIMILAR = 0.7
"""Least ratio of `difflib` at which names are similar: a letter or two differ."""


def parse_frames(text: str) -> tuple[int | None, int | None]:
    """Read a range of frames.

    Parameters
    ----------
    text : str
        ``92-116`` or ``92:116``, where either end may be omitted, or one frame.

    Returns
    -------
    tuple of (int or None, int or None)
        First and last frame, in the file's own numbering; None where omitted.

    Raises
    ------
    OptionError
        If it is no range, or the first frame is after the last.

    Examples
    --------
    >>> parse_frames("92-116"), parse_frames("92:"), parse_frames("92")
    ((92, 116), (92, None), (92, 92))
    """
    single = _SINGLE.fullmatch(text)
    if single is not None:
        return int(single[1]), int(single[1])
    ambiguous = _AMBIGUOUS.fullmatch(text)
    if ambiguous is not None:
        number = ambiguous[1]
        raise OptionError(
            f"frames {text!r} are ambiguous; write :{number} for all frames up to {number}, or "
            f"-{number}:-{number} for frame -{number}"
        )
    found = _RANGE.fullmatch(text)
    if found is None or text.strip() in ("-", "\u2013"):
        raise OptionError(
            f"frames {text!r} are no range; write 92-116 or 92:116, where either number may be "
            "omitted, or one frame"
        )
    first, last = (None if number is None else int(number) for number in found.groups())
    if first is not None and last is not None and first > last:
        raise OptionError(f"frames {first}-{last}: the first is after the last")
    return first, last


def parse_duration(text: str) -> Duration:
    """Read a duration.

    Parameters
    ----------
    text : str
        Seconds (``0.25`` or ``0.25s``) or frames (``10f``).

    Returns
    -------
    float or str
        Seconds, or frames as ``10f``.

    Raises
    ------
    OptionError
        If it is neither, or frames are not a whole number.

    Examples
    --------
    >>> parse_duration("0.25s"), parse_duration("10 f")
    (0.25, '10f')
    """
    found = _DURATION.fullmatch(text)
    number = None if found is None else float(found[1])
    frames = found is not None and found[2].lower() == "f"
    if number is None or (frames and not number.is_integer()):
        raise OptionError(
            f"{text!r} is no duration; write seconds, as 0.25 or 0.25s, or frames, as 10f"
        )
    return f"{int(number)}f" if frames else number


def seconds_of(duration: Duration, rate: float) -> float:
    """Return a duration in seconds.

    Parameters
    ----------
    duration : float or str
        Seconds, or text as for `parse_duration`.
    rate : float
        Frame rate (Hz).

    Raises
    ------
    OptionError
        If a text is no duration.

    Examples
    --------
    >>> seconds_of("10f", 200.0), seconds_of(0.25, 200.0)
    (0.05, 0.25)
    """
    read = parse_duration(duration) if isinstance(duration, str) else duration
    return int(read[:-1]) / rate if isinstance(read, str) else read


def parse_names(texts: str | Iterable[str]) -> tuple[str, ...]:
    """Read names, each alone or several separated by commas.

    Parameters
    ----------
    texts : str or iterable of str
        The names.

    Returns
    -------
    tuple of str
        Each name once.

    Raises
    ------
    OptionError
        If a text holds no name.

    Examples
    --------
    >>> parse_names(["RKNE,LELB", "C7"])
    ('RKNE', 'LELB', 'C7')
    """
    names: list[str] = []
    for text in [texts] if isinstance(texts, str) else texts:
        found = [name.strip() for name in text.split(",") if name.strip()]
        if not found:
            raise OptionError(f"{text!r} has no name; give one, or several separated by commas")
        names += found
    return tuple(dict.fromkeys(names))


def close_or_all(name: str, known: Sequence[str]) -> str:
    """Return what to use in place of an unknown name: similar names, or else all.

    Parameters
    ----------
    name : str
        A name that is not known.
    known : sequence of str
        The names that are.

    Returns
    -------
    str
        The end of a message.

    Examples
    --------
    >>> close_or_all("rnke", ["RKNE", "LELB"])
    'did you mean RKNE?'
    >>> close_or_all("x", ["RKNE", "LELB"])
    'use one of RKNE, LELB'
    """
    from difflib import get_close_matches

    by_case: dict[str, list[str]] = {}
    for one in known:
        by_case.setdefault(one.casefold(), []).append(one)
    found = get_close_matches(name.casefold(), by_case, _MAX_SUGGESTED, _SIMILAR)
    close = [one for key in found for one in by_case[key]][:_MAX_SUGGESTED]
    if close:
        return f"did you mean {' or '.join(close)}?"
    return f"use one of {first_names(known, _MAX_LISTED)}"


def first_names(names: Sequence[str], most: int) -> str:
    """Return names in a line; of many the first ones, and the number of the others.

    Parameters
    ----------
    names : sequence of str
        The names.
    most : int
        Names that are shown.

    Examples
    --------
    >>> first_names(["RKNE", "LELB", "LKNE"], 2)
    'RKNE, LELB and 1 more'
    """
    rest = len(names) - most
    return ", ".join(names[:most]) + (f" and {rest} more" if rest > 0 else "")


def check_positive(duration: Duration, what: str) -> None:
    """Raise an `OptionError` unless a duration is above 0.

    Parameters
    ----------
    duration : float or str
        Seconds, or text as for `parse_duration`.
    what : str
        What it is, the start of the message.
    """
    seconds = seconds_of(duration, 1.0)
    if not (seconds > 0 and math.isfinite(seconds)):
        unit = "" if isinstance(duration, str) else " s"
        raise OptionError(f"{what} is {duration}{unit}; it must be above 0")
