"""Check that what a catalogue states about a clip is possible.

Checksums find what chance changes. A catalogue may also be made by hand: whatever becomes a path, a
size or a place in a file is checked before it is used.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from itertools import pairwise
from operator import le
from typing import Any

from priorfill.database.record import ClipRecord
from priorfill.database.segment_list import MAX_BYTES, MAX_SEGMENTS

__all__ = ["has_odd_text", "is_possible", "printable", "with_printable_texts"]

MAX_RATE = 1e6
"""Hz; beyond any camera."""

MAX_FRAMES = 1 << 40
"""Maximum number of frames of a recording; at 1000 Hz, 35 years."""

_CONTENT = re.compile(r"[0-9a-f]{64}")
_CONTROLS = frozenset(map(chr, [*range(0x20), 0x7F, 0x85, 0x2028, 0x2029]))
"""Control characters that Python counts as white space too."""

_TEXTS = (
    "name",
    "subject",
    "session",
    "source",
    "licence",
    "credit",
    "marker_set",
    "filled_by",
    "added",
    "version",
)


def is_possible(record: ClipRecord) -> bool:
    """Return whether the fields of a record have possible types and values.

    Parameters
    ----------
    record : ClipRecord
        As the catalogue states it.
    """
    if not all(isinstance(getattr(record, name), str) for name in _TEXTS):
        return False
    if not (isinstance(record.content, str) and _CONTENT.fullmatch(record.content)):
        return False
    if not (record.labels and set(map(type, record.labels)) == {str}):
        return False
    rate = record.original_rate
    if not (isinstance(rate, (int, float)) and math.isfinite(rate) and 0 < rate <= MAX_RATE):
        return False
    return _has_possible_numbers(record)


def _has_possible_numbers(record: ClipRecord) -> bool:
    markers = len(record.labels)
    if not (_are_counts(record.frames, MAX_FRAMES) and all(record.frames)):
        return False
    return (
        _are_counts((record.original_frames,), MAX_FRAMES)
        and record.original_frames > 0
        and len(record.frames) > 0
        and all(2 * after - 1 <= before + 1 for before, after in pairwise(record.frames))
        and len(record.checksums) == len(record.frames)
        and _are_counts(record.checksums, 0xFFFFFFFF)
        and len(record.present) == len(record.measured) == markers
        and _are_counts((*record.present, *record.measured), record.frames[0])
        and all(map(le, record.measured, record.present))
        and _are_counts((record.segment,), MAX_SEGMENTS)
        and _are_counts((record.offset, record.offset + record.nbytes), MAX_BYTES)
        and record.offset % 4 == 0
    )


def _are_counts(values: tuple[int, ...], most: int) -> bool:
    # without a loop in Python: a large database has millions of such numbers
    return not values or (
        set(map(type, values)) == {int} and 0 <= min(values) <= max(values) <= most
    )


def has_odd_text(record: ClipRecord) -> bool:
    """Return whether a text of a record has characters that cannot be printed."""
    return record != with_printable_texts(record)


def with_printable_texts(record: ClipRecord) -> ClipRecord:
    """Return a record whose name and other texts have only characters that can be printed."""
    texts: dict[str, Any] = {name: printable(getattr(record, name)) for name in _TEXTS}
    return replace(record, **texts)


def printable(text: str) -> str:
    """Return a text with underscores for control characters, and blanks for other white space.

    A file name may have such characters, and bytes that are no text at all.
    """
    return "".join(
        one if one.isprintable() else " " if one.isspace() and one not in _CONTROLS else "_"
        for one in text
    )
