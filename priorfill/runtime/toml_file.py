"""Read TOML files that users write, within bounds of time and memory."""

from __future__ import annotations

import datetime
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from priorfill.errors import PriorfillError
from priorfill.runtime.held_files import is_held

__all__ = ["read_toml"]

MAX_BYTES = 1 << 18
"""Size limit of a file (256 KiB): a definition of a thousand markers takes a third."""

MAX_DEPTH = 16
"""Maximum nesting of arrays and tables; definitions have a depth of 4."""

MAX_DOTS = 100
"""Maximum number of dots in a line; parsing takes time with the square of the parts of a key."""

MAX_SQUARED_DOTS = MAX_BYTES // 200 * MAX_DOTS**2
"""Maximum sum of the squares of the dots of all lines: those of the slowest file of `MAX_BYTES`,
whose lines are keys of `MAX_DOTS` dots and 200 bytes. It is parsed in seconds."""

MAX_INTEGER = 2**63 - 1
"""Largest integer of TOML."""

_LONG_NUMBER = re.compile(r"[0-9][0-9_]{999}")
"""An integer of more digits than Python converts has a run of these."""


def read_toml(
    path: Path, failure: Callable[[str], PriorfillError], *, max_bytes: int = MAX_BYTES
) -> dict[str, Any]:
    """Return the contents of a TOML file.

    Parameters
    ----------
    path : Path
        The file; UTF-8, with or without byte order mark.
    failure : callable
        Makes the error to raise of a message, for example a class of `priorfill.errors`.
    max_bytes : int
        Size limit of the file.

    Returns
    -------
    dict
        Tables as dict, arrays as list, texts, numbers and truth values; no dates.

    Raises
    ------
    PriorfillError
        As made by ``failure``, if the file cannot be read, is not valid TOML, exceeds `max_bytes`
        or `MAX_DEPTH`, or holds an integer above `MAX_INTEGER`, or a date.
    """
    text = _text(path, failure, max_bytes)
    squared = 0
    for number, line in enumerate(text.splitlines(), start=1):
        dots = line.count(".")
        if dots > MAX_DOTS:
            raise failure(f"{path}: line {number} has more than {MAX_DOTS} dots; divide it")
        squared += dots**2
    if squared > MAX_SQUARED_DOTS:
        raise failure(f"{path}: too many lines have many dots; divide the lines")
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        reason = str(error).splitlines()[0]
        if "\r" in text.replace("\r\n", ""):
            reason = "a line ends with CR alone, which TOML does not have"
        raise failure(f"{path}: is not valid TOML: {reason}; correct it") from error
    except RecursionError:
        raise failure(_too_deep(path, text)) from None
    except ValueError:  # of int, for more digits than Python converts
        line = _line_of(text, _LONG_NUMBER.search(text))
        raise failure(f"{path}: has a number of too many digits{line}; correct it") from None
    fault = _fault(content)
    if fault == "deep":
        raise failure(_too_deep(path, text))
    if fault:
        raise failure(f"{path}: {fault}; correct it")
    return content


def _text(path: Path, failure: Callable[[str], PriorfillError], max_bytes: int) -> str:
    """Return the text of a file."""
    try:
        if path.exists() and not path.is_file():  # reading a pipe might block for ever
            raise failure(f"{path}: is not a regular file; give the name of one")
        with path.open("rb") as file:
            data = file.read(max_bytes + 1)
    except PriorfillError:  # some are OSErrors
        raise
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise failure(
            f"{path}: cannot be read ({reason}); check its name and permissions{_held(error)}"
        ) from error
    if len(data) > max_bytes:
        raise failure(f"{path}: has more than {max_bytes >> 10} KiB; shorten it")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise failure(
            f"{path}: is not valid TOML: line {line} is not UTF-8; save it as UTF-8"
        ) from error


def _held(error: Exception) -> str:
    """Return what else may be done about a file that cannot be read."""
    held = isinstance(error, OSError) and is_held(error)
    return ", and close it in other programs" if held else ""


def _fault(content: dict[str, Any]) -> str:
    """Return what is wrong with parsed contents: "deep", a phrase, or an empty text."""
    pending: list[tuple[str, Any, int]] = [("", content, 0)]
    while pending:
        key, value, depth = pending.pop()
        if depth > MAX_DEPTH:
            return "deep"
        if isinstance(value, dict):
            pending += [(name, inner, depth + 1) for name, inner in value.items()]
        elif isinstance(value, list):
            pending += [(key, inner, depth + 1) for inner in value]
        elif isinstance(value, int) and abs(value) > MAX_INTEGER:
            return f"{key} is an integer of more than 64 bits"
        elif isinstance(value, datetime.date | datetime.time):
            return f"{key} is a date or time ({value})"
    return ""


def _too_deep(path: Path, text: str) -> str:
    """Return the message about arrays and tables that are nested too deeply."""
    depth = 0
    for place, character in enumerate(text):
        depth += (character in "[{") - (character in "]}")
        if depth > MAX_DEPTH:
            line = text.count("\n", 0, place) + 1
            return f"{path}: line {line} is nested more than {MAX_DEPTH} deep; correct it"
    return f"{path}: has tables nested more than {MAX_DEPTH} deep; correct it"


def _line_of(text: str, found: re.Match[str] | None) -> str:
    """Return the line of a match, as part of a sentence."""
    return f" in line {text.count(chr(10), 0, found.start()) + 1}" if found else ""
