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
from priorfill.report.compared import SAME_MM, gap_errors, positions_like
from priorfill.report.decision_data import decision_data, method_options
from priorfill.report.encode import encode_positions, encode_runs, encode_sparse
from priorfill.report.facts import facts_of, truth_rows
from priorfill.report.gap_warnings import gap_warnings
from priorfill.report.result_summary import worst_first
from priorfill.report.shown_text import MAX_LABEL, message_text, shown
from priorfill.report.sticks import sticks_of
from priorfill.report.warning_options import WarningOptions

if TYPE_CHECKING:
    from priorfill.clip import Clip
    from priorfill.filling.result import FilledGap, Result

__all__ = ["FORMAT", "PageContents", "page_data", "sample_states"]

FORMAT = 1
"""Version of the data that the page reads."""

MISSING, MEASURED, FILLED, DOUBTFUL, REPLACED, EXCHANGED = range(6)
"""States of a sample: missing; measured; filled; measured, but in doubt; measured, then replaced by
a fill; measured in another place, such as that of an exchanged label."""

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
    others : sequence of (str, Clip or sequence of Clip)
        Other fills of the same gaps, with their names.
    name : str
        What the fill is called.
    facts : mapping of str to sequence of (str, str)
        More facts, as tables of name and value by title.
    review : bool
        Whether the page belongs to a review, which can fill again and save.
    decisions : sequence of mapping or None
        Overrides that were loaded, as in a file of overrides; None: those of the result.
    database_clips : sequence of str
        Names of clips that a fill may learn from.
    warnings : WarningOptions
        From which values on to warn of a gap.
    """

    before: Clip | Sequence[Clip] | None = None
    truth: Clip | Sequence[Clip] | None = None
    others: Sequence[tuple[str, Clip | Sequence[Clip]]] = ()
    name: str = "filled"
    facts: Mapping[str, Sequence[tuple[str, str]]] = field(default_factory=dict)
    review: bool = False
    decisions: Sequence[Mapping[str, Any]] | None = None
    database_clips: Sequence[str] = ()
    warnings: WarningOptions = field(default_factory=WarningOptions)


def page_data(result: Result, contents: PageContents | None = None) -> dict[str, Any]:
    """Return what the page shows of a result.

    Parameters
    ----------
    result : Result
        Of a fill.
    contents : PageContents, optional
        What else it shows.

    Raises
    ------
    ClipError
        Where a clip of `contents` does not fit the result.
    """
    contents = contents or PageContents()
    clip = result.clip
    upright = to_upright(clip.positions, clip.up)
    before = truth = None
    if contents.before is not None:
        before = positions_like(contents.before, clip, all_markers=True)
    if contents.truth is not None:
        truth = positions_like(contents.truth, clip)
    states = sample_states(result, upright, before)
    estimated = (states == FILLED) | (states == REPLACED)
    errors = gap_errors(result, truth)
    segment_of = _segment_of(result)
    return {
        "format": FORMAT,
        "mode": "review" if contents.review else "report",
        "title": shown(_file(clip) or clip.name, MAX_LABEL),
        "clip": _clip(clip),
        "facts": facts_of(
            result,
            dict(contents.facts)
            | ({} if truth is None else {"True errors": list(truth_rows(errors, result))}),
        ),
        "subjects": [shown(one.clip.subject, MAX_LABEL) for one in result.by_subject],
        "markers": _markers(result, before, segment_of),
        "sticks": sticks_of(result),
        "segments": list(dict.fromkeys(name for name in segment_of if name)),
        "versions": _versions(upright, states, before, truth, contents, clip),
        "states": encode_runs(states),
        "expected_rms": encode_sparse(result.expected_rms_mm, estimated),
        "bound_90": encode_sparse(result.error_bound_90_mm, estimated),
        "gaps": _gaps(result, errors, contents.warnings),
        "methods": ["auto", *METHODS],
        "database_clips": list(contents.database_clips)[:MAX_CLIPS],
        "decisions": _decisions(result, contents),
        "can": {"refill": contents.review, "save": contents.review},
        **decision_data(result),
        **({"method_options": method_options()} if contents.review else {}),
    }


def sample_states(
    result: Result,
    upright: NDArray[np.float64],
    before: NDArray[np.float64] | None = None,
) -> NDArray[np.int8]:
    """Return the state of each sample [shape=(frames, markers)]: 0 missing, 1 measured, ...

    Parameters
    ----------
    result : Result
        Of a fill.
    upright : ndarray [shape=(frames, markers, 3), mm]
        Its upright positions.
    before : ndarray [shape=(frames, markers, 3), mm], optional
        Upright positions as they were measured.
    """
    states = np.where(result.clip.missing, MISSING, MEASURED).astype(np.int8)
    known = states == MEASURED
    if result.doubtful is not None:
        states[result.doubtful & known] = DOUBTFUL
    # a sample has one state: that it was moved matters more, and the facts count the doubts
    if before is not None:
        states[known & _differs(upright, before)] = EXCHANGED
    if result.swapped is not None:
        states[result.swapped & known] = EXCHANGED
    states[result.filled] = FILLED
    replaced = result.rejected if before is None else ~np.isnan(before[..., 0])
    states[result.filled & replaced] = REPLACED
    return states


def _differs(upright: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return where positions are another one [shape=(frames, markers)]."""
    return np.asarray((np.abs(upright - other) > SAME_MM).any(axis=2))


def _file(clip: Clip) -> str:
    """Return the name of the file of a clip, without the folder."""
    return "" if clip.source is None else clip.source.path.name


def _clip(clip: Clip) -> dict[str, Any]:
    """Return what the page needs of the clip."""
    return {
        "name": shown(clip.name, MAX_LABEL),
        "file": shown(_file(clip), MAX_LABEL),
        "sha256": "" if clip.source is None else clip.source.sha256,
        "frames": clip.frames,
        "rate": clip.rate,
        "first_frame": clip.first_frame,
        "up": clip.up,
        "unit": "mm",
    }


def _versions(
    upright: NDArray[np.float64],
    states: NDArray[np.int8],
    before: NDArray[np.float64] | None,
    truth: NDArray[np.float64] | None,
    contents: PageContents,
    clip: Clip,
) -> list[dict[str, Any]]:
    """Return the positions of the fill, and where others differ from it."""
    filled = {"kind": "filled", "positions": encode_positions(upright)}
    versions: list[dict[str, Any]] = [{"name": shown(contents.name, MAX_LABEL)} | filled]
    if before is not None:
        known = ~np.isnan(before[..., 0])
        changed = known & ((states == MISSING) | (states == REPLACED) | (states == EXCHANGED))
        if changed.any():
            versions.append(_version("as measured", "original", before, changed))
    others = [("truth", "truth", truth)] if truth is not None else []
    others += [
        (shown(name, MAX_LABEL), "other", positions_like(given, clip))
        for name, given in contents.others
    ]
    for name, kind, positions in others:
        assert positions is not None
        kept = (states == MEASURED) | (states == DOUBTFUL)
        known = ~np.isnan(positions[..., 0])
        versions.append(
            _version(name, kind, positions, known & ~(kept & ~_differs(upright, positions)))
        )
    return versions


def _version(
    name: str, kind: str, positions: NDArray[np.float64], known: NDArray[np.bool_]
) -> dict[str, Any]:
    """Return a version that has positions of some samples."""
    only = np.where(known[..., None], positions, np.nan)
    return {
        "name": name,
        "kind": kind,
        "positions": encode_positions(only),
        "shown": encode_runs(known),
    }


def _decisions(result: Result, contents: PageContents) -> list[dict[str, Any]]:
    """Return the overrides that were loaded or applied."""
    if contents.decisions is not None:
        return [dict(entry) for entry in contents.decisions]
    overrides = result.provenance.overrides
    return [] if overrides is None else overrides.to_entries()


def _segment_of(result: Result) -> list[str]:
    """Return the name of the segment of each marker."""
    return [
        shown(one.marker_set.segment.get(label, "").replace("_", " "), MAX_LABEL)
        for one in result.by_subject
        for label in one.clip.labels
    ]


def _markers(
    result: Result, before: NDArray[np.float64] | None, segment_of: Sequence[str]
) -> list[dict[str, Any]]:
    """Return what the page shows of each marker."""
    missing = result.clip.missing | result.filled
    if before is not None:
        missing = np.isnan(before[..., 0])
    missing_before, missing_after = missing.sum(axis=0), result.clip.missing.sum(axis=0)
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
                    "own_raw": label,
                    "subject": subject,
                    "segment": segment_of[number],
                    "missing_before": int(missing_before[number]),
                    "missing_after": int(missing_after[number]),
                }
            )
    return rows


def _gaps(
    result: Result, errors: Mapping[int, NDArray[np.float64]], options: WarningOptions
) -> list[dict[str, Any]]:
    """Return what the page shows of each gap, in order of time."""
    rank = {id(gap): number for number, gap in enumerate(worst_first(result.gaps))}
    index = {label: number for number, label in enumerate(result.clip.labels)}
    warnings = gap_warnings(result, errors, options)
    rows = []
    for number, gap in enumerate(result.gaps):
        true_mean = float(np.nanmean(errors[number])) if number in errors else math.nan
        rows.append(
            _gap(gap)
            | {
                "marker": index[gap.label],
                "badness": rank[id(gap)],
                "true_mean": _length(true_mean),
                "warnings": [{"kind": one.kind, "text": one.text} for one in warnings[number]],
            }
        )
    return rows


def _gap(gap: FilledGap) -> dict[str, Any]:
    """Return what the result knows about a gap."""
    return {
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
        "unfilled": [
            {
                "start": span.start,
                "stop": span.stop,
                "reason": message_text(span.reason),
                "requested": span.requested,
            }
            for span in gap.unfilled
        ],
    }


def _length(value: float) -> float | None:
    """Return a length (mm) for JSON."""
    return round(float(value), 2) if math.isfinite(value) else None
