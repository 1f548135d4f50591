"""Options of methods by dotted name: list them, compare them with the defaults, and set them.

A method's options are a frozen dataclass, whose fields may be such classes again. The dotted name
of an option is the path of fields to it, such as ``training.max_poses``.
"""

from __future__ import annotations

import math
import types
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from difflib import get_close_matches
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from priorfill.errors import OptionError

__all__ = ["differing", "flattened", "with_values"]

T = TypeVar("T")

MAX_LISTED = 12
"""Options listed in a message; of more, a message names the command that lists them."""

TRUTH_VALUES = {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}
"""Words that are accepted for truth values."""


def flattened(options: object) -> dict[str, Any]:
    """Return the value of every option by its dotted name, in the order of the fields.

    Parameters
    ----------
    options : object
        A dataclass with the options of a method.

    Returns
    -------
    dict of str to object
        Without the fields that only group others.
    """
    return dict(_walk(options, ""))


def differing(options: object) -> dict[str, Any]:
    """Return the options that are not at their defaults, by dotted name.

    Parameters
    ----------
    options : object
        A dataclass with the options of a method; all of its fields have defaults.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Options:
    ...     window: float = 0.07
    ...     rounds: int = 5
    >>> differing(Options(rounds=3))
    {'rounds': 3}
    """
    default = flattened(type(options)())
    return {name: value for name, value in flattened(options).items() if value != default[name]}


def with_values(options: T, values: Mapping[str, Any]) -> T:
    """Return options with some values changed.

    Parameters
    ----------
    options : dataclass
        The options of a method.
    values : mapping of str to object
        By dotted name. Text is read as the type of its option: numbers, ``true`` or ``false``,
        ``none`` where that is allowed, and lists of numbers separated by commas.

    Raises
    ------
    OptionError
        For an unknown name, with the most similar ones; for a value of another type; and for one
        that is out of its range.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Options:
    ...     window: float = 0.07
    ...     rounds: int = 5
    >>> with_values(Options(), {"rounds": "3"})
    Options(window=0.07, rounds=3)
    """
    known = flattened(options)
    changes: dict[str, Any] = {}
    for name, value in values.items():
        if name not in known:
            raise OptionError(f"there is no option {name!r}{_alternatives(name, list(known))}")
        *groups, last = name.split(".")
        group = changes
        for part in groups:
            group = group.setdefault(part, {})
        group[last] = value
    changed: T = _changed(options, changes, "")
    return changed


def _walk(options: object, prefix: str) -> Iterator[tuple[str, Any]]:
    """Yield names and values of options, those of groups in place of the groups."""
    if not is_dataclass(options):
        raise TypeError(f"{type(options).__name__} holds no options")
    for one in fields(options):
        value = getattr(options, one.name)
        if is_dataclass(value):
            yield from _walk(value, f"{prefix}{one.name}.")
        else:
            yield prefix + one.name, value


def _changed(options: Any, changes: Mapping[str, Any], prefix: str) -> Any:
    """Return options with values, and those of groups, changed all at once.

    Options may be checked against each other, so no intermediate state is made.
    """
    kinds = get_type_hints(type(options))
    values = {}
    for name, value in changes.items():
        old = getattr(options, name)
        if is_dataclass(old):
            values[name] = _changed(old, value, f"{prefix}{name}.")
        else:
            values[name] = _converted(value, kinds[name], prefix + name)
    try:
        return replace(options, **values)
    except OptionError as error:  # name the option, not the class and field
        text = str(error).replace(f"{type(options).__name__}.", prefix)
        raise OptionError(text) from None


def _alternatives(name: str, known: list[str]) -> str:
    """Return the end of a message: the known names that are most similar to an unknown one."""
    near = get_close_matches(name, known, 3, 0.5)
    last = name.rpartition(".")[2]
    near += [one for one in known if one.rpartition(".")[2] == last and one not in near]
    if not near:
        near = [one for one in known if last in one][:3]
    if not near:
        if len(known) > MAX_LISTED:
            return "; see: priorfill methods METHOD"
        return "; use one of " + ", ".join(known)
    return "; did you mean " + " or ".join(near[:3]) + "?"


def _converted(value: Any, kind: Any, name: str) -> Any:
    """Return a value as the type of its option."""
    try:
        return _as_type(value, kind)
    except (TypeError, ValueError, OverflowError):
        raise OptionError(f"{name} cannot be {value!r}; it must be {_described(kind)}") from None


def _as_type(value: Any, kind: Any) -> Any:
    """Return a value, or the text of one, as a type; ValueError or TypeError where it is none."""
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        return _as_one_of(value, arguments)
    if origin is Literal:
        if value not in arguments:
            raise ValueError
        return value
    if origin is tuple:
        return _as_tuple(value, arguments)
    if kind is type(None):
        if value is None or (isinstance(value, str) and value.lower() == "none"):
            return None
        raise ValueError
    if kind is bool:
        return TRUTH_VALUES[value.lower()] if _is_word(value) else _instance(value, bool)
    if kind in (int, float):
        return _as_number(value, kind)
    return _instance(value, kind)


def _as_one_of(value: Any, kinds: tuple[Any, ...]) -> Any:
    """Return a value as the first of some types that it fits."""
    for kind in sorted(kinds, key=lambda kind: kind is not type(None)):
        try:
            return _as_type(value, kind)
        except (TypeError, ValueError, OverflowError):
            continue
    raise ValueError


def _as_tuple(value: Any, kinds: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return a sequence, or text with commas, as a tuple."""
    parts = value.strip("()[] ").split(",") if isinstance(value, str) else list(value)
    if kinds[-1] is Ellipsis:
        kinds = (kinds[0],) * len(parts)
    if len(kinds) != len(parts):
        raise ValueError
    return tuple(_as_type(part, kind) for part, kind in zip(parts, kinds, strict=True))


def _as_number(value: Any, kind: type) -> Any:
    """Return a finite number, or the text of one; no integer from a number with a fraction."""
    if isinstance(value, bool):
        raise TypeError
    number = kind(value.strip() if isinstance(value, str) else value)
    if not math.isfinite(number) or (not isinstance(value, str) and number != value):
        raise ValueError
    return number


def _is_word(value: Any) -> bool:
    """Whether a value is text for a truth value."""
    return isinstance(value, str) and value.lower() in TRUTH_VALUES


def _instance(value: Any, kind: type) -> Any:
    """Return a value of a type; TypeError for one of another type."""
    if not isinstance(value, kind):
        raise TypeError
    return value


def _described(kind: Any) -> str:
    """Return what an option of a type must be, for a message."""
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        return " or ".join(_described(one) for one in arguments)
    if origin is Literal:
        return "one of " + ", ".join(repr(one) for one in arguments)
    if origin is tuple:
        if arguments[-1] is Ellipsis:
            return f"a list, each item {_described(arguments[0])}"
        return f"{len(arguments)} values, each {_described(arguments[0])}"
    names = {int: "an integer", float: "a finite number", bool: "true or false", str: "text"}
    return "none" if kind is type(None) else names.get(kind, f"a {kind.__name__}")
