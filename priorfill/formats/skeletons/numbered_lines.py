"""Lines of a text file as words, with line numbers for error messages."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import FormatError

__all__ = ["MAX_JOINTS", "MAX_NUMBER", "NumberRows", "NumberedLines"]

MAX_JOINTS = 2000
"""Maximum number of joints of a skeleton; those with hands and a face have up to 300."""

MAX_NUMBER = 1e9
"""Largest magnitude of a number: no length or angle is larger, and squares stay finite."""

_MAX_SHOWN = 40
"""Characters of a wrong word shown in a message."""


_BLOCK_WORDS = 1 << 16
"""Words that are converted to numbers at once."""


class NumberedLines:
    """Iterator over the non-empty lines of a file; a second loop continues where the first ended.

    Parameters
    ----------
    data : bytes
        The file's contents, decoded as UTF-8, or else as Latin-1.
    name : str
        The file's name in messages.
    comment : str
        What begins a comment at the end of a line; by default nothing.

    Attributes
    ----------
    line : int
        Number of the last line returned, counted from 1.
    """

    def __init__(self, data: bytes, name: str, comment: str = "") -> None:
        self.name = name
        self._comment = comment
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
            if self._comment and self._comment in text:
                at = [k for k, word in enumerate(words) if word.startswith(self._comment)]
                words = words[: at[0]] if at else words
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
                value = math.nan if _is_odd(word) else float(word)
            except ValueError:
                value = math.nan
            if not abs(value) <= MAX_NUMBER:
                shown = word[:_MAX_SHOWN]
                raise self.error(
                    f"{shown!r} is not a number or too large ({what})", "correct it", at=at
                )
            found.append(value)
        return tuple(found)


def _is_odd(word: str) -> bool:
    """Return whether Python reads a word as a number that no other program does."""
    return "_" in word or not word.isascii()


class NumberRows:
    """Rows of numbers, converted in blocks, so that few words are kept at a time.

    Parameters
    ----------
    lines : NumberedLines
        The lines that they come from.
    what : str
        Description of the numbers, for messages.
    """

    def __init__(self, lines: NumberedLines, what: str) -> None:
        self._lines, self._what = lines, what
        self._rows: list[list[str]] = []
        self._numbers: list[int] = []
        self._blocks: list[NDArray[np.float64]] = []
        self._done = 0

    def __len__(self) -> int:
        return self._done + len(self._rows)

    def add(self, words: list[str]) -> None:
        """Add the words of the last line returned; all rows have the same number of words."""
        self._rows.append(words)
        self._numbers.append(self._lines.line)
        if len(self._rows) * len(words) >= _BLOCK_WORDS:
            self._convert()

    def array(self) -> NDArray[np.float64]:
        """Return all rows [shape=(rows, words)].

        Raises
        ------
        FormatError
            If a word is not a number or exceeds `MAX_NUMBER`.
        """
        self._convert()
        return np.concatenate(self._blocks)

    def _convert(self) -> None:
        if not self._rows:
            return
        try:
            if any(_is_odd(word) for row in self._rows for word in row):
                raise ValueError
            values = np.array(self._rows, dtype=np.float64)
            fits = bool((np.abs(values) <= MAX_NUMBER).all())
        except ValueError:
            fits = False
        if not fits:
            for words, line in zip(self._rows, self._numbers, strict=True):
                self._lines.numbers(words, len(words), self._what, at=line)
            raise AssertionError("the invalid number was not found")
        self._blocks.append(values)
        self._done += len(self._rows)
        self._rows, self._numbers = [], []
