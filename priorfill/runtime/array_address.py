"""Where the numbers of an array are in memory.

``array.ctypes.data`` makes two objects in Python, which takes longer than most compiled loops run.
The C interface of NumPy fixes that the address is the first field of an array, and extensions
compiled for it read it there; so does this module, in the interpreter for which it holds.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

__all__ = ["array_address"]

HEAD = object.__basicsize__
"""Bytes of what each object begins with."""


def _from_field(array: np.ndarray[Any, Any]) -> int:
    """Return the address by the first field; an object's id is its address in CPython."""
    return ctypes.c_size_t.from_address(id(array) + HEAD).value


def _from_attribute(array: np.ndarray[Any, Any]) -> int:
    """Return the address in any interpreter."""
    address: int = array.ctypes.data
    return address


def _chosen() -> Callable[[np.ndarray[Any, Any]], int]:
    return _from_field if sys.implementation.name == "cpython" else _from_attribute


array_address: Callable[[np.ndarray[Any, Any]], int] = _chosen()
"""Return the address of the first element of an array, which the caller keeps alive."""
