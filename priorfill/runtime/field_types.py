"""Check the fields of dataclasses, such as options, against their type hints."""

from __future__ import annotations

import types
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from numbers import Integral, Real
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from priorfill.errors import ArgumentTypeError

__all__ = ["check_field_types"]


def check_field_types(value: Any) -> None:
    """Check that each field of a dataclass, and of those within, has the type of its hint.

    An integer counts as a float; numbers of NumPy count as Python's.

    Parameters
    ----------
    value : dataclass
        The dataclass.

    Raises
    ------
    ArgumentTypeError
        A TypeError, if a field has another type; the message names both.
    """
    kinds = get_type_hints(type(value))
    for one in fields(value):
        found = getattr(value, one.name)
        if not _has_type(found, kinds[one.name]):
            kind = type(found).__name__
            raise ArgumentTypeError(
                f"{type(value).__name__}.{one.name} is of type {kind}; give {one.type}"
            )


def _has_type(value: Any, kind: Any) -> bool:
    """Return whether a value has the type of a hint."""
    origin, arguments = get_origin(kind), get_args(kind)
    if kind is Any:
        return True
    if origin in (Union, types.UnionType):
        return any(_has_type(value, one) for one in arguments)
    if origin is Literal:
        return value in arguments
    if origin is tuple:
        return isinstance(value, tuple) and _have_types(value, arguments)
    if origin is Callable:
        return callable(value)
    if origin is Mapping:
        return isinstance(value, Mapping) and all(
            _has_type(name, arguments[0]) and _has_type(inner, arguments[1])
            for name, inner in value.items()
        )
    if kind in (int, float):
        number = Integral if kind is int else Real
        return isinstance(value, number) and not isinstance(value, bool)
    if not isinstance(value, kind):
        return False
    if is_dataclass(value):
        check_field_types(value)
    return True


def _have_types(values: tuple[Any, ...], kinds: tuple[Any, ...]) -> bool:
    """Return whether the items of a tuple have the types of its hint."""
    if kinds[-1] is Ellipsis:
        kinds = (kinds[0],) * len(values)
    return len(kinds) == len(values) and all(map(_has_type, values, kinds))
