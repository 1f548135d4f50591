"""One case, filled by one method and compared with the truth."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.database import Selection
from priorfill.errors import MethodError, PriorfillError
from priorfill.evaluation.gap_generator import Mask
from priorfill.evaluation.joint_angles import joint_errors
from priorfill.evaluation.metrics import MEASURES, SampleErrors, measure
from priorfill.filling.fill_clip import fill
from priorfill.filling.fill_options import FillOptions
from priorfill.filling.plausibility_options import UNCHECKED
from priorfill.filling.result import FilledGap, Result
from priorfill.gaps import Gap
from priorfill.markers.describe import describe
from priorfill.markers.marker_set import MarkerSet

__all__ = ["EvaluatedClip", "FillOutcome", "GapCase", "GapSource", "run_case"]


@dataclass(frozen=True, eq=False)
class EvaluatedClip:
    """A clip to evaluate methods on, and what its fills may learn from.

    Attributes
    ----------
    clip : Clip
        The ground truth, with or without gaps of its own.
    marker_set : MarkerSet or None
        The marker set; None: recognised, or found from the samples that are not removed.
    database : Path or None
        The prior database.
    selection : Selection
        Clips of the database to learn from, without any version of the clip itself.
    trust_filled : bool
        Whether filled samples of the database are learnt from.
    """

    clip: Clip
    marker_set: MarkerSet | None = None
    database: Path | None = None
    selection: Selection = field(default_factory=Selection)
    trust_filled: bool = False


@dataclass(frozen=True)
class GapCase:
    """The gaps that are made in a clip at the same time.

    Attributes
    ----------
    clip : int
        Index of the clip.
    name : str
        What is removed: ``random``, a marker, a group of markers.
    copy : int
        Number of the copy, from 1.
    gaps : tuple of Gap
        The runs of samples that are removed.
    """

    clip: int
    name: str
    copy: int
    gaps: tuple[Gap, ...]

    @property
    def samples(self) -> int:
        """Number of samples removed."""
        return sum(gap.frames for gap in self.gaps)

    def mask(self, clip: Clip) -> Mask:
        """Return which samples are removed [shape=(frames, markers)]."""
        removed = np.zeros_like(clip.missing)
        for gap in self.gaps:
            removed[gap.start : gap.stop, gap.marker] = True
        return removed


@dataclass(frozen=True)
class GapSource:
    """What a gap was filled from; the names are those of `priorfill.FilledGap`.

    Attributes
    ----------
    sources : tuple of str
        What its samples were filled from.
    source_clips : tuple of str
        Names of the recordings in the training data.
    training_poses : int
        Number of training poses or windows.
    unfilled : tuple of str
        Reasons why samples were not filled.
    """

    sources: tuple[str, ...] = ()
    source_clips: tuple[str, ...] = ()
    training_poses: int = 0
    unfilled: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class FillOutcome:
    """The errors of a method in a case.

    Attributes
    ----------
    seconds : float
        CPU time, so that other work of the machine does not count.
    samples : ndarray [shape=(6, samples)]
        `priorfill.evaluation.metrics.MEASURES` of the samples removed, gap by gap.
    joints : dict of str to ndarray [degrees]
        Errors of joint angles, by joint.
    gap_sources : tuple of GapSource
        What each gap was filled from; empty where the method could not work.
    refused : str
        Why the method could not work; empty where it did.
    notes : tuple of str
        Notes of the fill, such as clips of the database that were left out.
    """

    seconds: float
    samples: SampleErrors
    joints: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    gap_sources: tuple[GapSource, ...] = ()
    refused: str = ""
    notes: tuple[str, ...] = ()


def run_case(source: EvaluatedClip, case: GapCase, method: str) -> FillOutcome:
    """Remove the samples of a case, fill it by a method, and measure the errors.

    If the method cannot work on the case, or fails unexpectedly, all samples stay missing, and the
    outcome has the reason.

    Parameters
    ----------
    source : EvaluatedClip
        The clip of the case.
    case : GapCase
        The gaps.
    method : str
        A name in `priorfill.methods.METHODS`.

    Returns
    -------
    FillOutcome
        Errors, sources and CPU time.

    Raises
    ------
    PriorfillError
        Where something other than the method fails, such as reading the database.
    """
    truth = source.clip
    removed = case.mask(truth)
    positions = truth.positions.copy()
    positions[removed] = np.nan
    begin = time.process_time()
    options = FillOptions(
        marker_set=source.marker_set,
        selection=source.selection,
        trust_filled=source.trust_filled,
        # methods are compared on all samples that they fill, so nothing is left out afterwards
        extrapolate=math.inf,
        plausibility=UNCHECKED,
        estimate_errors=False,
    )
    try:
        result = fill(
            truth.with_positions(positions),
            database=source.database,
            method=method,
            options=options,
        )
    except MethodError as error:
        return _refusal(case, begin, " ".join(str(error).split()))
    except PriorfillError:
        raise
    except Exception as error:  # a fault in one method must not end the evaluation of the others
        text = " ".join(f"{type(error).__name__}: {error}".split())
        return _refusal(case, begin, f"a fault of the method ({text})")
    seconds = time.process_time() - begin
    marker_set = describe(truth, source.marker_set)
    filled = result.clip.positions
    return FillOutcome(
        seconds=seconds,
        samples=measure(
            truth.positions,
            filled,
            result.expected_rms_mm,
            result.error_bound_90_mm,
            case.gaps,
            truth.rate,
        ),
        joints=joint_errors(marker_set, truth.labels, truth.positions, filled, removed),
        gap_sources=tuple(_source_of(result, gap, truth.labels[gap.marker]) for gap in case.gaps),
        notes=result.notes,
    )


def _refusal(case: GapCase, begin: float, reason: str) -> FillOutcome:
    samples = np.full((len(MEASURES), case.samples), np.nan, dtype=np.float32)
    return FillOutcome(time.process_time() - begin, samples, refused=reason)


def _source_of(result: Result, gap: Gap, label: str) -> GapSource:
    """Return what an artificial gap was filled from."""
    filled = _containing(result.gaps, gap, label)
    reasons = [
        span.reason for span in filled.unfilled if span.start < gap.stop and span.stop > gap.start
    ]
    return GapSource(
        tuple(filled.sources),
        tuple(filled.source_clips),
        filled.training_poses,
        tuple(dict.fromkeys(reasons)),
    )


def _containing(gaps: Sequence[FilledGap], gap: Gap, label: str) -> FilledGap:
    """Return the filled gap that contains an artificial one.

    It is longer where the artificial gap is adjacent to one of the clip's own.
    """
    return next(g for g in gaps if g.label == label and g.start <= gap.start < g.stop)
