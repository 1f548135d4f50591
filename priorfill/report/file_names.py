"""Names of files after labels: valid on every system, and none twice."""

from __future__ import annotations

import re
from collections.abc import Iterable

from priorfill.runtime.windows_names import name_fault

__all__ = ["file_names"]

_OTHERS = re.compile(r"[^\w.+-]+")
"""What is replaced in a label. Letters of all scripts stay."""

MAX_CHARACTERS = 60
"""Longest name, without number and suffix; systems take 255 bytes for a whole name."""


def file_names(labels: Iterable[str]) -> list[str]:
    """Return a name for each label, without suffix.

    Parameters
    ----------
    labels : iterable of str
        Of markers.

    Returns
    -------
    list of str
        The labels with ``_`` in place of what some systems do not take, numbered where two would
        be the same or differ in case only.

    Examples
    --------
    >>> file_names(["LKNE", "Anna:LKNE", "lkne", "nul", "../x"])
    ['LKNE', 'Anna_LKNE', 'lkne_2', '_nul', '_x']
    """
    taken: set[str] = set()
    names = []
    for label in labels:
        plain = _OTHERS.sub("_", label[:MAX_CHARACTERS]).lstrip(".").rstrip(". ") or "marker"
        if name_fault(plain):
            plain = f"_{plain}"
        name, number = plain, 1
        while name.casefold() in taken:
            number += 1
            name = f"{plain}_{number}"
        taken.add(name.casefold())
        names.append(name)
    return names
