"""Types of arguments of public functions, checked before anything is done."""

from __future__ import annotations

import os
from collections.abc import Iterable

from priorfill.errors import ArgumentTypeError, OptionError

__all__ = [
    "check_attributes",
    "check_labels",
    "check_number",
    "check_path",
    "check_result",
    "check_type",
]


def check_type(name: str, value: object, kinds: type | tuple[type, ...], remedy: str) -> None:
    """Raise an `ArgumentTypeError` unless an argument is of a type, or of one of several.

    Parameters
    ----------
    name : str
        The argument.
    value : object
        Its value.
    kinds : type or tuple of type
        What it may be.
    remedy : str
        What is needed, after "give".
    """
    if not isinstance(value, kinds):
        raise ArgumentTypeError(f"`{name}` is of type {type(value).__name__}; give {remedy}")


def check_path(name: str, value: object) -> None:
    """Raise an `OptionError` unless an argument can be the path of a file or folder.

    Parameters
    ----------
    name : str
        The argument.
    value : object
        Its value.
    """
    check_type(name, value, (str, os.PathLike), "a path, as a text or Path")
    if "\0" in str(value):
        raise OptionError(f"`{name}` has a zero byte; no name of a file can")


def check_labels(value: object, *, convert: bool = False) -> tuple[str, ...]:
    """Return the argument ``labels`` as a tuple, or raise an `ArgumentTypeError`.

    Parameters
    ----------
    value : object
        Its value.
    convert : bool
        Whether labels that are no texts, such as numbers, become texts.
    """
    remedy = "a list of texts, one for each marker"
    if isinstance(value, (str, bytes)) or not isinstance(value, Iterable):
        raise ArgumentTypeError(f"`labels` is of type {type(value).__name__}; give {remedy}")
    labels = tuple(str(label) for label in value) if convert else tuple(value)
    for number, label in enumerate(labels, start=1):
        if not isinstance(label, str):
            raise ArgumentTypeError(
                f"`labels` has one of type {type(label).__name__} (number {number}); give {remedy}"
            )
    return labels


def check_result(value: object) -> None:
    """Raise an `ArgumentTypeError` unless the argument ``result`` has what a Result has.

    Modules that `priorfill.filling` uses cannot import its class.

    Parameters
    ----------
    value : object
        Its value.
    """
    remedy = "a Result, as priorfill.fill returns"
    check_attributes("result", value, ("by_subject", "provenance"), remedy)


def check_attributes(name: str, value: object, attributes: tuple[str, ...], remedy: str) -> None:
    """Raise an `ArgumentTypeError` unless an argument has some attributes.

    Classes of other packages are known by what they have, so that these need not be imported.

    Parameters
    ----------
    name : str
        The argument.
    value : object
        Its value.
    attributes : tuple of str
        What it must have.
    remedy : str
        What is needed, after "give".
    """
    if not all(hasattr(value, attribute) for attribute in attributes):
        raise ArgumentTypeError(f"`{name}` is of type {type(value).__name__}; give {remedy}")


def check_number(name: str, value: object) -> None:
    """Raise an `ArgumentTypeError` unless an argument is one number.

    Parameters
    ----------
    name : str
        The argument.
    value : object
        Its value.
    """
    if isinstance(value, (str, bytes)) or not hasattr(type(value), "__float__"):
        raise ArgumentTypeError(f"`{name}` is of type {type(value).__name__}; give a number")
