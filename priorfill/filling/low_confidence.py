"""Which samples of an array have too low a confidence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from priorfill.errors import OptionError
from priorfill.runtime.argument_types import check_number

__all__ = ["LowConfidence", "check_threshold", "find_low_confidence"]

MAX_CONFIDENCE = 1.5
"""Largest confidence accepted. Some networks state slightly more than 1 (SLEAP up to about 1.05,
github.com/talmolab/sleap issue 521); percentages and errors in pixels are larger."""

_SHOWN_THRESHOLDS = (0.3, 0.6, 0.9)
"""Thresholds whose consequences the message lists where none is given."""

_MAX_NAMES = 6
"""Number of markers that a note lists."""


@dataclass(frozen=True, eq=False)
class LowConfidence:
    """Measured samples that are not used.

    Attributes
    ----------
    samples : ndarray of bool [shape=(frames, markers)]
        Those with a lower or an unknown confidence.
    condition : str
        What the others fulfil, as the end of a sentence; empty without confidences.
    notes : tuple of str
        How many they are, a sentence each.
    """

    samples: NDArray[np.bool_]
    condition: str = ""
    notes: tuple[str, ...] = ()


def find_low_confidence(
    confidence: ArrayLike | None,
    min_confidence: float | None,
    measured: NDArray[np.bool_],
    labels: tuple[str, ...],
    name: str,
) -> LowConfidence:
    """Find measured samples with too low a confidence.

    Parameters
    ----------
    confidence : array_like [shape=(frames, markers)] or None
        From 0 to 1; NaN where unknown. What it is where nothing was measured does not matter.
    min_confidence : float or None
        The least confidence of samples that are used; required with `confidence`.
    measured : ndarray of bool [shape=(frames, markers)]
        Which samples are measured.
    labels : tuple of str
        The markers' names.
    name : str
        Name of the array in messages.

    Raises
    ------
    OptionError
        If only one of `confidence` and `min_confidence` is given, shapes differ, or confidences
        are out of range or unknown throughout.

    Examples
    --------
    >>> import numpy as np
    >>> measured = np.ones((2, 2), dtype=bool)
    >>> find_low_confidence([[0.9, 0.2], [0.8, 0.7]], 0.6, measured, ("a", "b"), "array").notes
    ('1 of 4 measured samples has a confidence below 0.6 and is dropped (b 1).',)
    """
    if confidence is None:
        if min_confidence is not None:
            raise OptionError(
                f"{name}: `min_confidence` is given without `confidence`; give both or neither"
            )
        return LowConfidence(np.zeros_like(measured))
    values = _checked(confidence, measured, labels, name)
    if min_confidence is None:
        shares = ", ".join(
            f"{100 * (values[measured] < one).mean():.0f} % below {one:g}"
            for one in _SHOWN_THRESHOLDS
        )
        raise OptionError(
            f"{name}: `confidence` is given without a threshold; give `min_confidence` "
            f"(of the measured samples {shares})"
        )
    check_threshold(min_confidence)
    below, unknown = measured & (values < min_confidence), measured & np.isnan(values)
    total = int(measured.sum())
    notes = [
        f"{count} of {total} measured samples {'has' if count == 1 else 'have'} {what} and "
        f"{'is' if count == 1 else 'are'} dropped ({_counts(samples, labels)})."
        for samples, what in (
            (below, f"a confidence below {min_confidence:g}"),
            (unknown, "an unknown confidence (NaN)"),
        )
        if (count := int(samples.sum()))
    ]
    condition = f" with a confidence of at least {min_confidence:g}"
    return LowConfidence(below | unknown, condition, tuple(notes))


def check_threshold(min_confidence: float) -> None:
    """Raise OptionError for a threshold that is not above 0 and at most 1."""
    check_number("min_confidence", min_confidence)
    if not 0 < min_confidence <= 1:
        raise OptionError(
            f"`min_confidence` is {min_confidence:g}; it must be above 0 and at most 1"
        )


def _checked(
    confidence: ArrayLike, measured: NDArray[np.bool_], labels: tuple[str, ...], name: str
) -> NDArray[np.float64]:
    """Return confidences as numbers, after all checks."""
    try:
        values = np.array(np.ma.filled(np.ma.asarray(confidence, dtype=np.float64), np.nan))
    except (TypeError, ValueError) as error:
        raise OptionError(f"{name}: `confidence` is no array of numbers ({error})") from None
    if values.shape != measured.shape:
        hint = ""
        if values.shape == measured.shape[::-1]:
            hint = "; transpose it"
        elif values.ndim == 1 and len(values) in measured.shape:
            which = "frame" if len(values) == len(measured) else "marker"
            hint = f"; repeat the value of each {which} with numpy.broadcast_to"
        raise OptionError(
            f"{name}: `confidence` has shape {values.shape}; (frames, markers), here "
            f"{measured.shape}, is needed{hint}"
        )
    stated = measured & ~np.isnan(values)
    if measured.any() and not stated.any():
        raise OptionError(
            f"{name}: `confidence` is NaN for all measured samples; leave it out, with "
            "`min_confidence`, to take them as measured"
        )
    wrong = stated & ((values < 0) | (values > MAX_CONFIDENCE))
    if wrong.any():
        frame, marker = np.argwhere(wrong)[0]
        raise OptionError(
            f"{name}: `confidence` of {labels[marker]} in frame {frame} is "
            f"{values[frame, marker]:g}; confidences must be within 0 and 1: convert percentages "
            "or errors first"
        )
    return values


def _counts(samples: NDArray[np.bool_], labels: tuple[str, ...]) -> str:
    """Return the markers that have most of some samples, with their number."""
    counts = samples.sum(axis=0)
    order = [int(marker) for marker in np.argsort(-counts, kind="stable") if counts[marker]]
    texts = [f"{labels[marker]} {counts[marker]}" for marker in order[:_MAX_NAMES]]
    more = len(order) - _MAX_NAMES
    return ", ".join([*texts, *([f"and {more} more markers"] if more > 0 else [])])
