"""Which bytes of the segment files hold clips, as the catalogue records them.

A change that appends is announced first: the catalogue names the segment and the size that it will
have. Only bytes that were announced, and never committed, may be cut off after a writer was killed.
A segment that is longer than any announcement shows that the catalogue is older than the segment.
"""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

__all__ = ["Segment", "SegmentList", "Unused"]

MAX_SEGMENTS = 1_000_000
"""Maximum number of a segment; at 1 GiB each, no disk holds more."""

MAX_BYTES = 1 << 50
"""Maximum size of a segment."""

_FILE_NAME = re.compile(r"catalogue(-[0-9]{1,9})?\.sqlite(\.new)?")
_MARK = re.compile(r"[0-9a-f]{16}")


@dataclass(frozen=True)
class Segment:
    """The committed bytes of a segment.

    Attributes
    ----------
    size : int
        Their number.
    checksum : int
        Their CRC-32.
    mark : str
        The last 8 of them, hexadecimal: random bytes that follow each clip, so that two segments of
        equal size are told apart without reading them.
    """

    size: int
    checksum: int
    mark: str


@dataclass(frozen=True)
class Unused:
    """Bytes that belong to no clip: announced and perhaps written, or replaced by a compaction.

    Attributes
    ----------
    size : int
        The segment's size up to which the bytes are unused.
    start : int
        CRC-32 of the segment's first bytes, which identify the file.
    """

    size: int
    start: int


@dataclass(frozen=True)
class SegmentList:
    """All segments of a database.

    Attributes
    ----------
    segments : mapping of int to Segment
        By number.
    unused : mapping of int to Unused
        By number; what follows the committed bytes of a segment, or all of one that has none.
    files : tuple of str
        Names of catalogues that are unfinished or replaced.
    """

    segments: Mapping[int, Segment] = field(default_factory=dict)
    unused: Mapping[int, Unused] = field(default_factory=dict)
    files: tuple[str, ...] = ()

    @property
    def is_clean(self) -> bool:
        """Whether nothing is left to be removed."""
        return not self.unused and not self.files

    def to_text(self) -> str:
        """Return the list as the catalogue stores it."""
        content = {
            "segments": {str(n): [s.size, s.checksum, s.mark] for n, s in self.segments.items()},
            "unused": {str(n): [u.size, u.start] for n, u in self.unused.items()},
            "files": list(self.files),
        }
        return json.dumps({**content, "check": _check(content)})

    @classmethod
    def from_text(cls, text: object) -> SegmentList:
        """Return a list from its stored form.

        Raises
        ------
        ValueError
            If it is damaged.
        """
        if not isinstance(text, str):
            raise ValueError("its list of segments is missing")
        try:
            content: Any = json.loads(text)
            check = content.pop("check")
            if check != _check(content):
                raise ValueError
            found = cls(
                {_number(n): Segment(*s) for n, s in content["segments"].items()},
                {_number(n): Unused(*u) for n, u in content["unused"].items()},
                tuple(content["files"]),
            )
            sizes = [segment.size for segment in found.segments.values()]
            sizes += [unused.size for unused in found.unused.values()]
            if not all(type(size) is int and 0 <= size <= MAX_BYTES for size in sizes):
                raise ValueError
            if not all(_MARK.fullmatch(one.mark) for one in found.segments.values()):
                raise ValueError
            if not all(_FILE_NAME.fullmatch(name) for name in found.files):
                raise ValueError
        except (ValueError, TypeError, LookupError, AttributeError, RecursionError):
            raise ValueError("its list of segments is damaged") from None
        return found


def _number(text: str) -> int:
    number = int(text)
    if not 0 < number <= MAX_SEGMENTS:
        raise ValueError(f"there is no segment {number}")
    return number


def _check(content: dict[str, Any]) -> int:
    return zlib.crc32(json.dumps(content).encode())
