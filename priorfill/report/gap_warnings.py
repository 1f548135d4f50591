"""Warnings about the gaps of a result: what a user should look at, with figures."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.axes import to_upright
from priorfill.markers.left_right import contralateral_markers
from priorfill.report.clip_motion import ClipMotion
from priorfill.report.gap_measures import GapMeasures, measure_gap
from priorfill.report.shown_text import MAX_LABEL, shown, time_text
from priorfill.report.warning_options import WarningOptions

if TYPE_CHECKING:
    from priorfill.filling.result import FilledGap, Result

__all__ = ["GapWarning", "gap_warnings"]


@dataclass(frozen=True)
class GapWarning:
    """Something about a gap that a user should look at.

    Attributes
    ----------
    kind : str
        ``jump``, ``speed``, ``length``, ``floor``, ``wide_bound``, ``unknown_error``,
        ``extrapolated``, ``no_similar`` or ``beyond_bound``.
    text : str
        A sentence with figures.
    """

    kind: str
    text: str


def gap_warnings(
    result: Result,
    true_errors: Mapping[int, NDArray[np.float64]] | None = None,
    options: WarningOptions | None = None,
) -> list[list[GapWarning]]:
    """Return the warnings about each gap of a result.

    Parameters
    ----------
    result : Result
        Of a fill.
    true_errors : mapping of int to ndarray [shape=(frames,), mm], optional
        The errors of the filled frames of gaps whose truth is known, by the number of the gap; NaN
        where it is not.
    options : WarningOptions, optional
        From which value on to warn.

    Returns
    -------
    list of list of GapWarning
        In the order of `Result.gaps`.
    """
    true_errors, options = true_errors or {}, options or WarningOptions()
    parts = _Parts(result)
    return [
        list(_warnings(gap, parts, true_errors.get(number), options))
        for number, gap in enumerate(result.gaps)
    ]


class _Parts:
    """The motion of each subject of a result, found when it is needed.

    Parameters
    ----------
    result : Result
        Of a fill.
    """

    def __init__(self, result: Result) -> None:
        self.result = result
        self.index = {label: number for number, label in enumerate(result.clip.labels)}
        self.used = {clip.name for clip in result.provenance.source_clips}
        self._motions: dict[int, ClipMotion] = {}
        counts = [len(one.clip.labels) for one in result.by_subject]
        self._first = np.cumsum([0, *counts])

    def place(self, gap: FilledGap) -> tuple[ClipMotion, int, int]:
        """Return the motion of the subject of a gap, its marker there, and its first marker."""
        marker = self.index[gap.label]
        subject = int(np.searchsorted(self._first, marker, side="right")) - 1
        first = int(self._first[subject])
        if subject not in self._motions:
            self._motions[subject] = self._motion(subject, first)
        return self._motions[subject], marker - first, first

    def _motion(self, subject: int, first: int) -> ClipMotion:
        one = self.result.by_subject[subject]
        markers = slice(first, first + len(one.clip.labels))
        missing, filled = self.result.clip.missing[:, markers], self.result.filled[:, markers]
        measured = ~missing & ~filled
        if self.result.doubtful is not None:
            measured &= ~self.result.doubtful[:, markers]
        segment = one.marker_set.segment
        return ClipMotion(
            to_upright(self.result.clip.positions[:, markers], self.result.clip.up),
            measured,
            filled,
            tuple(segment.get(label, "") for label in one.clip.labels),
            contralateral_markers(one.clip.labels, one.marker_set),
            self.result.clip.rate,
        )

    def label(self, marker: int) -> str:
        """Return the label of a marker of the merged clip as it is shown."""
        return shown(self.result.clip.labels[marker], MAX_LABEL)

    def frame(self, frame: int) -> int:
        """Return the number of a frame in the file."""
        return self.result.clip.first_frame + frame

    def missing_with(self, gap: FilledGap) -> int:
        """Return how many other markers are missing in the middle of a gap."""
        middle = (gap.start + gap.stop) // 2
        clip = self.result.clip
        gone = clip.missing[middle] | self.result.filled[middle]
        return int(gone.sum()) - 1


def _warnings(
    gap: FilledGap,
    parts: _Parts,
    errors: NDArray[np.float64] | None,
    options: WarningOptions,
) -> Iterator[GapWarning]:
    """Yield the warnings about one gap, the gravest first."""
    if not gap.filled:
        return
    motion, marker, first = parts.place(gap)
    found = measure_gap(motion, marker, gap.start, gap.stop)
    yield from _beyond_bound(errors, gap, parts, options)
    yield from _motion_warnings(found, parts, motion.step, options)
    yield from _length_warning(found, parts, first, options)
    if found.below_floor > options.below_floor:
        yield GapWarning("floor", f"Up to {found.below_floor:.0f} mm below the floor.")
    yield from _bound_warning(gap, found, parts, first, options)
    if found.beyond_measured:
        yield GapWarning("extrapolated", _extrapolated(gap, found, parts))
    if _nothing_alike(gap, parts, options):
        yield GapWarning(
            "no_similar",
            "Nothing alike was found in the database: no clip of it was learnt from.",
        )


def _beyond_bound(
    errors: NDArray[np.float64] | None, gap: FilledGap, parts: _Parts, options: WarningOptions
) -> Iterator[GapWarning]:
    """Warn of true errors beyond the bound."""
    if errors is None:
        return
    marker = parts.index[gap.label]
    inside = slice(gap.start, gap.stop), marker
    bound = parts.result.error_bound_90_mm[inside][parts.result.filled[inside]]
    known = np.isfinite(errors) & np.isfinite(bound)
    if known.any() and (errors[known] <= bound[known]).mean() < options.min_within_bound:
        share = 100.0 * float((errors[known] > bound[known]).mean())
        yield GapWarning(
            "beyond_bound",
            f"The true error is beyond the 90 % bound in {share:.0f} % of the frames, up to "
            f"{float(errors[known].max()):.0f} mm.",
        )


def _motion_warnings(
    found: GapMeasures, parts: _Parts, step: int, options: WarningOptions
) -> Iterator[GapWarning]:
    """Warn of jumps and speeds that the measured motion does not have."""
    if found.jump > max(options.jump_ratio * found.usual_jump, options.min_jump):
        yield GapWarning(
            "jump",
            f"Jumps by {found.jump:.0f} mm at frame {parts.frame(found.jump_frame)}; the measured "
            f"motion changes by at most {found.usual_jump:.1f} mm in "
            f"{'one frame' if step == 1 else f'{step} frames'}.",
        )
    if found.speed > max(options.speed_ratio * found.usual_speed, options.min_speed):
        yield GapWarning(
            "speed",
            f"Moves at up to {found.speed:.1f} m/s; the fastest measured motion is "
            f"{found.usual_speed:.1f} m/s.",
        )


def _length_warning(
    found: GapMeasures, parts: _Parts, first: int, options: WarningOptions
) -> Iterator[GapWarning]:
    """Warn of a distance within a segment that is not the measured one."""
    length = found.length
    if length is None or length.beyond <= max(
        options.length_error, options.length_share * length.usual
    ):
        return
    change = 100.0 * (length.length - length.usual) / length.usual
    low, high = f"{length.low:.0f}", f"{length.high:.0f}"
    yield GapWarning(
        "length",
        f"{length.length:.0f} mm from {parts.label(first + length.marker)} at frame "
        f"{parts.frame(length.frame)} ({change:+.0f} %); the measured distance on the same "
        f"segment is {low if low == high else f'{low} to {high}'} mm.",
    )


def _bound_warning(
    gap: FilledGap, found: GapMeasures, parts: _Parts, first: int, options: WarningOptions
) -> Iterator[GapWarning]:
    """Warn of an unknown error, or of one that is large for the place."""
    bound = gap.error_bound_90_mm
    if not math.isfinite(bound):
        yield GapWarning("unknown_error", "How far off the fill may be is not known.")
    elif bound > min(options.wide_bound, found.nearest):
        text = f"May be far off: 90 % of the errors are expected below {bound:.0f} mm"
        if found.nearest < bound:
            other = parts.label(first + found.nearest_marker)
            text += f", and {other} is {found.nearest:.0f} mm away"
        yield GapWarning("wide_bound", f"{text}.")


def _extrapolated(gap: FilledGap, found: GapMeasures, parts: _Parts) -> str:
    """Return the sentence on frames beyond the measured samples of the marker."""
    if gap.start == 0 and gap.stop >= parts.result.clip.frames:
        return "The marker is never measured in this clip."
    side = "before its first" if gap.start == 0 else "after its last"
    rate = parts.result.clip.rate
    far = time_text(found.beyond_measured / rate, rate)
    return f"Up to {far} {side} measured sample: only one side of the gap is measured."


def _nothing_alike(gap: FilledGap, parts: _Parts, options: WarningOptions) -> bool:
    """Return whether a database was given, and did not help where it could have."""
    return (
        parts.result.provenance.database is not None
        and gap.training_poses > 0
        and gap.frames >= options.similar_seconds * parts.result.clip.rate
        and parts.missing_with(gap) > 0
        and not parts.used & set(gap.source_clips)
    )
