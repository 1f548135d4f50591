"""What the page shows of a result, as numbers, texts, lists and dictionaries (docs/report.md)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.axes import to_upright
from priorfill.methods import METHODS
from priorfill.report.encode import encode_positions, encode_runs, encode_sparse
from priorfill.report.result_summary import worst_first
from priorfill.report.shown_text import MAX_LABEL, shown
from priorfill.report.sticks import sticks_of

if TYPE_CHECKING:
    from priorfill.clip import Clip
    from priorfill.filling.result import FilledGap, Result

__all__ = ["FORMAT", "PageContents", "page_data", "sample_states"]

FORMAT = 1
"""Version of the data that the page reads."""

MISSING, MEASURED, FILLED, DOUBTFUL, REPLACED, EXCHANGED = range(6)
"""States of a sample: missing; measured; filled; measured, but in doubt; measured, then replaced by
a fill; measured under the label of another marker."""

MAX_CLIPS = 2000
"""Clips of a database that the page offers as sources."""


@dataclass(frozen=True, eq=False)
class PageContents:
    """What a page shows besides the result.

    Attributes
    ----------
    before : Clip or sequence of Clip or None
        The clip as it was measured, one for each subject of a file.
    truth : Clip or sequence of Clip or None
        The same recording without gaps.
    review : bool
        Whether the page belongs to a review, which can fill again and save.
    decisions : sequence of mapping
        Overrides that were applied, as in a file of overrides.
    database_clips : sequence of str
        Names of clips that a fill may learn from.
    """

    before: Clip | Sequence[Clip] | None = None
    truth: Clip | Sequence[Clip] | None = None
    review: bool = False
    decisions: Sequence[Mapping[str, Any]] = field(default_factory=tuple)
    database_clips: Sequence[str] = ()


def page_data(result: Result, contents: PageContents | None = None) -> dict[str, Any]:
    """Return what the page shows of a result.

    Parameters
    ----------
    result : Result
        Of a fill.
    contents : PageContents, optional
        What else it shows.
    """
    contents = contents or PageContents()
    clip = result.clip
    states = sample_states(result)
    upright = to_upright(clip.positions, clip.up)
    shown_fill = (states == FILLED) | (states == REPLACED)
    name = clip.name if clip.source is None else clip.source.path.name
    segment_of = _segment_of(result)
    return {
        "format": FORMAT,
        "mode": "review" if contents.review else "report",
        "title": shown(name, MAX_LABEL),
        "clip": {
            "name": shown(clip.name, MAX_LABEL),
            "file": "" if clip.source is None else shown(name, MAX_LABEL),
            "sha256": "" if clip.source is None else clip.source.sha256,
            "frames": clip.frames,
            "rate": clip.rate,
            "first_frame": clip.first_frame,
            "up": clip.up,
            "unit": "mm",
        },
        "facts": [{"title": "Fill", "rows": [["Method", shown(result.method)]]}],
        "subjects": [shown(one.clip.subject, MAX_LABEL) for one in result.by_subject],
        "markers": _markers(result, segment_of),
        "sticks": sticks_of(result),
        "segments": list(dict.fromkeys(name for name in segment_of if name)),
        "versions": [{"name": "filled", "kind": "filled", "positions": encode_positions(upright)}],
        "states": encode_runs(states),
        "expected_rms": encode_sparse(result.expected_rms_mm, shown_fill),
        "bound_90": encode_sparse(result.error_bound_90_mm, shown_fill),
        "gaps": _gaps(result),
        "methods": ["auto", *METHODS],
        "database_clips": list(contents.database_clips)[:MAX_CLIPS],
        "decisions": [dict(entry) for entry in contents.decisions],
        "can": {"refill": contents.review, "save": contents.review},
    }


def sample_states(result: Result) -> NDArray[np.int8]:
    """Return the state of each sample [shape=(frames, markers)]: 0 missing, 1 measured, ...

    Parameters
    ----------
    result : Result
        Of a fill.
    """
    states = np.where(result.clip.missing, MISSING, MEASURED).astype(np.int8)
    if result.doubtful is not None:
        states[result.doubtful & (states == MEASURED)] = DOUBTFUL
    states[result.filled] = FILLED
    states[result.filled & result.rejected] = REPLACED
    return states


def _segment_of(result: Result) -> list[str]:
    """Return the name of the segment of each marker."""
    return [
        shown(one.marker_set.segment.get(label, "").replace("_", " "), MAX_LABEL)
        for one in result.by_subject
        for label in one.clip.labels
    ]


def _markers(result: Result, segment_of: Sequence[str]) -> list[dict[str, Any]]:
    """Return what the page shows of each marker."""
    before = (result.clip.missing | result.filled).sum(axis=0)
    after = result.clip.missing.sum(axis=0)
    rows: list[dict[str, Any]] = []
    for subject, one in enumerate(result.by_subject):
        for label in one.clip.labels:
            number = len(rows)
            raw = result.clip.labels[number]
            rows.append(
                {
                    "label": shown(raw, MAX_LABEL),
                    "raw": raw,
                    "own": shown(label, MAX_LABEL),
                    "subject": subject,
                    "segment": segment_of[number],
                    "missing_before": int(before[number]),
                    "missing_after": int(after[number]),
                }
            )
    return rows


def _gaps(result: Result) -> list[dict[str, Any]]:
    """Return what the page shows of each gap, in order of time."""
    rank = {id(gap): number for number, gap in enumerate(worst_first(result.gaps))}
    index = {label: number for number, label in enumerate(result.clip.labels)}
    return [_gap(gap, index[gap.label], rank[id(gap)]) for gap in result.gaps]


def _gap(gap: FilledGap, marker: int, rank: int) -> dict[str, Any]:
    return {
        "marker": marker,
        "start": gap.start,
        "stop": gap.stop,
        "filled": gap.filled,
        "requested": gap.requested,
        "method": shown(gap.method, MAX_LABEL),
        "sources": [shown(source) for source in gap.sources],
        "clips": [shown(name, MAX_LABEL) for name in gap.source_clips],
        "training_poses": gap.training_poses,
        "expected_mean": _length(gap.expected_mean_error_mm),
        "expected_rms": _length(gap.expected_rms_mm),
        "bound_90": _length(gap.error_bound_90_mm),
        "true_mean": None,
        "badness": rank,
        "warnings": [],
        "unfilled": [
            {
                "start": span.start,
                "stop": span.stop,
                "reason": shown(span.reason),
                "requested": span.requested,
            }
            for span in gap.unfilled
        ],
    }


def _length(value: float) -> float | None:
    """Return a length (mm) for JSON."""
    return round(float(value), 2) if math.isfinite(value) else None
