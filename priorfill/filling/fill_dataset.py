"""Fill the gaps of a dataset of poses in the layout of the package ``movement``."""

from __future__ import annotations

import json
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from priorfill.database import PriorDatabase
from priorfill.errors import OptionError
from priorfill.filling.fill_array import (
    ArrayAxes,
    ArrayKeywords,
    FilledArray,
    check_keywords,
    fill_array,
    find_axes,
)
from priorfill.filling.low_confidence import check_threshold
from priorfill.filling.poses_dataset import Poses, read_poses, with_fills

__all__ = ["fill_dataset"]


def fill_dataset(
    dataset: Any,
    *,
    min_confidence: float | None = None,
    rate: float | None = None,
    unit: str | None = None,
    up: str | None = None,
    database: PriorDatabase | Path | str | None = None,
    **options: Unpack[ArrayKeywords],
) -> Any:
    """Fill the gaps of poses in the layout of the package ``movement``.

    Each individual is filled by itself.

    Parameters
    ----------
    dataset : xarray.Dataset
        Poses in three dimensions: ``position`` (time, space, keypoints, individuals), NaN where
        missing, and optionally ``confidence`` (time, keypoints, individuals), in any order of the
        dimensions. What an earlier call marks as ``filled`` is filled again.
    min_confidence : float, optional
        Samples with a lower or an unknown confidence are dropped, which means that they are filled
        as if they were missing. Without it, only missing samples are filled.
    rate : float, optional
        Frame rate (Hz); by default that of the time coordinate, or ``fps``.
    unit, up, database, **options
        As in `priorfill.fill_array`. Unit and up axis, where they are not given, are found from the
        individual with most samples.

    Returns
    -------
    xarray.Dataset
        The same with filled ``position`` and the further variables ``filled``, ``dropped``,
        ``expected_error`` (expected mean error) and ``error_bound_90``, over time, keypoints and
        individuals; errors are in the unit of the positions, and NaN where nothing was filled or
        they are unknown. Samples that could not be filled are NaN. The attribute ``priorfill``
        (JSON) has the unit, the threshold, and notes and provenance of each individual.

    Raises
    ------
    ClipError
        Where the layout differs, positions are two-dimensional, or the frame rate is unknown.
    OptionError
        Where `min_confidence` is given and the dataset has no confidences, or they are not within 0
        and 1, or an option is out of range.
    MethodError, DatabaseError
        As in `priorfill.fill`.

    See Also
    --------
    priorfill.fill_array : Fill an array.

    Examples
    --------
    >>> from movement.io import load_poses  # doctest: +SKIP
    >>> poses = load_poses.from_anipose_file("mouse.csv", fps=100)  # doctest: +SKIP
    >>> filled = pf.fill_dataset(poses, min_confidence=0.6, unit="mm")  # doctest: +SKIP
    >>> filled.expected_error.sel(keypoints="snout").max()  # doctest: +SKIP
    """
    check_keywords(options, ArrayKeywords, "fill_dataset")
    poses = read_poses(dataset, rate)
    if min_confidence is not None:
        check_threshold(min_confidence)
        if poses.confidence is None:
            raise OptionError(
                "`min_confidence` is given, but the dataset has no confidences; leave it out"
            )
    measured = ~np.isnan(poses.positions).any(axis=3)
    largest = int(measured.sum(axis=(1, 2)).argmax())
    axes = find_axes(poses.positions[largest], poses.keypoints, unit, up, "the dataset")
    given = _Arguments(min_confidence, axes, options)
    with ExitStack() as stack:
        if isinstance(database, (str, Path)):
            database = stack.enter_context(PriorDatabase.open(database))
        done = [_fill_individual(poses, k, database, given) for k in range(len(poses.individuals))]
    return _filled_dataset(dataset, poses, done, given)


@dataclass(frozen=True)
class _Arguments:
    """What the fills of all individuals share."""

    min_confidence: float | None
    axes: ArrayAxes
    options: ArrayKeywords


def _fill_individual(
    poses: Poses, number: int, database: PriorDatabase | None, given: _Arguments
) -> FilledArray | None:
    """Fill one individual; None if it has no sample to learn from."""
    positions, confidence = poses.positions[number], None
    usable = ~np.isnan(positions).any(axis=2)
    if given.min_confidence is not None and poses.confidence is not None:
        confidence = poses.confidence[number]
        usable &= confidence >= given.min_confidence
    if not usable.any():
        return None
    return fill_array(
        positions,
        poses.keypoints,
        poses.rate,
        confidence=confidence,
        min_confidence=given.min_confidence,
        unit=given.axes.unit,
        up=given.axes.up,
        database=database,
        name=poses.individuals[number],
        **given.options,
    )


def _filled_dataset(
    dataset: Any, poses: Poses, done: list[FilledArray | None], given: _Arguments
) -> Any:
    """Put the fills of all individuals into a dataset."""
    positions, dropped = poses.positions.copy(), poses.dropped.copy()
    filled = np.zeros(dropped.shape, dtype=bool)
    error, bound = np.full((2, *dropped.shape), np.nan)
    facts: dict[str, Any] = {}
    for k, (name, one) in enumerate(zip(poses.individuals, done, strict=True)):
        if one is None:
            dropped[k] |= ~np.isnan(positions[k]).any(axis=2)
            positions[k][dropped[k]] = np.nan
            facts[name] = {"notes": ["No sample can be learnt from; nothing is filled."]}
            continue
        positions[k], filled[k] = one.positions, one.filled
        dropped[k] |= one.dropped
        error[k], bound[k] = one.expected_mean_error, one.error_bound_90
        facts[name] = {
            "notes": list(one.notes),
            "provenance": one.result.provenance.to_dict(),
        }
    record = {
        "unit": given.axes.unit,
        "up": given.axes.up,
        "min_confidence": given.min_confidence,
        "notes": [*poses.notes, *given.axes.notes],
        "individuals": facts,
    }
    length = {"units": given.axes.unit}
    variables = {
        "filled": (filled, {"long_name": "sample was filled by priorfill"}),
        "dropped": (dropped, {"long_name": "sample was measured with too low a confidence"}),
        "expected_error": (error, {"long_name": "expected mean error", **length}),
        "error_bound_90": (bound, {"long_name": "90 % of the errors are below", **length}),
    }
    return with_fills(dataset, positions, variables, {"priorfill": json.dumps(record)})
