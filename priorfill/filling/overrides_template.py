"""Overrides made from a result: an entry for each gap, to be edited; and whether they fit it."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.filling.gap_filter import matching_markers
from priorfill.filling.overrides import (
    ACCEPT,
    LEAVE,
    MISSING,
    SWAP,
    GapOverride,
    Overrides,
)
from priorfill.filling.result import FilledGap, Result
from priorfill.gaps import runs
from priorfill.runtime.argument_types import check_result

__all__ = ["notes_on_origin", "overrides_template"]


def overrides_template(result: Result) -> Overrides:
    """Return overrides with an entry for each gap of a result, to be edited.

    A fill with them gives the same result again.

    Parameters
    ----------
    result : Result
        Of a fill. The overrides that it was made with come first, as they are.

    Returns
    -------
    Overrides
        A gap that was filled is accepted; what was not to be filled is left missing. The note of
        each has the expected errors, or the reason why it stays missing.

    See Also
    --------
    priorfill.write_overrides : Write them to a file.

    Examples
    --------
    >>> import priorfill as pf
    >>> from priorfill.synthetic.demo import make_demo_clip
    >>> template = overrides_template(pf.fill(make_demo_clip()[1], method="linear"))
    >>> template.entries[0].markers, template.entries[0].do
    (('LKNE',), 'accept')
    """
    check_result(result)
    given = result.provenance.overrides
    before = () if given is None else given.entries
    several = len(result.by_subject) > 1
    entries = [
        (gap.start, entry)
        for one in result.by_subject
        for gap in one.gaps
        for entry in _entries_of(gap, one, before, one.clip.subject if several else "")
    ]
    entries.sort(key=lambda pair: pair[0])  # stable: subjects and markers in their order
    return Overrides(
        (*before, *(entry for _, entry in entries)), made_for=result.provenance.made_for
    )


def notes_on_origin(result: Result) -> tuple[str, ...]:
    """Return notes on differences between a fill and what its overrides were made for.

    Parameters
    ----------
    result : Result
        Of a fill.
    """
    overrides = result.provenance.overrides
    if overrides is None or overrides.made_for is None:
        return ()
    there, here = overrides.made_for, result.provenance.made_for
    notes = []
    if there.sha256 and here.sha256 and there.sha256 != here.sha256:
        notes.append(f"another file: the contents of {here.file} are not those of {there.file}")
    if there.method and there.method != here.method:
        notes.append(f"another method: {there.method}, not {here.method}")
    if there.database is not None and there.database != here.database:
        had = "a database with other clips" if there.database else "no database"
        notes.append(f"another database: {had}")
    return tuple(f"{overrides.name} was made for {note}" for note in notes)


def _entries_of(
    gap: FilledGap, result: Result, before: tuple[GapOverride, ...], subject: str
) -> Iterator[GapOverride]:
    """Yield entries for the parts of a gap to which no override applies."""
    clip = result.clip
    open_ = ~_covered(gap, clip, before)
    alone = np.zeros(gap.frames, dtype=bool)
    for span in gap.unfilled:
        if not span.requested:
            alone[span.start - gap.start : span.stop - gap.start] = True
    for do, frames in ((ACCEPT, open_ & ~alone), (LEAVE, open_ & alone)):
        for start, stop in runs(frames):
            first = clip.first_frame + gap.start + start
            yield GapOverride(
                (gap.label,),
                do,
                first,
                first + stop - start - 1,
                subject,
                note=_note(gap, gap.start + start, gap.start + stop),
            )


def _covered(gap: FilledGap, clip: Clip, before: tuple[GapOverride, ...]) -> NDArray[np.bool_]:
    """Return the frames of a gap to which an override applies [shape=(frames of the gap,)]."""
    marker = clip.labels.index(gap.label)
    covered = np.zeros(gap.frames, dtype=bool)
    for entry in before:
        if entry.do in (MISSING, SWAP) or not entry.is_for(clip):
            continue
        if any(marker in matching_markers(clip, pattern) for pattern in entry.markers):
            offset = clip.first_frame + gap.start
            first = 0 if entry.first is None else max(entry.first - offset, 0)
            stop = gap.frames if entry.last is None else max(entry.last - offset + 1, 0)
            covered[first:stop] = True
    return covered


def _note(gap: FilledGap, start: int, stop: int) -> str:
    """Return expected errors, or why a part of a gap stays missing."""
    inside = [span for span in gap.unfilled if span.start < stop and span.stop > start]
    reasons = dict.fromkeys(
        f"{'unfilled' if span.requested else 'left alone'}: {span.reason}" for span in inside
    )
    not_filled = sum(min(span.stop, stop) - max(span.start, start) for span in inside)
    return "; ".join([*([_errors(gap)] if not_filled < stop - start else []), *reasons])


def _errors(gap: FilledGap) -> str:
    """Return the expected errors of a gap."""
    if math.isnan(gap.expected_mean_error_mm):
        return f"{gap.method}: expected error unknown"
    text = f"{gap.method}: expected mean error {gap.expected_mean_error_mm:.1f} mm"
    if math.isfinite(gap.error_bound_90_mm):
        text += f", 90 % below {gap.error_bound_90_mm:.1f} mm"
    return text
