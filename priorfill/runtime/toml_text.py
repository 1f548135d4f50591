"""Values written as TOML, so that `priorfill.runtime.toml_file` reads the same values again."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from priorfill.errors import OptionError
from priorfill.runtime.toml_file import MAX_INTEGER

__all__ = ["MAX_PLAIN_DOTS", "toml_key", "toml_line", "toml_text"]

MAX_PLAIN_DOTS = 40
"""Dots that a text may have; in one of more, they are escaped, because lines of many are refused
when they are read."""

_ESCAPES = {
    "\\": "\\\\",
    '"': '\\"',
    "\b": "\\b",
    "\t": "\\t",
    "\n": "\\n",
    "\f": "\\f",
    "\r": "\\r",
}

_MAX_IN_LINE = 4
"""Items of a list written in one line; longer lists have a line for each."""

_MAX_WIDTH = 80
"""Characters of the items of a list written in one line."""


def toml_line(key: str, value: Any) -> str:
    r"""Return a key and its value, with a line end.

    Parameters
    ----------
    key : str
        Any text.
    value : object
        A text, number, truth value, list of these, or a mapping, which becomes an inline table.

    Raises
    ------
    OptionError
        Where TOML cannot hold the value.

    Examples
    --------
    >>> toml_line("sigma", 100.0)
    'sigma = 100.0\n'
    """
    return f"{toml_key(key)} = {_value(value)}\n"


def toml_key(key: str) -> str:
    """Return a key, in quotes where it needs them.

    Parameters
    ----------
    key : str
        Any text.

    Examples
    --------
    >>> toml_key("marker"), toml_key("training.max_poses")
    ('marker', '"training.max_poses"')
    """
    plain = key.isascii() and key.replace("_", "").replace("-", "").isalnum()
    return key if plain else toml_text(key)


def toml_text(text: str) -> str:
    r"""Return a text in quotes.

    Invisible characters are written as escape sequences, so that they show.

    Parameters
    ----------
    text : str
        Any text without lone surrogates.

    Raises
    ------
    OptionError
        Where it has a lone surrogate, which no TOML file holds.

    Examples
    --------
    >>> toml_text('a "b"')
    '"a \\"b\\""'
    """
    many_dots = text.count(".") > MAX_PLAIN_DOTS
    return '"' + "".join(_character(one, many_dots) for one in text) + '"'


def _character(one: str, escape_dot: bool) -> str:
    """Return a character of a text."""
    if one in _ESCAPES:
        return _ESCAPES[one]
    code = ord(one)
    if 0xD800 <= code <= 0xDFFF:
        raise OptionError(f"the character \\u{code:04x} is no Unicode text; no TOML file holds it")
    if one.isprintable() and not (one == "." and escape_dot):
        return one
    return f"\\u{code:04X}" if code <= 0xFFFF else f"\\U{code:08X}"


def _value(value: Any) -> str:
    """Return a value in one line, or a long list in several."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return toml_text(value)
    if isinstance(value, int):
        if abs(value) > MAX_INTEGER:  # which would not be read again
            raise OptionError("an integer of more than 64 bits has no place in a TOML file")
        return str(value)
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else str(value).replace("infinity", "inf")
    if isinstance(value, (list, tuple)):
        items = [_value(one) for one in value]
        if len(items) <= _MAX_IN_LINE and sum(len(item) for item in items) <= _MAX_WIDTH:
            return f"[{', '.join(items)}]"
        return "[\n" + "".join(f"    {item},\n" for item in items) + "]"
    if isinstance(value, Mapping):
        inner = ", ".join(f"{toml_key(str(key))} = {_value(one)}" for key, one in value.items())
        return f"{{ {inner} }}" if inner else "{}"
    raise OptionError(f"{type(value).__name__} has no place in a TOML file")
