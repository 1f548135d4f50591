"""The prediction for a gap segment, or the reason why it stays missing."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from priorfill.gp.calibration import BOUND_FACTOR
from priorfill.methods.gpr.gap_segments import GapSegment
from priorfill.methods.task import Note, Task

__all__ = ["OVER_TIME", "SegmentPrediction", "notes_on_unfilled"]

OVER_TIME = "interpolation over time"
"""Source of a marker that its own samples before and after predict."""


@dataclass(frozen=True, eq=False)
class SegmentPrediction:
    """The prediction for a gap segment and a few frames around it.

    Attributes
    ----------
    segment : GapSegment
        The predicted samples.
    first : int
        The first predicted frame; not after the segment's start.
    positions : ndarray [shape=(frames, segment's markers, 3), mm]
        Upright.
    expected_rms : ndarray [shape=(frames, segment's markers), mm]
        Expected rms error (Euclidean).
    complete : bool
        Whether a second pass has no more training poses.
    source : str
        What it was predicted from.
    source_clips : tuple of str
        Names of the recordings in the training data.
    from_own_frames : bool
        Whether it was predicted by the regression on the clip's own frames.
    training_poses : int
        Poses of the largest regression problem, or windows for a blackout; 0 without training.
    bound_factor : float
        Factor of `expected_rms` that gives the bound below which 90 % of the errors are expected.
    relative_error : float
        Ratio of the error to the one expected without the database; NaN where unknown.
    """

    segment: GapSegment
    first: int
    positions: NDArray[np.float64]
    expected_rms: NDArray[np.float64]
    complete: bool
    source: str
    source_clips: tuple[str, ...] = ()
    from_own_frames: bool = False
    training_poses: int = 0
    bound_factor: float = BOUND_FACTOR
    relative_error: float = float("nan")

    @property
    def last(self) -> int:
        """The frame after the last predicted one."""
        return self.first + len(self.positions)

    @property
    def notes(self) -> list[Note]:
        """A note for each marker."""
        return [
            Note(
                int(m),
                self.segment.start,
                self.segment.stop,
                self.source,
                source_clips=self.source_clips,
                training_poses=self.training_poses,
                relative_error=self.relative_error,
            )
            for m in self.segment.markers
        ]

    @classmethod
    def over_time(
        cls,
        segment: GapSegment,
        marker: np.intp,
        positions: NDArray[np.float64],
        expected_rms: NDArray[np.float64],
        task: Task,
    ) -> SegmentPrediction:
        """Return one marker's interpolation [shapes=(frames, 3), (frames,), mm] over time."""
        return cls(
            replace(segment, markers=np.array([marker])),
            segment.start,
            positions[:, None],
            expected_rms[:, None],
            complete=True,
            source=OVER_TIME,
            source_clips=(task.name,),
        )

    def for_markers(self, columns: NDArray[np.intp]) -> SegmentPrediction:
        """Return the prediction for some of the segment's markers, by their index in it."""
        return replace(
            self,
            segment=replace(self.segment, markers=self.segment.markers[columns]),
            positions=self.positions[:, columns],
            expected_rms=self.expected_rms[:, columns],
        )


def notes_on_unfilled(segment: GapSegment, task: Task) -> list[Note]:
    """Return the reason why a segment stays missing, for each marker."""
    if not segment.has_enough_visible:
        return [_note_on_blackout(segment, int(marker), task) for marker in segment.markers]
    if not task.learn_from_clip:
        reason = "none of the chosen sources shows it together with the visible markers"
        return [
            Note(int(m), segment.start, segment.stop, reason, filled=False) for m in segment.markers
        ]
    reason = "too few frames of the clip show it together with the visible markers, "
    reason += "and no other recording does"
    if all(take.same_subject for take in task.takes):
        reason += ", and there is no database"
    if not task.takes:
        reason += "; give one (`database`), or another clip of the same subject (`same_subject`)"
    return [
        Note(int(m), segment.start, segment.stop, reason, filled=False) for m in segment.markers
    ]


def _note_on_blackout(segment: GapSegment, marker: int, task: Task) -> Note:
    """Return the reason why a marker stays missing while fewer than three others are visible."""
    shown = np.flatnonzero(task.valid[:, marker])
    before, after = shown[shown < segment.start], shown[shown >= segment.stop]
    reason = "fewer than three other markers are visible, and "
    if not task.learn_from_clip:
        reason += "the clip is not one of the chosen sources"
    elif len(shown):
        first = before[-1] + 1 if len(before) else 0
        last = after[0] if len(after) else len(task.valid)
        reason += f"too little of it next to the gap of {(last - first) / task.rate:.3g} s"
    else:
        reason += "it is never visible"
    return Note(marker, segment.start, segment.stop, reason, filled=False)
