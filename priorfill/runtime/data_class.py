"""Dataclasses that cost little to define.

`dataclasses.dataclass` writes up to nine methods of each class as text and compiles them, which
takes 0.4 to 0.8 ms a class, and a sixth of a short fill for the 240 classes that it imports, half
of which it uses. Here methods are functions that look at the fields, and ``__init__`` alone is
compiled, when it is first needed. Otherwise the classes are alike, and type checkers see the
standard decorator.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, FrozenInstanceError, fields
from dataclasses import dataclass as standard_dataclass
from functools import cache
from reprlib import recursive_repr
from typing import TYPE_CHECKING, Any

__all__ = ["dataclass"]

if TYPE_CHECKING:
    from dataclasses import dataclass
else:

    def dataclass(cls=None, /, *, eq=True, order=False, frozen=False):
        """Make a class a dataclass, as `dataclasses.dataclass` does.

        Fields of `dataclasses.field` may have all options but ``kw_only``; there is no `InitVar`.
        """
        if cls is None:
            return lambda cls: dataclass(cls, eq=eq, order=order, frozen=frozen)
        if order or any(hasattr(base, "__dataclass_fields__") for base in cls.__bases__):
            return standard_dataclass(cls, eq=eq, order=order, frozen=frozen)
        return _define(cls, eq, frozen)


def _define(cls: type, eq: bool, frozen: bool) -> type:
    """Return a class with its fields and methods."""
    own = set(vars(cls))
    standard_dataclass(init=False, repr=False, eq=False)(cls)
    methods = {"__init__": _Initializer(cls), "__repr__": _representation}
    if eq:
        methods["__eq__"] = _equal
    if eq and frozen:
        methods["__hash__"] = _hash
    if frozen:
        cls.__dataclass_params__.frozen = True  # type: ignore[attr-defined]  # for subclasses
        methods |= _refusals(cls)
    for name in methods.keys() - own:
        setattr(cls, name, methods[name])
    if eq and not frozen and "__hash__" not in own:
        cls.__hash__ = None  # type: ignore[assignment]
    return cls


class _Initializer:
    """The ``__init__`` of a class, which replaces itself by the function when it is looked up."""

    def __init__(self, cls: type) -> None:
        self.cls = cls

    def __get__(self, instance: object, owner: type | None = None) -> Any:
        function = _initializer(self.cls)
        self.cls.__init__ = function  # type: ignore[misc]
        return function.__get__(instance, owner)


class _Factory:
    """In place of a default that is made for each object; signatures show it."""

    def __repr__(self) -> str:
        return "<factory>"


_FACTORY = _Factory()


def _initializer(cls: type) -> Callable[..., None]:
    """Return the function that sets the fields of a new object."""
    names: dict[str, Any] = {"_set": object.__setattr__, "_factory": _FACTORY}
    parameters, lines = ["self"], ["pass"]
    frozen = cls.__dataclass_params__.frozen  # type: ignore[attr-defined]
    given = [one for one in fields(cls) if one.init]
    for one in fields(cls):
        name = value = one.name
        if one.default_factory is not MISSING:
            names[f"_make_{name}"] = one.default_factory
            made = f"_make_{name}()"
            value = f"{made} if {name} is _factory else {name}" if one.init else made
            parameters += [f"{name}=_factory"] * one.init
        elif one.default is not MISSING:
            names[f"_default_{name}"] = one.default
            parameters += [f"{name}=_default_{name}"] * one.init
        else:
            parameters += [name] * one.init
        if one.init or one.default_factory is not MISSING:
            lines.append(f"_set(self, {name!r}, {value})" if frozen else f"self.{name} = {value}")
    if hasattr(cls, "__post_init__"):
        lines.append("self.__post_init__()")
    exec(f"def __init__({', '.join(parameters)}):\n " + "\n ".join(lines), names)
    function: Callable[..., None] = names["__init__"]
    function.__qualname__ = f"{cls.__qualname__}.__init__"
    function.__module__ = cls.__module__
    function.__annotations__ = {one.name: one.type for one in given} | {"return": None}
    return function


@recursive_repr()
def _representation(self: Any) -> str:
    """Return the name of an object's class with the fields."""
    shown = (f"{one.name}={getattr(self, one.name)!r}" for one in fields(self) if one.repr)
    return f"{type(self).__qualname__}({', '.join(shown)})"


@cache
def _compared(cls: Any) -> list[str]:
    """Return the names of the fields that count in comparisons."""
    return [one.name for one in fields(cls) if one.compare]


@cache
def _hashed(cls: Any) -> list[str]:
    """Return the names of the fields that a hash is made of."""
    return [one.name for one in fields(cls) if (one.compare if one.hash is None else one.hash)]


def _equal(self: Any, other: object) -> Any:
    """Return whether another object has the same class and values."""
    if type(other) is not type(self):
        return NotImplemented
    cls: Any = type(self)
    names = _compared(cls)
    mine, others = ([getattr(one, name) for name in names] for one in (self, other))
    return mine == others


def _hash(self: Any) -> int:
    """Return a hash of an object's values."""
    cls: Any = type(self)
    return hash(tuple([getattr(self, name) for name in _hashed(cls)]))


def _refusals(cls: Any) -> dict[str, Any]:
    """Return the methods that refuse to change fields of a frozen class."""

    def refuse(self: object, name: str, verb: str) -> None:
        if type(self) is cls or name in cls.__dataclass_fields__:
            raise FrozenInstanceError(f"cannot {verb} field {name!r}")

    def set_field(self: object, name: str, value: object) -> None:
        refuse(self, name, "assign to")
        super(cls, self).__setattr__(name, value)

    def delete_field(self: object, name: str) -> None:
        refuse(self, name, "delete")
        super(cls, self).__delattr__(name)

    return {"__setattr__": set_field, "__delattr__": delete_field}
