"""Check the fields of dataclasses that were made from files against their type hints."""

from __future__ import annotations

import types
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

__all__ = ["check_field_types"]


def check_field_types(value: Any) -> None:
    """Check that each field of a dataclass, and of those within, has the type of its hint.

    An integer counts as a float.

    Parameters
    ----------
    value : dataclass
        The dataclass.

    Raises
    ------
    TypeError
        If a field has another type; the message names it.
    """
    kinds = get_type_hints(type(value))
    for one in fields(value):
        if not _has_type(getattr(value, one.name), kinds[one.name]):
            raise TypeError(f"{type(value).__name__}.{one.name} has a value of a wrong type")


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
    if origin is Mapping:
        return isinstance(value, Mapping) and all(
            _has_type(name, arguments[0]) and _has_type(inner, arguments[1])
            for name, inner in value.items()
        )
    if kind in (int, float):
        return isinstance(value, (int, kind)) and not isinstance(value, bool)
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
