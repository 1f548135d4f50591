"""Clips from and to what other Python programs hold marker positions in.

* `from_timeseries`, `to_timeseries`: TimeSeries of Kinetics Toolkit,
* `from_xarray`, `to_xarray`: the DataArray of pyomeca, with dimensions axis, channel and time,
* `from_dataframe`, `to_dataframe`: pandas,
* `from_arrays`: NumPy.

None of these packages is needed for priorfill: what is given is looked at by its attributes, and
each ``to_`` takes the class to make, so that it may be of any version.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from priorfill.clip import Clip
from priorfill.errors import ClipError
from priorfill.formats.recording import ReadOptions, Recording, make_clip
from priorfill.formats.units import UNITS

__all__ = [
    "from_arrays",
    "from_dataframe",
    "from_timeseries",
    "from_xarray",
    "to_dataframe",
    "to_timeseries",
    "to_xarray",
]

_AXES = ("x", "y", "z")

_AXIS_COLUMN = re.compile(r"(?P<label>.+?)(?:[ _.:-]|\[)(?P<axis>[xyzXYZ0-2])\]?")
"""A flat column: ``LTOE_X``, ``LTOE x``, ``LTOE.Z``, or ``LTOE[0]`` as Kinetics Toolkit writes."""

_EVEN = 0.1
"""Share of the mean step by which steps of time may differ: timestamps are rounded."""


def from_arrays(
    positions: ArrayLike,
    labels: Sequence[str],
    rate: float,
    *,
    unit: str | None = None,
    up: str | None = None,
    name: str = "clip",
    subject: str | None = None,
    first_frame: int = 0,
    zeros_missing: bool = True,
) -> Clip:
    """Make a clip of an array.

    Parameters
    ----------
    positions : array_like [shape=(frames, markers, 3) or (frames, 3 * markers), unit]
        NaN where missing.
    labels : sequence of str
        The markers' names; a subject may stand before a colon.
    rate : float
        Frames per second (Hz).
    unit : str or None
        Unit of length (mm, cm, m, ...); found from the spread of the markers if None.
    up : str or None
        Which axis points up; found from the data if None.
    name : str
        What to call the clip.
    subject : str or None
        Whose markers to take, where there are several subjects.
    first_frame : int
        Number of the first frame.
    zeros_missing : bool
        Take samples that are exactly (0, 0, 0) as missing.

    Raises
    ------
    ClipError
        Where the shapes do not fit each other, or contents make no sense.
    OptionError
        Where unit or axis is unknown.
    """
    array = np.array(positions, dtype=np.float64)
    if array.ndim == 2 and array.shape[1] == 3 * len(labels):
        array = array.reshape(len(array), len(labels), 3)
    if array.ndim != 3 or array.shape[1:] != (len(labels), 3):
        raise ClipError(
            f"{name}: positions have shape {array.shape}; (frames, {len(labels)}, 3) or "
            f"(frames, {3 * len(labels)}) is needed for {len(labels)} labels"
        )
    texts = tuple(str(label) for label in labels)
    twice = next((text for text in texts if texts.count(text) > 1), None)
    if twice is not None:  # a file's twins are renamed with a note, but only a source has notes
        raise ClipError(
            f"{name}: markers {texts.index(twice) + 1} and "
            f"{texts.index(twice, texts.index(twice) + 1) + 1} are both named {twice}; "
            "rename one of them"
        )
    recording = Recording(array, texts, float(rate), "", first_frame=first_frame)
    return make_clip(recording, name, ReadOptions(zeros_missing, up, None, unit, subject))


def from_timeseries(series: Any, **options: Any) -> Clip:
    """Make a clip of a TimeSeries of Kinetics Toolkit.

    Parameters
    ----------
    series : TimeSeries
        Its data of shape (frames, 4) or (frames, 3) are taken as markers, all else is left out.
        The unit is that of ``series.info[label]["Unit"]`` if it is there.
    **options
        Those of `from_arrays` but for labels and rate.

    Raises
    ------
    ClipError
        Where there are no such data, or times are not evenly spaced.
    """
    name = options.setdefault("name", "timeseries")
    times = np.asarray(series.time, dtype=np.float64)
    columns, labels = [], []
    for label, values in series.data.items():
        array = np.asarray(values)
        if array.dtype.kind in "fiu" and array.ndim == 2 and array.shape[1] in (3, 4):
            columns.append(array[:, :3])
            labels.append(str(label))
    if not columns:
        raise ClipError(
            f"{name}: has no data of shape (frames, 4), only {', '.join(map(str, series.data))}; "
            "give a TimeSeries of markers"
        )
    if "unit" not in options:
        options["unit"] = _one_unit(
            [_unit_of(getattr(series, "info", {}), label) for label in labels]
        )
    return from_arrays(np.stack(columns, axis=1), labels, _rate(times, name), **options)


def to_timeseries(clip: Clip, timeseries_class: Callable[..., Any], unit: str = "m") -> Any:
    """Make a TimeSeries of Kinetics Toolkit.

    Parameters
    ----------
    clip : Clip
        The clip.
    timeseries_class : type
        ``kineticstoolkit.TimeSeries``.
    unit : str
        Unit of length; metres are usual there.

    Returns
    -------
    TimeSeries
        Each marker (frames, 4): x, y, z and 1; missing samples are NaN in all four.
    """
    scale = UNITS[unit]
    ones = np.where(clip.missing, np.nan, 1.0)[:, :, None]
    points = np.concatenate([clip.positions / scale, ones], axis=2)
    series = timeseries_class(
        time=_times(clip), data={label: points[:, k] for k, label in enumerate(clip.labels)}
    )
    info = getattr(series, "info", None)
    if isinstance(info, dict):
        info.update({label: {"Unit": unit} for label in clip.labels})
    return series


def from_xarray(array: Any, **options: Any) -> Clip:
    """Make a clip of a DataArray as pyomeca has it.

    Parameters
    ----------
    array : DataArray
        Dimensions axis (x, y, z, and perhaps ones), channel and time (s), in any order. Attributes
        ``rate``, ``units`` and ``first_frame`` are looked at.
    **options
        Those of `from_arrays` but for labels; ``rate`` (Hz), if the array does not tell.

    Raises
    ------
    ClipError
        Where dimensions are others, or times are not evenly spaced.
    """
    name = options.setdefault("name", str(getattr(array, "name", None) or "xarray"))
    if set(array.dims) != {"axis", "channel", "time"}:
        raise ClipError(
            f"{name}: has the dimensions {', '.join(map(str, array.dims))}; "
            "axis, channel, time are needed"
        )
    ordered = array.transpose("time", "channel", "axis")
    values = np.asarray(ordered.values, dtype=np.float64)
    labels = [str(label) for label in np.asarray(ordered.coords["channel"].values)]
    places = list(range(3))
    if "axis" in ordered.coords:
        axes = [str(axis).lower() for axis in np.asarray(ordered.coords["axis"].values)]
        if not set(_AXES) <= set(axes):
            raise ClipError(f"{name}: has the axes {', '.join(axes)}; x, y, z are needed")
        places = [axes.index(axis) for axis in _AXES]
    attributes: Mapping[str, Any] = getattr(array, "attrs", {})
    rate = options.pop("rate", None) or attributes.get("rate")
    if rate is None:
        if "time" not in ordered.coords:
            raise ClipError(f"{name}: has neither times nor a rate; give the rate")
        rate = _rate(np.asarray(ordered.coords["time"].values, dtype=np.float64), name)
    options.setdefault("unit", attributes.get("units"))
    options.setdefault("first_frame", int(attributes.get("first_frame", 0)))
    return from_arrays(values[:, :, places], labels, rate, **options)


def to_xarray(clip: Clip, dataarray_class: Callable[..., Any], unit: str = "mm") -> Any:
    """Make a DataArray as pyomeca has it.

    Parameters
    ----------
    clip : Clip
        The clip.
    dataarray_class : type
        ``xarray.DataArray``.
    unit : str
        Unit of length.

    Returns
    -------
    DataArray [shape=(4, markers, frames)]
        Dimensions axis (x, y, z, ones), channel and time.
    """
    frames, markers = clip.missing.shape
    points = np.ones((4, markers, frames))
    points[:3] = clip.positions.transpose(2, 1, 0) / UNITS[unit]
    return dataarray_class(
        points,
        dims=("axis", "channel", "time"),
        coords={"axis": [*_AXES, "ones"], "channel": list(clip.labels), "time": _times(clip)},
        name=clip.name,
        attrs={"rate": clip.rate, "units": unit, "first_frame": clip.first_frame},
    )


def from_dataframe(frame: Any, rate: float | None = None, **options: Any) -> Clip:
    """Make a clip of a pandas DataFrame with a row for each frame.

    Parameters
    ----------
    frame : DataFrame
        Its columns are pairs (label, axis), or named like ``LTOE_X``, ``LTOE_Y``, ``LTOE_Z``.
        Others are left out.
    rate : float or None
        Frames per second (Hz); found from the index, times in seconds, if None.
    **options
        Those of `from_arrays` but for labels.

    Raises
    ------
    ClipError
        Where no marker has all three columns, or the index is no evenly spaced time.
    """
    name = options.setdefault("name", "dataframe")
    found: dict[str, dict[int, int]] = {}
    for place, column in enumerate(frame.columns):
        key = _column(column)
        if key is not None:
            found.setdefault(key[0], {})[key[1]] = place
    whole = {label: axes for label, axes in found.items() if len(axes) == 3}
    if not whole:
        shown = ", ".join(str(column) for column in list(frame.columns)[:6])
        raise ClipError(
            f"{name}: has no marker with columns for x, y and z, only {shown}; name columns like "
            "LTOE_X, or by pairs (label, axis)"
        )
    order = [axes[k] for axes in whole.values() for k in range(3)]
    values = np.asarray(frame.iloc[:, order].to_numpy(), dtype=np.float64)
    if rate is None:
        try:
            times = np.asarray(frame.index.to_numpy(), dtype=np.float64)
        except (TypeError, ValueError):
            raise ClipError(f"{name}: its index is no time in seconds; give the rate") from None
        rate = _rate(times, name)
        if np.array_equal(times, np.arange(len(times))) and len(times) > 1:
            raise ClipError(f"{name}: its index counts rows and is no time; give the rate")
    return from_arrays(values, list(whole), rate, **options)


def to_dataframe(clip: Clip, dataframe_class: Callable[..., Any], unit: str = "mm") -> Any:
    """Make a pandas DataFrame.

    Parameters
    ----------
    clip : Clip
        The clip.
    dataframe_class : type
        ``pandas.DataFrame``.
    unit : str
        Unit of length.

    Returns
    -------
    DataFrame
        Columns ``LTOE_X``, ``LTOE_Y``, ``LTOE_Z``, ...; the index is the time (s).
    """
    columns = [f"{label}_{axis.upper()}" for label in clip.labels for axis in _AXES]
    values = clip.positions.reshape(clip.frames, -1) / UNITS[unit]
    return dataframe_class(values, columns=columns, index=_times(clip))


def _times(clip: Clip) -> NDArray[np.float64]:
    """Return the time of each frame (s), from 0."""
    return np.arange(clip.frames) / clip.rate


def _rate(times: NDArray[np.float64], name: str) -> float:
    """Return the frame rate (Hz) of evenly spaced times (s)."""
    steps = np.diff(times)
    if not steps.size or not np.isfinite(steps).all():
        raise ClipError(f"{name}: has too few times to tell the rate; give the rate")
    step = float(steps.mean())
    if step <= 0 or float(np.abs(steps - step).max()) > _EVEN * step:
        raise ClipError(
            f"{name}: times are not evenly spaced (steps of {steps.min():.4g} to "
            f"{steps.max():.4g} s); resample first"
        )
    return 1 / step


def _unit_of(info: Mapping[str, Any], label: str) -> str | None:
    """Return the unit that a TimeSeries tells of a marker."""
    facts = info.get(label)
    unit = facts.get("Unit") if isinstance(facts, Mapping) else None
    return str(unit) if unit else None


def _one_unit(units: Sequence[str | None]) -> str | None:
    """Return the unit if all have the same."""
    return units[0] if len(set(units)) == 1 else None


def _column(column: Any) -> tuple[str, int] | None:
    """Return label and axis of a column; None if it is none of a marker."""
    if isinstance(column, tuple) and len(column) == 2:
        axis = str(column[1]).lower()
        return (str(column[0]), _AXES.index(axis)) if axis in _AXES else None
    match = _AXIS_COLUMN.fullmatch(str(column))
    if match is None:
        return None
    axis = match["axis"].lower()
    return match["label"], int(axis) if axis.isdigit() else _AXES.index(axis)
