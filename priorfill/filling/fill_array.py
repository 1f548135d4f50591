"""Fill the gaps of an array, with samples of low confidence treated as missing."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from priorfill.clip import MAX_NAME, Clip, blank_incomplete_samples
from priorfill.errors import ClipError, escaped
from priorfill.filling.fill_clip import fill
from priorfill.filling.fill_options import FillOptions
from priorfill.filling.gap_filter import GapFilter
from priorfill.filling.low_confidence import LowConfidence, find_low_confidence
from priorfill.filling.result import Result
from priorfill.formats.point_kinds import split_label
from priorfill.formats.recording import check_coordinates, notes_on_marks
from priorfill.formats.subjects import choose_subject
from priorfill.formats.units import UNITS, find_unit
from priorfill.formats.up_axis import find_up_axis
from priorfill.gp.calibration import MEAN_FACTOR
from priorfill.runtime.argument_types import check_number, check_type

if TYPE_CHECKING:
    from priorfill.database import PriorDatabase

__all__ = ["ArrayAxes", "ArrayKeywords", "FilledArray", "fill_array", "find_axes"]


class ArrayKeywords(TypedDict, total=False):
    """Arguments of `priorfill.fill` that apply to arrays."""

    same_subject: Sequence[Clip]
    method: str
    gap_filter: GapFilter | None
    reject_artefacts: bool
    options: FillOptions | None


class NamedArrayKeywords(ArrayKeywords, total=False):
    """The same, and the name of the array."""

    name: str


@dataclass(frozen=True, eq=False)
class FilledArray:
    """A filled array, and what is known about each sample.

    Attributes
    ----------
    positions : ndarray [shape=(frames, markers, 3), unit]
        In the unit, axes and floating-point type given. What was measured and not dropped keeps its
        bits; samples that are still missing are NaN.
    filled : ndarray of bool [shape=(frames, markers)]
        Which samples were filled.
    dropped : ndarray of bool [shape=(frames, markers)]
        Which samples were measured, but with too low a confidence. ``dropped & filled`` were
        replaced; ``dropped & ~filled`` could not be filled and are NaN.
    expected_mean_error : ndarray [shape=(frames, markers), unit]
        Expected Euclidean error of each filled sample; NaN elsewhere and where unknown.
    error_bound_90 : ndarray [shape=(frames, markers), unit]
        Distance below which 90 % of the errors are expected to lie; NaN likewise.
    unit : str
        The unit of length, given or assumed.
    notes : tuple of str
        What was assumed and what was dropped, a sentence each.
    result : Result
        The fill, in mm: each gap with what it was filled from, or why it stays missing.

    See Also
    --------
    priorfill.fill_array : Fill an array.

    Examples
    --------
    >>> import priorfill as pf
    >>> from priorfill.synthetic.demo import make_demo_clip
    >>> clip = make_demo_clip()[1]
    >>> pf.fill_array(clip.positions, clip.labels, clip.rate, unit="mm", method="linear")
    <FilledArray array: 6034 samples filled, 560 still missing, 90 % bounds up to 1140 mm>
    """

    positions: NDArray[np.floating[Any]]
    filled: NDArray[np.bool_]
    dropped: NDArray[np.bool_]
    expected_mean_error: NDArray[np.float64]
    error_bound_90: NDArray[np.float64]
    unit: str
    notes: tuple[str, ...]
    result: Result

    @property
    def missing(self) -> NDArray[np.bool_]:
        """Which samples are still missing [shape=(frames, markers), bool]."""
        missing: NDArray[np.bool_] = np.isnan(self.positions).any(axis=2)
        return missing

    def __repr__(self) -> str:
        dropped = int(self.dropped.sum())
        known = self.error_bound_90[np.isfinite(self.error_bound_90)]
        parts = [
            f"{int(self.filled.sum())} samples filled",
            f"{int((self.filled & self.dropped).sum())} of {dropped} dropped ones" * bool(dropped),
            f"{int(self.missing.sum())} still missing" * bool(self.missing.any()),
            f"90 % bounds up to {_rounded(known.max())} {self.unit}" if known.size else "",
        ]
        name = self.result.clip.name[:MAX_NAME]
        return escaped(f"<FilledArray {name}: {', '.join(part for part in parts if part)}>")


def fill_array(
    positions: ArrayLike,
    labels: Sequence[str],
    rate: float,
    *,
    confidence: ArrayLike | None = None,
    min_confidence: float | None = None,
    unit: str | None = None,
    up: str | None = None,
    database: PriorDatabase | Path | str | None = None,
    **options: Unpack[NamedArrayKeywords],
) -> FilledArray:
    """Fill the gaps of an array, for instance of markerless motion capture.

    Parameters
    ----------
    positions : array_like [shape=(frames, markers, 3), unit]
        Of one body, which is a person or an animal; NaN where missing. Samples at exactly (0, 0, 0)
        are missing, too, unless the marker is there in all frames: then it is the origin of the
        poses.
    labels : sequence of str
        The markers' names, unique. Known names, such as those of a marker set, help, but are not
        needed.
    rate : float
        Frame rate (Hz).
    confidence : array_like [shape=(frames, markers)], optional
        Confidence of each sample, from 0 to 1. NaN is an unknown confidence.
    min_confidence : float, optional
        Samples with a lower or an unknown confidence are dropped, which means that they are filled
        as if they were missing; required with `confidence`. There is no default, because what a
        confidence is worth depends on the program that states it.
    unit : str, optional
        Unit of length (mm, cm, m, ...); by default assumed from the size of a person, so it should
        be given for animals.
    up : str, optional
        The axis that points up (``"+Z"``, ``"-Y"``, ...); by default found from the positions.
    database : PriorDatabase or path, optional
        Recordings to learn from, besides the array itself.
    **options
        ``name`` (in messages), and ``same_subject`` (clips, for instance of
        `priorfill.interop.from_arrays`), ``method``, ``gap_filter``, ``reject_artefacts`` and
        ``options`` of `priorfill.fill`.

    Returns
    -------
    FilledArray
        The filled array, masks, and expected errors in the unit given.

    Raises
    ------
    ClipError
        Where shapes do not match, positions are not three-dimensional, labels repeat or are those
        of several subjects, a coordinate is infinite, or no sample is left.
    OptionError
        Where confidences are not within 0 and 1, come without a threshold, or are unknown
        throughout, or an option is out of range.
    MethodError, DatabaseError
        As in `priorfill.fill`.

    See Also
    --------
    priorfill.fill : Fill a clip.
    priorfill.fill_dataset : Fill a dataset of the package ``movement``.

    Examples
    --------
    >>> import numpy as np
    >>> import priorfill as pf
    >>> from priorfill.synthetic import synthesise
    >>> walk = synthesise("walking", seconds=2.0, rate=30.0)
    >>> confidence = np.full(walk.missing.shape, 0.9)
    >>> knee = walk.labels.index("LKNE")
    >>> confidence[20:30, knee] = 0.1
    >>> done = pf.fill_array(
    ...     walk.positions / 1000,
    ...     walk.labels,
    ...     30.0,
    ...     confidence=confidence,
    ...     min_confidence=0.6,
    ...     unit="m",
    ... )
    >>> int((done.dropped & done.filled).sum()), bool(done.expected_mean_error[25, knee] < 0.1)
    (10, True)
    """
    check_keywords(options, NamedArrayKeywords, "fill_array")
    name = options.pop("name", "array")
    given = _numbers(positions, name)
    check_type("labels", labels, Iterable, "a list of names, one for each marker")
    check_number("rate", rate)
    texts = _checked_labels(labels, given.shape, name)
    notes = _blank_zeros(given)
    measured = ~np.isnan(given).any(axis=2)
    low = find_low_confidence(confidence, min_confidence, measured, texts, name)
    given[low.samples] = np.nan
    if not (measured & ~low.samples).any():
        raise ClipError(f"{name}: has no sample{low.condition}; there is nothing to learn from")
    axes = find_axes(given, texts, unit, up, name)
    clip = Clip(given.astype(np.float64) * UNITS[axes.unit], texts, float(rate), axes.up, name)
    result = fill(clip, database=database, **cast(ArrayKeywords, options))
    return _filled_array(result, given, low, axes, (*notes, *low.notes))


def check_keywords(given: Mapping[str, Any], known: type, function: str) -> None:
    """Raise TypeError for a keyword argument that a function does not have.

    Parameters
    ----------
    given : mapping of str to object
        The arguments.
    known : type
        A TypedDict of those that it has.
    function : str
        Name of the function.
    """
    unknown = given.keys() - known.__annotations__.keys()
    if unknown:
        raise TypeError(f"{function}() got an unexpected keyword argument {min(unknown)!r}")


@dataclass(frozen=True)
class ArrayAxes:
    """What the coordinates of an array mean.

    Attributes
    ----------
    unit : str
        Unit of length, one of `priorfill.formats.units.UNITS`.
    up : str
        The axis that points up, one of `priorfill.geometry.axes.UP_AXES`.
    notes : tuple of str
        What was assumed, a sentence each.
    """

    unit: str
    up: str
    notes: tuple[str, ...]


def find_axes(
    positions: NDArray[np.floating[Any]],
    labels: tuple[str, ...],
    unit: str | None,
    up: str | None,
    name: str,
) -> ArrayAxes:
    """Find unit and up axis of an array.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3)]
        NaN where missing.
    labels : tuple of str
        The markers' names.
    unit, up : str or None
        What the user gives; assumed if None.
    name : str
        Name of the array in messages.

    Raises
    ------
    ClipError
        If a coordinate is infinite.
    OptionError
        If the unit or the axis is unknown.
    """
    for argument, value in (("unit", unit), ("up", up)):
        check_type(argument, value, (str, type(None)), "a text, or None")
    values = positions.astype(np.float64)
    blank_incomplete_samples(values)
    check_coordinates(values, labels, 0, name)
    found, mm_per_unit, unit_notes = find_unit(values, "", unit, name)
    axis, _, up_notes = find_up_axis(values * mm_per_unit, labels, "", up)
    return ArrayAxes(found, axis, (*notes_on_marks(values), *unit_notes, *up_notes))


def _numbers(positions: ArrayLike, name: str) -> NDArray[np.floating[Any]]:
    """Return a copy of positions as floating-point numbers, NaN where they are masked."""
    try:
        given: Any = np.ma.asarray(positions)
        if given.dtype.kind == "c":
            raise TypeError("they are complex")
        kind = given.dtype if given.dtype.kind == "f" else np.dtype(np.float64)
        values = np.array(np.ma.filled(given.astype(kind), np.nan))
    except (TypeError, ValueError) as error:
        raise ClipError(f"{name}: positions are no array of numbers ({error})") from None
    if values.ndim == 3 and values.shape[2] == 2:
        raise ClipError(
            f"{name}: positions are two-dimensional, as in images; three-dimensional ones are "
            "needed: triangulate them first"
        )
    if values.ndim != 3 or values.shape[2] != 3:
        raise ClipError(
            f"{name}: positions have shape {values.shape}; (frames, markers, 3) is needed"
        )
    return values


def _checked_labels(labels: Sequence[str], shape: tuple[int, ...], name: str) -> tuple[str, ...]:
    """Return the names of the markers, without the prefix of a subject that all have."""
    if isinstance(labels, str):
        raise ClipError(f"{name}: labels are one text, {labels!r}; give a name for each marker")
    texts = tuple(str(label) for label in labels)
    if len(texts) != shape[1]:
        raise ClipError(
            f"{name}: {shape[1]} markers but {len(texts)} labels; give one label for each marker"
        )
    split = [split_label(text, ()) for text in texts]
    choose_subject({k: owner for k, (owner, _) in enumerate(split)}, None, (), name)
    short = tuple(marker for _, marker in split)
    return short if all(short) and len(set(short)) == len(short) else texts


def _blank_zeros(positions: NDArray[np.floating[Any]]) -> tuple[str, ...]:
    """Blank samples at the origin in place, but for markers that are always there."""
    zero = (positions == 0).all(axis=2)
    origin = (zero | np.isnan(positions).any(axis=2)).all(axis=0)
    zero[:, origin] = False
    positions[zero] = np.nan
    count = int(zero.sum())
    return (f"{count} samples at (0, 0, 0) are taken as missing.",) if count else ()


def _filled_array(
    result: Result,
    given: NDArray[np.floating[Any]],
    low: LowConfidence,
    axes: ArrayAxes,
    notes: tuple[str, ...],
) -> FilledArray:
    """Put filled samples into positions, in place and in their unit."""
    mm_per_unit = UNITS[axes.unit]
    filled, blank = result.filled, np.isnan(given)
    # of a sample with one or two coordinates, these are measured
    replaced = np.where((blank.any(axis=2) & ~blank.all(axis=2))[..., None], blank, True)
    replaced &= filled[..., None]
    given[replaced] = (result.clip.positions / mm_per_unit)[replaced]
    left = int((low.samples & ~filled).sum())
    if left:
        notes = (*notes, f"{left} dropped samples could not be filled and are NaN.")
    return FilledArray(
        given,
        filled,
        low.samples,
        MEAN_FACTOR * result.expected_rms_mm / mm_per_unit,
        result.error_bound_90_mm / mm_per_unit,
        axes.unit,
        (*notes, *axes.notes, *result.notes),
        result,
    )


def _rounded(value: float) -> str:
    """Return a number with three digits, without an exponent where it is above 1000."""
    return f"{float(f'{value:.3g}'):g}"
