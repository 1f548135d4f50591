"""The lines of a text file as words, with the number of the line for what is wrong in it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from priorfill.errors import FormatError

__all__ = ["GREATEST", "NumberedLines"]

GREATEST = 1e9
"""Of any number in such a file: no length or angle is greater, and squares stay finite."""

_LONGEST_SHOWN = 40
"""Characters of a wrong word that a message shows."""


class NumberedLines:
    """Goes through the lines of a file that have words; may be left and taken up again.

    C3DParameters
    ----------
    data : bytes
        The file's contents; what is no UTF-8 is taken as Latin-1.
    name : str
        What to call the file.

    Attributes
    ----------
    line : int
        Number of the line that was given last, the first being 1.
    """

    def __init__(self, data: bytes, name: str) -> None:
        self.name = name
        self.line = 0
        if b"\0" in data:
            raise FormatError(f"{name}: is no text file; check the file")
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("latin-1")
        self._lines = iter(text.splitlines())

    def __iter__(self) -> Iterator[list[str]]:
        for text in self._lines:
            self.line += 1
            words = text.split()
            if words:
                yield words

    def error(self, what: str, *, at: int | None = None) -> FormatError:
        """Return an error that names file and line."""
        return FormatError(f"{self.name}: line {self.line if at is None else at}: {what}")

    def numbers(
        self, words: Sequence[str], count: int, what: str, *, at: int | None = None
    ) -> tuple[float, ...]:
        """Return words as numbers.

        C3DParameters
        ----------
        words : sequence of str
            The words.
        count : int
            How many there must be; more are not looked at.
        what : str
            What they say, for messages.
        at : int, optional
            The number of their line; by default that of the line given last.

        Raises
        ------
        FormatError
            Where there are fewer, or one is no number or above `GREATEST`.
        """
        if len(words) < count:
            raise self.error(f"{what} has {len(words)} of {count} numbers; correct it", at=at)
        found = []
        for word in words[:count]:
            try:
                value = float(word)
            except ValueError:
                value = math.nan
            if not abs(value) <= GREATEST:
                shown = word[:_LONGEST_SHOWN]
                raise self.error(f"{shown!r} is no number or too great ({what}); correct it", at=at)
            found.append(value)
        return tuple(found)
