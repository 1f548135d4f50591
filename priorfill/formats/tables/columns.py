"""Which columns of a text table belong to which marker."""

from __future__ import annotations

from collections.abc import Sequence

from priorfill.errors import FormatError

__all__ = ["axis_columns", "check_labels", "names_of_columns"]

_AXES = ("X", "Y", "Z")

_MAX_LABEL = 1000
"""Characters. A longer name is a line that lost its separators."""


def axis_columns(axes: Sequence[str], first: int = 0) -> list[list[int]]:
    """Return the cells of each marker: those where X, Y, Z stand side by side.

    Parameters
    ----------
    axes : sequence of str
        Titles of the columns, with or without numbers (X1).
    first : int
        Cell in which the search begins.

    Returns
    -------
    list of list of int [shape=(markers, 3)]
        The cells.
    """
    letters = [title[:1].upper() if title[1:].strip().isdigit() or len(title) == 1 else title
               for title in axes]  # fmt: skip
    found = []
    cell = first
    while cell + 2 < len(letters):
        if tuple(letters[cell : cell + 3]) == _AXES:
            found.append([cell, cell + 1, cell + 2])
            cell += 3
        else:
            cell += 1
    return found


def names_of_columns(
    names: Sequence[str], columns: Sequence[Sequence[int]], first: int, what: str
) -> tuple[list[str], list[str]]:
    """Assign the names of a header row to the columns of the markers.

    A name stands above the X of its marker. If one X or more has no name above it, and there are as
    many names as markers, the row is shifted, and the names are in order. If all names stand above
    an X, those without a name are unlabelled.

    Parameters
    ----------
    names : sequence of str
        Cells of the row with the names.
    columns : sequence of sequence of int [shape=(markers, 3)]
        Cells of the coordinates of each marker.
    first : int
        First cell that can be a name.
    what : str
        File and line for messages.

    Returns
    -------
    labels : list of str
        The name of each marker; empty if it has none.
    notes : list of str
        A note if the row is shifted.

    Raises
    ------
    FormatError
        If the row does not show which name belongs to which marker.
    """
    starts = [cells[0] for cells in columns]
    above = [names[start] if start < len(names) else "" for start in starts]
    if all(above):
        return above, []
    repeated = {cell for x, y, z in columns for cell in (y, z)
                if cell < len(names) and names[cell] == names[x]}  # fmt: skip
    given = [cell for cell in range(first, len(names)) if names[cell] and cell not in repeated]
    if set(given) <= set(starts) and len(names) > columns[-1][-1]:
        return above, []
    if len(given) == len(starts):
        return [names[cell] for cell in given], [
            "The markers' names do not stand above their columns; they are taken in order."
        ]
    raise FormatError(
        f"{what} has {len(given)} names for {len(starts)} markers, and they do not stand above the "
        "markers' columns; put each name above its X"
    )


def check_labels(labels: Sequence[str], name: str) -> None:
    """Raise FormatError if a label is too long to be one."""
    longest = max(map(len, labels), default=0)
    if longest > _MAX_LABEL:
        raise FormatError(
            f"{name}: has a marker's name of {longest} characters; check the separators of the file"
        )
