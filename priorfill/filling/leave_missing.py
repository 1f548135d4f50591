"""Take back filled samples of a result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.filling.assemble import expected_errors
from priorfill.filling.multi_subject import merge_results
from priorfill.filling.result import FilledGap, Result, UnfilledSpan
from priorfill.gaps import runs

__all__ = ["leave_missing"]


def leave_missing(
    result: Result, measured: Sequence[Clip], samples: NDArray[np.bool_], reason: str
) -> Result:
    """Take back filled samples, so that they are missing as they were.

    Parameters
    ----------
    result : Result
        Of a fill.
    measured : sequence of Clip
        The clip that was filled; of several subjects each, in their order.
    samples : ndarray of bool [shape=(frames, markers)]
        The samples; those that were not filled are ignored.
    reason : str
        Why they stay missing.

    Returns
    -------
    Result
        The result without them. Samples that were rejected have their measured position again.
    """
    if not (samples & result.filled).any():
        return result
    ends = np.cumsum([clip.positions.shape[1] for clip in measured])[:-1]
    return merge_results(
        [
            _without(one, clip, own & one.filled, reason)
            for one, clip, own in zip(
                result.by_subject, measured, np.split(samples, ends, axis=1), strict=True
            )
        ]
    )


def _without(result: Result, measured: Clip, samples: NDArray[np.bool_], reason: str) -> Result:
    """Return the result of one subject without some of its filled samples."""
    filled = result.filled & ~samples
    without = replace(
        result,
        clip=result.clip.with_positions(
            np.where(samples[..., None], measured.positions, result.clip.positions)
        ),
        filled=filled,
        expected_rms_mm=np.where(filled, result.expected_rms_mm, np.nan),
        error_bound_90_mm=np.where(filled, result.error_bound_90_mm, np.nan),
    )
    gaps = tuple(_updated(gap, without, samples, reason) for gap in result.gaps)
    return replace(without, gaps=gaps)


def _updated(gap: FilledGap, result: Result, samples: NDArray[np.bool_], reason: str) -> FilledGap:
    """Return what became of a gap without some samples."""
    inside = slice(gap.start, gap.stop), result.clip.labels.index(gap.label)
    taken = samples[inside]
    if not taken.any():
        return gap
    spans = [
        UnfilledSpan(gap.start + start, gap.start + stop, reason) for start, stop in runs(taken)
    ]
    filled = int(result.filled[inside].sum())
    rms, mean, bound = expected_errors(
        result.expected_rms_mm[inside], result.error_bound_90_mm[inside]
    )
    return replace(
        gap,
        filled=filled,
        expected_rms_mm=rms,
        expected_mean_error_mm=mean,
        error_bound_90_mm=bound,
        sources=gap.sources if filled else (),
        unfilled=tuple(sorted([*gap.unfilled, *spans], key=lambda span: span.start)),
    )
