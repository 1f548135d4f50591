"""Clips from and to the marker data of other Python packages, and results with their errors.

* `from_timeseries`, `to_timeseries`: TimeSeries of Kinetics Toolkit,
* `from_xarray`, `to_xarray`: DataArray of pyomeca, with dimensions axis, channel and time,
* `from_dataframe`, `to_dataframe`: pandas,
* `from_arrays`: NumPy,
* `result_to_xarray`, `result_to_dataframe`: results, with what was filled and the expected errors.

priorfill depends on none of these packages: the ``from_`` functions use attributes only, and the
``to_`` functions take the class to construct, of any version.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from priorfill.clip import Clip, without_mask
from priorfill.errors import ArgumentTypeError, ClipError, OptionError
from priorfill.formats.arrays.column_order import check_column_order
from priorfill.formats.recording import ReadOptions, Recording, make_clip
from priorfill.formats.units import UNITS
from priorfill.runtime.argument_types import (
    check_attributes,
    check_labels,
    check_number,
    check_result,
    check_type,
)

if TYPE_CHECKING:
    from priorfill.filling.result import Result

__all__ = [
    "from_arrays",
    "from_dataframe",
    "from_timeseries",
    "from_xarray",
    "optional_package",
    "rate_of_times",
    "result_to_dataframe",
    "result_to_xarray",
    "to_dataframe",
    "to_timeseries",
    "to_xarray",
]

_AXES = ("x", "y", "z")

_AXIS_COLUMN = re.compile(r"(?P<label>.+?)(?:[ _.:-]|\[)(?P<axis>[xyzXYZ0-2])\]?")
"""A flat column: ``LTOE_X``, ``LTOE x``, ``LTOE.Z``, or ``LTOE[0]`` as in Kinetics Toolkit."""

_MAX_RATE_DEVIATION = 0.01
"""Maximum deviation of a stated rate from that of the times, as a share of it."""

_MAX_STEP_DEVIATION = 0.1
"""Maximum deviation of a time step from the mean, as a share of it; timestamps are rounded."""


def from_arrays(
    positions: ArrayLike,
    labels: Sequence[str],
    rate: float,
    *,
    name: str = "clip",
    first_frame: int = 0,
    **options: Any,
) -> Clip:
    """Make a clip from an array.

    Parameters
    ----------
    positions : array_like [shape=(frames, markers, 3) or (frames, 3 * markers), unit]
        NaN where missing, or masked.
    labels : sequence of str
        The markers' names, unique; a prefix before a colon is the subject.
    rate : float
        Frame rate (Hz).
    name : str
        Name of the clip.
    first_frame : int
        Number of the first frame.
    **options
        Further options of `priorfill.read`: ``unit`` (found from the spread of the markers if not
        given), ``up`` (found from the data if not given), ``subject`` and ``zeros_missing``.

    Returns
    -------
    Clip
        The markers in mm, without a source.

    Raises
    ------
    ClipError
        If shapes do not match, labels repeat, or the contents are unusable.
    FormatError
        If columns hold X of all markers before Y and Z.
    OptionError
        If rate, unit or axis is invalid.
    ArgumentTypeError
        If an argument is of another type.

    Examples
    --------
    >>> import numpy as np
    >>> clip = from_arrays(np.full((4, 2, 3), 0.5), ["LTOE", "RTOE"], 100.0, unit="m")
    >>> clip.positions[0, 0].tolist()
    [500.0, 500.0, 500.0]

    See Also
    --------
    priorfill.read : Read a clip from a file.
    """
    texts = check_labels(labels, convert=True)
    array = np.array(without_mask(positions))
    if array.ndim == 2 and array.shape[1] == 3 * len(texts):
        check_column_order(array, name)
        array = array.reshape(len(array), len(texts), 3)
    if array.ndim != 3 or array.shape[1:] != (len(texts), 3):
        raise ClipError(
            f"{name}: positions have shape {array.shape}; (frames, {len(texts)}, 3) or "
            f"(frames, {3 * len(texts)}) is needed for {len(texts)} labels"
        )
    twice = next((text for text in texts if texts.count(text) > 1), None)
    if twice is not None:  # in a file they are renamed with a note, which needs a source
        raise ClipError(
            f"{name}: markers {texts.index(twice) + 1} and "
            f"{texts.index(twice, texts.index(twice) + 1) + 1} are both named {twice}; "
            "rename one of them"
        )
    check_number("rate", rate)
    recording = Recording(array, texts, float(rate), "", first_frame=first_frame)
    return make_clip(recording, name, ReadOptions(**options))


def from_timeseries(series: Any, **options: Any) -> Clip:
    """Make a clip from a TimeSeries of Kinetics Toolkit.

    Parameters
    ----------
    series : TimeSeries
        Data of shape (frames, 4) or (frames, 3) become markers; all others are left out. The unit
        is ``series.info[label]["Unit"]`` if present.
    **options
        Keyword arguments of `from_arrays`.

    Returns
    -------
    Clip
        The markers in mm, without a source.

    Raises
    ------
    ClipError
        If there are no such data, they differ in length or unit, or times are not evenly spaced.

    See Also
    --------
    to_timeseries : The inverse.

    Examples
    --------
    >>> series = kineticstoolkit.read_c3d("walk.c3d")["Points"]  # doctest: +SKIP
    >>> clip = from_timeseries(series)  # doctest: +SKIP
    """
    check_attributes("series", series, ("time", "data"), "a TimeSeries of Kinetics Toolkit")
    name = options.setdefault("name", "timeseries")
    times = np.asarray(series.time, dtype=np.float64)
    columns, labels = [], []
    for label, values in series.data.items():
        array = np.ma.asarray(values)
        if array.dtype.kind in "fiu" and array.ndim == 2 and array.shape[1] in (3, 4):
            if len(array) != len(times):
                raise ClipError(
                    f"{name}: {label} has {len(array)} frames, and there are {len(times)} times; "
                    "correct it"
                )
            columns.append(without_mask(array[:, :3]))
            labels.append(str(label))
    if not columns:
        raise ClipError(
            f"{name}: has no data of shape (frames, 4), only {', '.join(map(str, series.data))}; "
            "give a TimeSeries of markers"
        )
    if "unit" not in options:
        units = [_unit_of(getattr(series, "info", {}), label) for label in labels]
        options["unit"] = _one_unit(units, name)
    return from_arrays(np.stack(columns, axis=1), labels, rate_of_times(times, name), **options)


def to_timeseries(clip: Clip, timeseries_class: Callable[..., Any], unit: str = "m") -> Any:
    """Make a TimeSeries of Kinetics Toolkit from a clip.

    Parameters
    ----------
    clip : Clip
        The clip.
    timeseries_class : type
        ``kineticstoolkit.TimeSeries``.
    unit : str
        Unit of length; Kinetics Toolkit uses metres.

    Returns
    -------
    TimeSeries
        For each marker x, y, z and 1 [shape=(frames, 4)]; missing samples are NaN in all four.

    Raises
    ------
    OptionError
        If the unit is unknown.

    See Also
    --------
    from_timeseries : The inverse.

    Examples
    --------
    >>> series = to_timeseries(clip, kineticstoolkit.TimeSeries)  # doctest: +SKIP
    """
    check_type("clip", clip, Clip, "a Clip")
    scale = _mm_per_unit(unit)
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
    """Make a clip from a DataArray in the layout of pyomeca.

    Parameters
    ----------
    array : DataArray
        Dimensions axis (x, y, z, and optionally ones), channel and time (s), in any order. The
        attributes ``rate``, ``units`` and ``first_frame`` are used. If the times contradict the
        rate, as they do after samples were left out, the times are right; whole numbers count
        frames.
    **options
        Keyword arguments of `from_arrays`, and ``rate`` (Hz), which replaces both, and is required
        if the array has neither a rate nor times.

    Returns
    -------
    Clip
        The markers in mm, without a source.

    Raises
    ------
    ClipError
        If the dimensions differ, or times are not evenly spaced.

    See Also
    --------
    to_xarray : The inverse.

    Examples
    --------
    >>> clip = from_xarray(pyomeca.Markers.from_c3d("walk.c3d"))  # doctest: +SKIP
    """
    check_attributes("array", array, ("dims", "coords"), "a DataArray of xarray, as of pyomeca")
    if hasattr(array, "data_vars"):
        raise ArgumentTypeError("`array` is a Dataset; give one of its variables")
    name = options.setdefault("name", str(getattr(array, "name", None) or "xarray"))
    if set(array.dims) != {"axis", "channel", "time"}:
        raise ClipError(
            f"{name}: has the dimensions {', '.join(map(str, array.dims))}; "
            "axis, channel, time are needed"
        )
    ordered = array.transpose("time", "channel", "axis")
    values = without_mask(ordered.values)
    labels = [str(label) for label in np.asarray(ordered.coords["channel"].values)]
    places = list(range(3))
    if "axis" in ordered.coords:
        axes = [str(axis).lower() for axis in np.asarray(ordered.coords["axis"].values)]
        if not set(_AXES) <= set(axes):
            raise ClipError(f"{name}: has the axes {', '.join(axes)}; x, y, z are needed")
        places = [axes.index(axis) for axis in _AXES]
    attributes: Mapping[str, Any] = getattr(array, "attrs", {})
    rate = options.pop("rate", None) or _rate_of_array(ordered, attributes.get("rate"), name)
    options.setdefault("unit", attributes.get("units"))
    first_frame = _number(attributes.get("first_frame"), "first_frame", name) or 0.0
    options.setdefault("first_frame", int(first_frame) if first_frame.is_integer() else first_frame)
    return from_arrays(values[:, :, places], labels, rate, **options)


def to_xarray(clip: Clip, dataarray_class: Callable[..., Any], unit: str = "mm") -> Any:
    """Make a DataArray in the layout of pyomeca from a clip.

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

    Raises
    ------
    OptionError
        If the unit is unknown.

    See Also
    --------
    from_xarray : The inverse.

    Examples
    --------
    >>> array = to_xarray(clip, xarray.DataArray)  # doctest: +SKIP
    """
    check_type("clip", clip, Clip, "a Clip")
    frames, markers = clip.missing.shape
    points = np.ones((4, markers, frames))
    points[:3] = clip.positions.transpose(2, 1, 0) / _mm_per_unit(unit)
    return dataarray_class(
        points,
        dims=("axis", "channel", "time"),
        coords={"axis": [*_AXES, "ones"], "channel": list(clip.labels), "time": _times(clip)},
        name=clip.name,
        attrs={"rate": clip.rate, "units": unit, "first_frame": clip.first_frame},
    )


def from_dataframe(frame: Any, rate: float | None = None, **options: Any) -> Clip:
    """Make a clip from a pandas DataFrame with a row per frame.

    Parameters
    ----------
    frame : DataFrame
        Columns are pairs (label, axis), or named like ``LTOE_X``, ``LTOE_Y``, ``LTOE_Z``. Others
        are left out.
    rate : float or None
        Frame rate (Hz); if None, from the index, which holds times in seconds.
    **options
        Keyword arguments of `from_arrays`.

    Returns
    -------
    Clip
        The markers in mm, without a source.

    Raises
    ------
    ClipError
        If no marker has all three columns, a column is there twice, or the index does not hold
        evenly spaced times.

    See Also
    --------
    to_dataframe : The inverse.

    Examples
    --------
    >>> clip = from_dataframe(pandas.read_csv("walk.csv"), rate=100.0)  # doctest: +SKIP
    """
    check_attributes("frame", frame, ("columns", "index"), "a DataFrame of pandas")
    name = options.setdefault("name", "dataframe")
    found: dict[str, dict[int, int]] = {}
    for place, column in enumerate(frame.columns):
        key = _column(column)
        if key is not None:
            if key[1] in found.setdefault(key[0], {}):
                raise ClipError(
                    f"{name}: has two columns of {key[0]} {_AXES[key[1]]}; rename one of them"
                )
            found[key[0]][key[1]] = place
    complete = {label: axes for label, axes in found.items() if len(axes) == 3}
    if not complete:
        shown = ", ".join(str(column) for column in list(frame.columns)[:6])
        raise ClipError(
            f"{name}: has no marker with columns for x, y and z, only {shown}; name columns like "
            "LTOE_X, or use pairs (label, axis)"
        )
    order = [axes[k] for axes in complete.values() for k in range(3)]
    values = without_mask(_with_nan(frame.iloc[:, order].to_numpy()))
    if rate is None:
        try:
            times = _seconds(frame.index.to_numpy())
        except (TypeError, ValueError):
            raise ClipError(f"{name}: its index is not a time in seconds; give the rate") from None
        rate = rate_of_times(times, name)
        if np.array_equal(times, np.arange(len(times))) and len(times) > 1:
            raise ClipError(f"{name}: its index counts rows instead of seconds; give the rate")
    return from_arrays(values, list(complete), rate, **options)


def to_dataframe(clip: Clip, dataframe_class: Callable[..., Any], unit: str = "mm") -> Any:
    """Make a pandas DataFrame from a clip.

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

    Raises
    ------
    OptionError
        If the unit is unknown.

    See Also
    --------
    from_dataframe : The inverse.

    Examples
    --------
    >>> frame = to_dataframe(clip, pandas.DataFrame)  # doctest: +SKIP
    """
    check_type("clip", clip, Clip, "a Clip")
    columns = [f"{label}_{axis.upper()}" for label in clip.labels for axis in _AXES]
    values = clip.positions.reshape(clip.frames, -1) / _mm_per_unit(unit)
    return dataframe_class(values, columns=columns, index=_times(clip))


def result_to_xarray(result: Result, dataset_class: Callable[..., Any]) -> Any:
    """Make a Dataset from a result, with what was filled and how far off it may be.

    Parameters
    ----------
    result : Result
        Of a fill.
    dataset_class : type
        ``xarray.Dataset``.

    Returns
    -------
    Dataset
        Variables ``position`` (frame, marker, axis), ``filled``, ``expected_rms`` and
        ``error_bound_90`` (frame, marker), in mm; the errors are NaN where nothing was filled or
        they are unknown. Coordinates ``frame`` as the file numbers them, ``time`` (s, from the
        clip's first frame), ``marker`` and ``axis``. Attributes ``rate`` (Hz), ``up``, ``name``,
        ``subject``, ``method`` and ``provenance`` (JSON).

    See Also
    --------
    priorfill.Result.to_xarray : The same, without the class.

    Examples
    --------
    >>> dataset = result_to_xarray(result, xarray.Dataset)  # doctest: +SKIP
    >>> dataset.error_bound_90.sel(marker="LKNE").max()  # doctest: +SKIP
    """
    check_result(result)
    clip = result.clip
    places, mm = ("frame", "marker"), {"units": "mm"}
    return dataset_class(
        {
            "position": ((*places, "axis"), clip.positions.copy(), mm),
            "filled": (places, result.filled.copy()),
            "expected_rms": (places, result.expected_rms_mm.copy(), mm),
            "error_bound_90": (places, result.error_bound_90_mm.copy(), mm),
        },
        coords={
            "frame": clip.first_frame + np.arange(clip.frames),
            "time": ("frame", _times(clip), {"units": "s"}),
            "marker": list(clip.labels),
            "axis": list(_AXES),
        },
        attrs=_result_facts(result),
    )


def result_to_dataframe(result: Result, dataframe_class: Callable[..., Any]) -> Any:
    """Make a pandas DataFrame from a result, with a row for each marker and frame.

    Parameters
    ----------
    result : Result
        Of a fill.
    dataframe_class : type
        ``pandas.DataFrame``.

    Returns
    -------
    DataFrame
        Columns ``marker``, ``frame`` as the file numbers them, ``time_s``, ``x_mm``, ``y_mm``,
        ``z_mm``, ``filled``, ``expected_rms_mm`` and ``error_bound_90_mm``, named as in the table
        of `priorfill.write_uncertainty`; marker by marker. Positions are NaN where missing, errors
        where nothing was filled or they are unknown.

    See Also
    --------
    priorfill.Result.to_dataframe : The same, without the class.
    to_dataframe : Positions alone, a row for each frame.

    Examples
    --------
    >>> table = result_to_dataframe(result, pandas.DataFrame)  # doctest: +SKIP
    >>> table[table.filled].groupby("marker").error_bound_90_mm.max()  # doctest: +SKIP
    """
    check_result(result)
    clip = result.clip
    markers = len(clip.labels)
    frames = clip.first_frame + np.arange(clip.frames)
    table = dataframe_class(
        {
            "marker": np.repeat(np.array(clip.labels, dtype=object), clip.frames),
            "frame": np.tile(frames, markers),
            "time_s": np.tile(_times(clip), markers),
            **{f"{_AXES[k]}_mm": clip.positions[:, :, k].T.ravel() for k in range(3)},
            "filled": result.filled.T.ravel(),
            "expected_rms_mm": result.expected_rms_mm.T.ravel(),
            "error_bound_90_mm": result.error_bound_90_mm.T.ravel(),
        }
    )
    table.attrs.update(_result_facts(result))
    return table


def optional_package(name: str) -> Any:
    """Return a package that priorfill does not depend on.

    Parameters
    ----------
    name : str
        Its name.

    Raises
    ------
    OptionError
        If it is not installed.

    Examples
    --------
    >>> optional_package("no_such_package")
    Traceback (most recent call last):
    priorfill.errors.OptionError: this needs no_such_package, which is not installed; ...
    """
    if find_spec(name) is None:
        raise OptionError(
            f"this needs {name}, which is not installed; install it with: pip install {name}"
        )
    return import_module(name)


def _result_facts(result: Result) -> dict[str, Any]:
    """Return what a result is, as attributes that files of arrays can hold."""
    clip = result.clip
    return {
        "name": clip.name,
        "subject": clip.subject,
        "rate": clip.rate,
        "up": clip.up,
        "method": result.method,
        "provenance": json.dumps(result.provenance.to_dict()),
    }


def _times(clip: Clip) -> NDArray[np.float64]:
    """Return the time of each frame (s), from 0."""
    return np.arange(clip.frames) / clip.rate


def rate_of_times(times: NDArray[np.float64], name: str) -> float:
    """Return the frame rate (Hz) of evenly spaced times (s).

    Parameters
    ----------
    times : ndarray [shape=(frames,), s]
        The time of each frame.
    name : str
        What has them, for messages.

    Raises
    ------
    ClipError
        If there are fewer than two, or they are not evenly spaced.

    Examples
    --------
    >>> rate_of_times(np.array([0.0, 0.02, 0.04]), "walk")
    50.0
    """
    steps = np.diff(times)
    if not steps.size or not np.isfinite(steps).all():
        raise ClipError(f"{name}: has too few times to determine the rate; give the rate")
    step = float(steps.mean())
    if step <= 0 or float(np.abs(steps - step).max()) > _MAX_STEP_DEVIATION * step:
        raise ClipError(
            f"{name}: times are not evenly spaced (steps of {steps.min():.4g} to "
            f"{steps.max():.4g} s); resample first"
        )
    return 1 / step


def _seconds(times: ArrayLike) -> NDArray[np.float64]:
    """Return times as numbers; in seconds from the first, if they are dates or durations."""
    given = np.asarray(times)
    if given.dtype.kind in "mM" and given.size:
        given = (given - given[0]) / np.timedelta64(1, "s")
    return given.astype(np.float64)


def _with_nan(values: NDArray[Any]) -> NDArray[Any]:
    """Return values with NaN for pandas.NA and None, which an array of objects can hold."""
    if values.dtype.kind != "O":
        return values
    blank = [value is None or type(value).__name__ == "NAType" for value in values.flat]
    return np.where(np.reshape(blank, values.shape), np.nan, values)


def _rate_of_array(array: Any, given: Any, name: str) -> float:
    """Return the frame rate (Hz) of a DataArray by its times, or as stated where it has none."""
    try:
        times = _seconds(array.coords["time"].values if "time" in array.coords else [])
    except (TypeError, ValueError):
        raise ClipError(f"{name}: its times are no numbers; give the times in seconds") from None
    number = _number(given, "rate", name)
    stated = None if number is None or np.isnan(number) else number
    if len(times) < 2 or not np.isfinite(times).all():
        if stated is None:
            raise ClipError(f"{name}: has neither times nor a rate; give the rate")
        return stated
    rate = rate_of_times(times, name)
    if stated is None:
        return rate
    if abs(stated / rate - 1) <= _MAX_RATE_DEVIATION:
        return stated
    whole = (times == np.round(times)).all()  # they count frames
    return stated * rate if whole else rate


def _number(value: Any, attribute: str, name: str) -> float | None:
    """Return an attribute of a DataArray as a number; None if it is absent.

    Raises
    ------
    ClipError
        If it is none.
    """
    try:
        return None if value is None else float(value)
    except (TypeError, ValueError):
        raise ClipError(
            f"{name}: its attribute {attribute} is {value!r}; give it a number"
        ) from None


def _mm_per_unit(unit: str) -> float:
    """Return the millimetres in a unit of length."""
    if unit not in UNITS:
        raise OptionError(f"unit {unit!r} is unknown; use one of {' '.join(UNITS)}")
    return UNITS[unit]


def _unit_of(info: Mapping[str, Any], label: str) -> str | None:
    """Return the unit of a marker in a TimeSeries; None if absent."""
    entry = info.get(label)
    unit = entry.get("Unit") if isinstance(entry, Mapping) else None
    return str(unit) if unit else None


def _one_unit(units: Sequence[str | None], name: str) -> str | None:
    """Return the unit if it is the same for all; None if some have none."""
    stated = sorted({unit for unit in units if unit is not None})
    if len(stated) > 1:
        raise ClipError(f"{name}: has markers in {' and in '.join(stated)}; convert them to one")
    return None if None in units else units[0]


def _column(column: Any) -> tuple[str, int] | None:
    """Return label and axis of a column; None if it does not belong to a marker."""
    if isinstance(column, tuple) and len(column) == 2:
        axis = str(column[1]).lower()
        return (str(column[0]), _AXES.index(axis)) if axis in _AXES else None
    match = _AXIS_COLUMN.fullmatch(str(column))
    if match is None:
        return None
    axis = match["axis"].lower()
    return match["label"], int(axis) if axis.isdigit() else _AXES.index(axis)
