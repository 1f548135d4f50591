"""Lines of a text file as words, with line numbers for error messages."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from priorfill.errors import FormatError

__all__ = ["MAX_NUMBER", "NumberedLines"]

MAX_NUMBER = 1e9
"""Largest magnitude of a number: no length or angle is larger, and squares stay finite."""

_MAX_SHOWN = 40
"""Characters of a wrong word shown in a message."""


class NumberedLines:
    """Iterator over the non-empty lines of a file; a second loop continues where the first ended.

    Parameters
    ----------
    data : bytes
        The file's contents, decoded as UTF-8, or else as Latin-1.
    name : str
        The file's name in messages.

    Attributes
    ----------
    line : int
        Number of the last line returned, counted from 1.
    """

    def __init__(self, data: bytes, name: str) -> None:
        self.name = name
        self.line = 0
        if b"\0" in data:
            raise FormatError(f"{name}: is not a text file; check the file")
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

    def error(
        self,
        what: str,
        remedy: str = "correct the file, or export it again",
        *,
        at: int | None = None,
    ) -> FormatError:
        """Return an error that names file and line (by default the last one returned)."""
        line = self.line if at is None else at
        return FormatError(f"{self.name}: line {line}: {what}; {remedy}")

    def numbers(
        self, words: Sequence[str], count: int, what: str, *, at: int | None = None
    ) -> tuple[float, ...]:
        """Convert words to numbers.

        Parameters
        ----------
        words : sequence of str
            The words.
        count : int
            Number of words converted; more are ignored.
        what : str
            Description of the numbers, for messages.
        at : int, optional
            Line number; by default that of the last line returned.

        Raises
        ------
        FormatError
            If there are fewer, or one is not a number or exceeds `MAX_NUMBER`.
        """
        if len(words) < count:
            raise self.error(f"{what} has {len(words)} of {count} numbers", "correct it", at=at)
        found = []
        for word in words[:count]:
            try:
                value = float(word)
            except ValueError:
                value = math.nan
            if not abs(value) <= MAX_NUMBER:
                shown = word[:_MAX_SHOWN]
                raise self.error(
                    f"{shown!r} is not a number or too large ({what})", "correct it", at=at
                )
            found.append(value)
        return tuple(found)
