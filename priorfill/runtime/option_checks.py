"""Checks of options: ranges of fields, and suffixes of files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from priorfill.errors import OptionError

__all__ = ["check_at_least", "check_between", "check_not_text", "check_suffix"]


def check_at_least(options: object, minimum: float, *names: str) -> None:
    """Raise an `OptionError` unless the named fields of some options are at least a minimum.

    Parameters
    ----------
    options : object
        The options.
    minimum : float
        The least value allowed.
    *names : str
        The fields, numbers or tuples of numbers.
    """
    for name in names:
        value = getattr(options, name)
        if not all(one >= minimum for one in (value if isinstance(value, tuple) else (value,))):
            raise OptionError(
                f"{type(options).__name__}.{name} is {value}; it must be at least {minimum:g}"
            )


def check_between(options: object, low: float, high: float, *names: str) -> None:
    """Raise an `OptionError` unless the named fields of some options are in [low, high].

    Parameters
    ----------
    options : object
        The options.
    low, high : float
        The range allowed.
    *names : str
        The fields.
    """
    for name in names:
        value = getattr(options, name)
        if not low <= value <= high:
            raise OptionError(
                f"{type(options).__name__}.{name} is {value}; it must be from {low:g} to {high:g}"
            )


def check_not_text(options: object, *names: str) -> None:
    """Raise an `OptionError` if a field that holds several texts is a single one.

    Its letters would count as texts.

    Parameters
    ----------
    options : object
        The options.
    *names : str
        The fields.
    """
    for name in names:
        value = getattr(options, name)
        if isinstance(value, str):
            texts = tuple(text.strip() for text in value.split(",")) if value else (value,)
            raise OptionError(
                f"{type(options).__name__}.{name} is {value!r}; it must be a tuple, as {texts!r}"
            )


def check_suffix(path: Path, what: str, suffixes: Sequence[str]) -> None:
    """Raise an `OptionError` unless a file to be written has one of some suffixes, in any case.

    Parameters
    ----------
    path : Path
        The file.
    what : str
        What is written, the subject of the message.
    suffixes : sequence of str
        In lower case, each with its dot.
    """
    if path.suffix.lower() not in suffixes:
        raise OptionError(
            f"{path}: {what} cannot be written "
            f"{f'with suffix {path.suffix!r}' if path.suffix else 'without a suffix'}; "
            f"use {' or '.join(suffixes)}"
        )
