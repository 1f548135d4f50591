"""What a fill returns: the filled clip and a record of every gap."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.artefacts import Artefact
from priorfill.clip import Clip
from priorfill.markers.marker_set import MarkerSet

__all__ = ["FilledGap", "Result", "UnfilledSpan"]


@dataclass(frozen=True)
class UnfilledSpan:
    """Frames ``start <= frame < stop`` of a gap that were not filled, and why.

    Attributes
    ----------
    start, stop : int
        Frames.
    reason : str
        Why they were not filled.
    requested : bool
        Whether they were to be filled; False where the scope leaves them alone.
    """

    start: int
    stop: int
    reason: str
    requested: bool = True


@dataclass(frozen=True)
class FilledGap:
    """What became of one gap.

    Attributes
    ----------
    label : str
        The marker.
    start, stop : int
        Frames ``start <= frame < stop``, counted from the clip's first as 0.
    filled : int
        How many of the frames were filled.
    expected_rms : float
        Expected rms Euclidean error (mm) over the filled frames; NaN where unknown.
    expected_mean_error : float
        Expected mean Euclidean error (mm) over the filled frames; NaN where unknown.
    error_bound_90 : float
        Distance (mm) below which 90 % of the errors of the filled frames are expected to lie; NaN
        where unknown.
    method : str
        The method used.
    sources : tuple of str
        What it was filled from.
    training_poses : int
        How many poses were learnt from; where parts of the gap were filled from different numbers
        of them, the most. 0: from none, as by a bridge over time.
    unfilled : tuple of LeftMissing
        Frames that were left missing; empty where all were filled.
    source_clips : tuple of str
        Recordings that were learnt from, the most used first.
    """

    label: str
    start: int
    stop: int
    filled: int
    expected_rms: float
    expected_mean_error: float
    error_bound_90: float
    method: str
    sources: tuple[str, ...]
    training_poses: int
    unfilled: tuple[UnfilledSpan, ...]
    source_clips: tuple[str, ...]

    @property
    def frames(self) -> int:
        """Length of the gap in frames."""
        return self.stop - self.start

    @property
    def complete(self) -> bool:
        """Whether every frame of the gap was filled that was to be."""
        return not any(part.requested for part in self.unfilled)


@dataclass(frozen=True, eq=False)
class Result:
    """A filled clip, and what is known of each gap.

    Attributes
    ----------
    clip : Clip
        The clip with its gaps filled; measured samples are those of the clip given, bit for bit.
    filled : ndarray of bool [shape=(frames, markers)]
        Which samples were filled.
    deviation : ndarray [shape=(frames, markers), mm]
        Expected rms Euclidean error of each filled sample; NaN elsewhere and where unknown.
    error_bound_90 : ndarray [shape=(frames, markers), mm]
        Distance below which 90 % of the errors are expected to lie, of each filled sample; NaN
        elsewhere and where unknown.
    gaps : tuple of FilledGap
        Every gap of the clip given, in order of time.
    method : str
        The method used.
    marker_set : MarkerSet
        How the markers were understood.
    database : Path or None
        The prior database, if there was one.
    rejected : ndarray of bool [shape=(frames, markers)]
        Which measured samples were treated as missing. Those of them that are not filled are in the
        clip as they were measured.
    trouble : tuple of Trouble
        Why they were.
    notes : tuple of str
        What of the database was not learnt from, and why, a sentence each.
    """

    clip: Clip
    filled: NDArray[np.bool_]
    expected_rms: NDArray[np.float64]
    error_bound_90: NDArray[np.float64]
    gaps: tuple[FilledGap, ...]
    method: str
    marker_set: MarkerSet
    rejected: NDArray[np.bool_]
    artefacts: tuple[Artefact, ...] = ()
    database: Path | None = None
    notes: tuple[str, ...] = ()

    @property
    def complete(self) -> bool:
        """Whether everything was filled that was to be."""
        return all(gap.complete for gap in self.gaps)
