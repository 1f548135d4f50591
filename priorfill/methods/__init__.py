"""Methods: functions that turn a task into an estimate of the missing markers.

`METHODS` names them. A method's module is imported when the method is asked for.
"""

from __future__ import annotations

from importlib import import_module

from priorfill.errors import OptionError
from priorfill.methods.task import Method

__all__ = ["DEFAULT_METHOD", "METHODS", "get_method"]

METHODS = {
    "prior": "priorfill.methods.regression_prior",
    "neighbours": "priorfill.methods.neighbours",
    "baumann2011": "priorfill.methods.baumann2011",
}
"""Name of each method and the module that has it as ``fill``."""

DEFAULT_METHOD = "prior"
"""What ``auto`` stands for."""


def get_method(name: str) -> Method:
    """Return a method by its name.

    Raises
    ------
    OptionError
        Where there is no such method.
    """
    name = DEFAULT_METHOD if name == "auto" else name
    if name not in METHODS:
        raise OptionError(f"there is no method {name!r}; use one of auto {' '.join(METHODS)}")
    method: Method = import_module(METHODS[name]).fill
    return method
