"""Datasets of poses in the layout of the package ``movement``, as arrays and back.

The layout is that of a poses dataset of ``movement`` 0.15: variables ``position`` (time, space,
keypoints, individuals) and ``confidence`` (time, keypoints, individuals), with the dimensions in
any order; attributes ``fps`` and ``time_unit``. xarray is not imported: a dataset brings its own
methods.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.errors import ClipError
from priorfill.interop import rate_of_times
from priorfill.runtime.argument_types import check_number

__all__ = ["Poses", "read_poses", "with_fills"]

_ORDER = ("individuals", "time", "keypoints", "space")
_AXES = ("x", "y", "z")

_MAX_DEVIATION = 0.01
"""Largest deviation of the time steps from the stated frame rate, as a share, without a note."""


@dataclass(frozen=True, eq=False)
class Poses:
    """What a dataset of poses holds.

    Attributes
    ----------
    positions : ndarray [shape=(individuals, frames, keypoints, 3)]
        In the dataset's unit; NaN where missing, or where the dataset marks a sample as filled.
    confidence : ndarray [shape=(individuals, frames, keypoints)] or None
        None if the dataset has none, or if it is NaN throughout.
    dropped : ndarray of bool [shape=(individuals, frames, keypoints)]
        What the dataset marks as dropped.
    individuals, keypoints : tuple of str
        Their names.
    rate : float
        Frame rate (Hz).
    notes : tuple of str
        What a user should know, a sentence each.
    """

    positions: NDArray[np.floating[Any]]
    confidence: NDArray[np.float64] | None
    dropped: NDArray[np.bool_]
    individuals: tuple[str, ...]
    keypoints: tuple[str, ...]
    rate: float
    notes: tuple[str, ...]


def read_poses(dataset: Any, rate: float | None) -> Poses:
    """Return what a dataset of poses holds.

    Parameters
    ----------
    dataset : Dataset
        In the layout of ``movement``; the dimension ``individuals`` may be absent.
    rate : float or None
        Frame rate (Hz) that replaces the dataset's.

    Raises
    ------
    ClipError
        If the layout differs, positions are two-dimensional, the frame rate is unknown, or there
        are no individuals, frames or keypoints.
    """
    if not hasattr(dataset, "data_vars") or "position" not in dataset.data_vars:
        raise ClipError(
            "the dataset has no variable position; give a Dataset of poses in the layout of "
            "movement (time, space, keypoints, individuals)"
        )
    position = dataset["position"]
    if not set(_ORDER[1:]) <= set(position.dims) <= set(_ORDER):
        raise ClipError(
            f"position has the dimensions {', '.join(map(str, position.dims))}; time, space, "
            "keypoints and individuals are needed"
        )
    values = _expanded(position, _ORDER)
    values = np.array(values[..., _places_of_axes(position, values.shape[3])])
    if values.dtype.kind != "f":
        values = values.astype(np.float64)
    shape = values.shape[:3]
    for count, what in zip(shape, ("individuals", "frames", "keypoints"), strict=True):
        if count == 0:
            raise ClipError(f"the dataset has no {what}; there is nothing to fill")
    if rate is not None:
        check_number("rate", rate)
    found, notes = (float(rate), ()) if rate is not None else _frame_rate(dataset, shape[1])
    filled = _variable(dataset, "filled", shape)
    if filled is not None and filled.any():
        values[filled.astype(bool)] = np.nan
        notes = (*notes, f"{int(filled.sum())} samples that were filled before are filled again.")
    confidence = _variable(dataset, "confidence", shape)
    if confidence is not None and np.isnan(confidence.astype(np.float64)).all():
        confidence = None
    dropped = _variable(dataset, "dropped", shape)
    return Poses(
        values,
        confidence,
        np.zeros(shape, dtype=bool) if dropped is None else dropped.astype(bool),
        _names(position, "individuals", "id_", shape[0]),
        _names(position, "keypoints", "keypoint_", shape[2]),
        found,
        notes,
    )


def with_fills(
    dataset: Any,
    positions: NDArray[np.floating[Any]],
    variables: Mapping[str, tuple[NDArray[Any], Mapping[str, str]]],
    attributes: Mapping[str, str],
) -> Any:
    """Return a dataset with other positions and further variables.

    Parameters
    ----------
    dataset : Dataset
        As for `read_poses`.
    positions : ndarray [shape=(individuals, frames, keypoints, 3)]
        Its filled positions.
    variables : mapping of str to (ndarray [shape=(individuals, frames, keypoints)], mapping)
        Values and attributes of each further variable.
    attributes : mapping of str to str
        Further attributes.

    Returns
    -------
    Dataset
        A new one; `dataset` is not changed.
    """
    position = dataset["position"]
    places = _places_of_axes(position, 3)
    inverse = [places.index(axis) for axis in range(3)]
    made = {"position": position.copy(data=_as_stored(positions[..., inverse], position.dims))}
    dims = tuple(dim for dim in position.dims if dim != "space")
    further = {
        name: (dims, _as_stored(values, dims), dict(own))
        for name, (values, own) in variables.items()
    }
    return dataset.assign({**made, **further}).assign_attrs(attributes)


def _expanded(array: Any, order: tuple[str, ...]) -> NDArray[Any]:
    """Return values with their dimensions in order; those that are absent have length 1."""
    values = np.asarray(array.values)
    present = [dim for dim in order if dim in array.dims]
    values = values.transpose([array.dims.index(dim) for dim in present])
    return np.expand_dims(values, [k for k, dim in enumerate(order) if dim not in array.dims])


def _as_stored(values: NDArray[Any], dims: tuple[str, ...]) -> NDArray[Any]:
    """Return values with dimensions in the order of `_ORDER` in that of a variable."""
    order = _ORDER[: values.ndim]
    values = values.squeeze(0) if "individuals" not in dims else values
    kept = [dim for dim in order if dim in dims]
    return values.transpose([kept.index(dim) for dim in dims])


def _variable(dataset: Any, name: str, shape: tuple[int, ...]) -> NDArray[Any] | None:
    """Return a variable without space, if the dataset has it."""
    if name not in dataset.data_vars:
        return None
    array = dataset[name]
    if "time" not in array.dims or not set(array.dims) <= set(_ORDER[:3]):
        raise ClipError(
            f"{name} has the dimensions {', '.join(map(str, array.dims))}; time, keypoints and "
            "individuals are needed"
        )
    # a confidence for each individual holds for its keypoints
    return np.broadcast_to(_expanded(array, _ORDER[:3]), shape)


def _places_of_axes(position: Any, count: int) -> list[int]:
    """Return where x, y and z are along the dimension of space."""
    if count != 3:
        raise ClipError(
            f"the dataset has {count} spatial dimensions; 3 are needed: triangulate poses of "
            "images first"
        )
    if "space" not in position.coords:
        return [0, 1, 2]
    found = [str(axis) for axis in np.asarray(position.coords["space"].values)]
    if sorted(found) != list(_AXES):
        raise ClipError(f"space has the coordinates {', '.join(found)}; x, y, z are needed")
    return [found.index(axis) for axis in _AXES]


def _names(position: Any, dim: str, prefix: str, count: int) -> tuple[str, ...]:
    """Return the names along a dimension; those that ``movement`` gives where there are none."""
    if dim not in position.coords:
        return tuple(f"{prefix}{k}" for k in range(count))
    return tuple(str(name) for name in np.atleast_1d(np.asarray(position.coords[dim].values)))


def _frame_rate(dataset: Any, frames: int) -> tuple[float, tuple[str, ...]]:
    """Return the frame rate (Hz) by the times or ``fps``, and a note where they differ."""
    stated = dataset.attrs.get("fps")
    try:
        fps = float(stated) if stated is not None else float("nan")
    except (TypeError, ValueError):
        fps = float("nan")
    known = np.isfinite(fps) and fps > 0
    times = np.asarray(dataset.coords["time"].values) if "time" in dataset.coords else None
    if times is not None and times.dtype.kind in "mM":
        times = (times - times[0]) / np.timedelta64(1, "s")
        in_frames = False
    else:
        unit = dataset.attrs.get("time_unit")
        whole = times is None or times.dtype.kind in "iu"
        in_frames = unit == "frames" if unit in ("frames", "seconds") else whole
    if times is None or frames < 2:
        step = 1.0 if in_frames or not known else 1 / fps
    else:
        step = 1 / rate_of_times(times.astype(np.float64), "the dataset")
    if in_frames or (frames < 2 and times is not None):
        if not known:
            raise ClipError("the dataset has neither fps nor times in seconds; give `rate` (Hz)")
        return (fps / step if in_frames else fps), ()
    if known and abs(step * fps - 1) <= _MAX_DEVIATION:
        return fps, ()
    note = f"The times have {1 / step:g} Hz, fps is {fps:g}; the times are used."
    return 1 / step, (note,) if known else ()
