"""One case filled by one method, and compared with the truth."""

from __future__ import annotations

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
from priorfill.filling.result import Result
from priorfill.gaps import Gap
from priorfill.markers.describe import describe
from priorfill.markers.marker_set import MarkerSet

__all__ = ["EvaluatedClip", "FillOutcome", "GapCase", "run_case"]


@dataclass(frozen=True, eq=False)
class EvaluatedClip:
    """A clip to be evaluated on, and what fills of it may learn from.

    Attributes
    ----------
    clip : Clip
        The truth, with gaps of its own or without.
    marker_set : MarkerSet or None
        The set that was asked for; None: recognised, or found from what is left of the clip.
    database : Path or None
        The prior database.
    selection : Selection
        What of the database may be learnt from: nothing of the clip itself.
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
    """What is removed from a clip.

    Attributes
    ----------
    clip : int
        Index of the clip.
    name : str
        What is removed: ``random``, a marker, a group.
    copy : int
        Which of several alike, from 1.
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
        """Return what is removed [shape=(frames, markers)]."""
        gone = np.zeros_like(clip.missing)
        for gap in self.gaps:
            gone[gap.start : gap.stop, gap.marker] = True
        return gone


@dataclass(frozen=True, eq=False)
class FillOutcome:
    """What a method made of a case.

    Attributes
    ----------
    seconds : float
        Of computing: what else the machine does meanwhile is no concern of the method.
    samples : ndarray [shape=(6, samples)]
        `priorfill.evaluation.metrics.MEASURES` of the samples removed, gap by gap.
    joints : dict of str to ndarray [degrees]
        Errors of joint angles.
    how : tuple of str
        For each gap, what it was filled from and why not.
    refused : str
        Why the method could not work; empty where it did.
    notes : tuple of str
        What of the database was not learnt from.
    """

    seconds: float
    samples: SampleErrors
    joints: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    how: tuple[str, ...] = ()
    refused: str = ""
    notes: tuple[str, ...] = ()


def run_case(source: EvaluatedClip, case: GapCase, method: str) -> FillOutcome:
    """Remove the samples of a case, fill it with a method, and compare.

    A method that cannot work on the case, or fails by a fault of its own, leaves all samples
    missing and says why.

    Raises
    ------
    PriorfillError
        Where it is not the method that fails: the database cannot be read.
    """
    truth = source.clip
    gone = case.mask(truth)
    positions = truth.positions.copy()
    positions[gone] = np.nan
    begin = time.process_time()
    try:
        result = fill(
            truth.with_positions(positions),
            database=source.database,
            method=method,
            options=FillOptions(
                marker_set=source.marker_set,
                selection=source.selection,
                trust_filled=source.trust_filled,
            ),
        )
    except MethodError as error:
        return _refusal(case, begin, " ".join(str(error).split()))
    except PriorfillError:
        raise
    except Exception as error:  # one method's fault is not that of the others
        text = " ".join(f"{type(error).__name__}: {error}".split())
        return _refusal(case, begin, f"a fault of the method ({text})")
    seconds = time.process_time() - begin
    marker_set = describe(truth, source.marker_set)
    return FillOutcome(
        seconds=seconds,
        samples=measure(
            truth.positions,
            result.clip.positions,
            result.expected_rms,
            result.error_bound_90,
            case.gaps,
            truth.rate,
        ),
        joints=joint_errors(marker_set, truth.labels, truth.positions, result.clip.positions, gone),
        how=tuple(_how(result, case.gaps, truth.labels)),
        notes=result.notes,
    )


def _refusal(case: GapCase, begin: float, reason: str) -> FillOutcome:
    samples = np.full((len(MEASURES), case.samples), np.nan, dtype=np.float32)
    return FillOutcome(time.process_time() - begin, samples, refused=reason)


def _how(result: Result, gaps: Sequence[Gap], labels: Sequence[str]) -> list[str]:
    """Return for each gap what it was filled from, and why a part of it was not."""
    told = []
    for gap in gaps:
        # a gap that touches one of the clip's own is part of a longer one
        whole = next(
            g
            for g in result.gaps
            if g.label == labels[gap.marker] and g.start <= gap.start < g.stop
        )
        left = dict.fromkeys(
            f"NOT: {part.reason}"
            for part in whole.unfilled
            if part.start < gap.stop and part.stop > gap.start
        )
        told.append("; ".join([*whole.sources, *left]))
    return told
