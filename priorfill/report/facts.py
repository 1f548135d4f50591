"""What was done, as titled tables of two columns: the facts of a page."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from priorfill.report.shown_text import MAX_LABEL, message_text, shown, time_text

if TYPE_CHECKING:
    from priorfill.clip import Clip
    from priorfill.filling.result import Result

__all__ = ["facts_of", "truth_rows"]

MAX_ROWS = 500
"""Rows of a table; a page with more is not read, and what is left out is stated."""

Rows = Iterable[tuple[str, str]]


def facts_of(result: Result, further: Mapping[str, Rows] | None = None) -> list[dict[str, Any]]:
    """Return the facts about a result.

    Parameters
    ----------
    result : Result
        Of a fill.
    further : mapping of str to iterable of (str, str), optional
        More tables, by title; they follow the first one.

    Returns
    -------
    list of dict
        Tables with ``title`` and ``rows`` of name and value.
    """
    provenance = result.provenance
    tables: list[tuple[str, Rows]] = [
        ("Recording", _recording(result)),
        ("Fill", _fill(result)),
        *(further or {}).items(),
        (
            "Clips learnt from",
            (
                (clip.name, "; ".join(filter(None, (clip.subject, clip.licence, clip.credit))))
                for clip in provenance.source_clips
            ),
        ),
        ("Artefacts", _artefacts(result)),
        ("Notes", (("", message_text(note)) for note in _notes(result))),
        ("Versions", ((name, text) for name, text in provenance.versions.items() if text)),
    ]
    return [{"title": title, "rows": rows} for title, given in tables if (rows := _rows(given))]


def truth_rows(
    errors: Mapping[int, NDArray[np.float64]], result: Result
) -> Iterator[tuple[str, str]]:
    """Yield what is known about the true errors of a result.

    Parameters
    ----------
    errors : mapping of int to ndarray [shape=(filled frames,), mm]
        By the number of the gap.
    result : Result
        Of the fill.
    """
    if not errors:
        yield "True error", "no filled sample has a known true position"
        return
    index = {label: number for number, label in enumerate(result.clip.labels)}
    every, below, known = [], 0, 0
    for number, off in errors.items():
        gap = result.gaps[number]
        inside = slice(gap.start, gap.stop), index[gap.label]
        bound = result.error_bound_90_mm[inside][result.filled[inside]]
        both = np.isfinite(off) & np.isfinite(bound)
        known += int(both.sum())
        below += int((off[both] <= bound[both]).sum())
        every.append(off[np.isfinite(off)])
    all_errors = np.concatenate(every)
    yield "Mean error", f"{all_errors.mean():.1f} mm"
    yield "Median", f"{np.median(all_errors):.1f} mm"
    yield "90 % of the errors", f"below {np.percentile(all_errors, 90.0):.1f} mm"
    yield "Largest", f"{all_errors.max():.1f} mm"
    if known:
        yield "Below the 90 % bound", f"{100.0 * below / known:.0f} % of {known} samples"
    yield "Samples", f"{len(all_errors)} in {len(errors)} gaps"


def _rows(given: Rows) -> list[list[str]]:
    """Return the rows of a table as they are shown."""
    rows = list(given)
    shown_rows = [[shown(name, MAX_LABEL), shown(value)] for name, value in rows[:MAX_ROWS]]
    if len(rows) > MAX_ROWS:
        shown_rows.append(["", f"and {len(rows) - MAX_ROWS} more"])
    return shown_rows


def _recording(result: Result) -> Iterator[tuple[str, str]]:
    """Yield which recording was filled."""
    clip = result.clip
    if clip.source is not None:
        yield "File", clip.source.path.name
        yield "SHA-256", clip.source.sha256
    yield "Clip", clip.name
    subjects = [one.clip.subject for one in result.by_subject if one.clip.subject]
    if subjects:
        yield "Subjects" if len(subjects) > 1 else "Subject", ", ".join(subjects)
    last = clip.first_frame + clip.frames - 1
    yield (
        "Frames",
        f"{clip.frames} ({clip.first_frame}-{last}), "
        f"{time_text(clip.duration, clip.rate)} at {clip.rate:g} Hz",
    )
    yield "Markers", str(len(clip.labels))
    sets = dict.fromkeys(_set_name(one) for one in result.by_subject)
    yield "Marker set", ", ".join(sets)
    yield "Up axis", clip.up
    for other in result.provenance.same_subject:
        yield "Same subject", other.file or other.name


def _set_name(result: Result) -> str:
    marker_set = result.marker_set
    if marker_set.name == "discovered":
        return "not known; segments were found from the data"
    return f"{marker_set.name}: {marker_set.title}" if marker_set.title else marker_set.name


def _fill(result: Result) -> Iterator[tuple[str, str]]:
    """Yield how it was filled."""
    provenance = result.provenance
    yield "Method", result.method
    for name, value in provenance.options.items():
        yield f"Option {name}", str(value)
    missing = int((result.clip.missing | result.filled).sum())
    total = result.filled.size
    yield "Missing before", f"{missing} samples ({100.0 * missing / total:.2f} %)"
    yield "Filled", f"{int(result.filled.sum())} samples"
    left = int(result.clip.missing.sum())
    yield "Missing after", f"{left} samples ({100.0 * left / total:.2f} %)"
    replaced = int((result.filled & result.rejected).sum())
    if replaced:
        yield "Replaced", f"{replaced} measured samples were treated as missing and filled"
    if result.doubtful is not None:
        doubtful = int((result.doubtful & ~result.filled & ~result.clip.missing).sum())
        yield "In doubt", f"{doubtful} measured samples, kept as measured; no fill joins them"
    if provenance.database is None and provenance.versions:  # not where nothing is known of it
        yield "Database", "none"
    elif provenance.database is not None:
        state = provenance.database
        name = Path(state.path).name or state.path
        yield "Database", f"{name}: {state.clips} clips at {state.rate:g} Hz, {state.content[:12]}"
    yield from _choices(result)


def _choices(result: Result) -> Iterator[tuple[str, str]]:
    """Yield the arguments that differ from the defaults."""
    provenance = result.provenance
    if provenance.trust_filled:
        yield "Filled samples of the database", "learnt from as if they were measured"
    for title, chosen, names in (
        ("Gaps filled", provenance.gap_filter, ("markers", "frames", "max_gap", "skip_edges")),
        (
            "Clips allowed",
            provenance.selection,
            ("names", "subjects", "markers", "sessions", "not_names", "not_subjects"),
        ),
    ):
        given = {name: getattr(chosen, name) for name in names}
        texts = [f"{name} {_value(value)}" for name, value in given.items() if value]
        if texts:
            yield title, "; ".join(texts)
    if provenance.overrides is not None:
        path = provenance.overrides.path
        count = len(provenance.overrides.entries)
        name = "" if path is None else f" from {path.name}"
        yield "Overrides", f"{count} {'entry' if count == 1 else 'entries'}{name}"
    if provenance.reject_artefacts:
        yield "Artefacts", "treated as missing"
    if provenance.extrapolate not in (0, 0.0):
        yield "Extrapolated", f"up to {provenance.extrapolate} beyond the visible range"
    if provenance.max_error is not None:
        yield "Greatest expected error", f"{provenance.max_error:g} mm"
    for name, value in provenance.plausibility.items():
        yield f"Check of fills, {name}", str(value)
    for name, value in provenance.reading.items():
        if value not in (None, False) and (name, value) != ("zeros_missing", True):
            yield f"Read with {name}", str(value)
    if provenance.reading.get("zeros_missing") is False:
        yield "Read with zeros_missing", "False"


def _value(value: object) -> str:
    """Return the value of an argument as text."""
    if isinstance(value, tuple):
        return ", ".join("" if one is None else str(one) for one in value)
    return str(value)


def _artefacts(result: Result) -> Iterator[tuple[str, str]]:
    """Yield the artefacts: what was rejected, or is in doubt."""
    first = result.clip.first_frame
    for one in result.artefacts:
        yield (
            f"{', '.join(one.markers)}",
            f"{one.kind} in frames {first + one.start}-{first + one.stop - 1}: {one.evidence}",
        )


def _notes(result: Result) -> Iterator[str]:
    """Yield the notes on the file and on the fill."""
    clip: Clip = result.clip
    notes = () if clip.source is None else clip.source.notes
    yield from dict.fromkeys((*notes, *result.notes))
