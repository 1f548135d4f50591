"""Clips from and to marker data of other packages, which are replaced by minimal classes."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from text_files import LABELS, standing

import priorfill as pf
from priorfill import interop
from priorfill.clip import Clip
from priorfill.errors import ClipError, FormatError, OptionError


class TimeSeries:
    """The attributes used of Kinetics Toolkit's class."""

    def __init__(self, *, time: Any, data: dict[str, Any]) -> None:
        self.time = np.asarray(time)
        self.data = {key: np.asarray(value) for key, value in data.items()}
        self.info: dict[str, Any] = {"Time": {"Unit": "s"}}


class DataArray:
    """The attributes used of xarray's class."""

    def __init__(self, data, dims, coords, name="", attrs=None) -> None:
        self.values, self.dims, self.name = np.asarray(data), tuple(dims), name
        self.coords = {k: SimpleNamespace(values=np.asarray(v)) for k, v in coords.items()}
        self.attrs = attrs or {}

    def transpose(self, *dims: str) -> DataArray:
        order = [self.dims.index(dim) for dim in dims]
        coords = {key: value.values for key, value in self.coords.items()}
        return DataArray(self.values.transpose(order), dims, coords, self.name, self.attrs)


class DataFrame:
    """The attributes used of pandas' class."""

    def __init__(self, data, columns, index) -> None:
        self.values, self.columns, self._index = np.asarray(data), list(columns), np.asarray(index)

    @property
    def index(self):
        return SimpleNamespace(to_numpy=lambda: self._index)

    @property
    def iloc(self):
        return self

    def __getitem__(self, key):
        return SimpleNamespace(to_numpy=lambda: self.values[key])


def with_gap() -> Clip:
    positions = standing()
    positions[4:7, 2] = np.nan
    return Clip(positions, LABELS, 120.0, "+Z", "walk")


def same(one: Clip, other: Clip) -> bool:
    return (
        one.labels == other.labels
        and np.allclose(one.positions, other.positions, rtol=0, atol=1e-9, equal_nan=True)
        and abs(one.rate - other.rate) < 1e-6
        and one.up == other.up
    )


@pytest.mark.parametrize("unit", ["mm", "m"])
def test_round_trips(unit):
    clip = with_gap()
    series = interop.to_timeseries(clip, TimeSeries, unit)
    assert same(interop.from_timeseries(series), clip)
    assert same(interop.from_xarray(interop.to_xarray(clip, DataArray, unit)), clip)
    frame = interop.to_dataframe(clip, DataFrame, unit)
    assert same(interop.from_dataframe(frame, unit=unit), clip)
    assert same(interop.from_dataframe(frame), clip)  # the unit is found from the markers' spread
    assert same(interop.from_arrays(clip.positions.reshape(12, 18), LABELS, 120), clip)


def test_angles_of_a_c3d_file_are_no_markers():
    """Kinetics Toolkit takes angles for points, and the file's declaration is gone."""
    clip = with_gap()
    series = interop.to_timeseries(clip, TimeSeries)
    angles = [side + name for side in "LR" for name in ("HPA", "KNA", "ANA", "FTA")]
    angles += [f"{side}{name}" for side in "LR" for name in ("HFTBA", "FFHFA", "HXFFA", "TIBA")]
    for name in (*angles, "PELAng", "LKneeAngles", "LKneeForce"):
        series.data[name] = series.data[LABELS[0]] * 0.01
    assert interop.from_timeseries(series).labels == LABELS
    # without its company, such a name can be that of a marker
    series = interop.to_timeseries(clip, TimeSeries)
    series.data["LANA"] = series.data[LABELS[0]] + 0.01
    assert "LANA" in interop.from_timeseries(series).labels


def test_timeseries_is_homogeneous_and_other_data_are_left_out():
    series = interop.to_timeseries(with_gap(), TimeSeries)
    assert series.data["LTOE"].shape == (12, 4)
    assert (series.data["LTOE"][:, 3] == 1).all()
    assert np.isnan(series.data["LKNE"][4:7]).all()
    assert series.data["LFHD"][0] == pytest.approx([*(standing()[0, 5] / 1000), 1])
    series.data |= {"EMG": np.arange(12.0), "Frame": np.zeros((12, 4, 4))}
    assert interop.from_timeseries(series).labels == LABELS


def test_xarray_in_pyomecas_layout():
    array = interop.to_xarray(with_gap(), DataArray)
    assert array.dims == ("axis", "channel", "time")
    assert array.values.shape == (4, 6, 12)
    turned = array.transpose("channel", "time", "axis")
    turned.coords["axis"].values = np.array(["ones", "y", "x", "z"])
    turned.values = turned.values[..., [3, 1, 0, 2]]
    assert same(interop.from_xarray(turned), with_gap())
    array.attrs = {}
    assert same(interop.from_xarray(array), with_gap())


@pytest.mark.parametrize("form", ["{}_X {}_Y {}_Z", "{}.x {}.y {}.z", "{}[0] {}[1] {}[2]", ""])
def test_names_of_columns(form):
    clip = with_gap()
    names = [name for label in LABELS for name in form.format(*[label] * 3).split()]
    columns = names or [(label, axis) for label in LABELS for axis in "xyz"]
    values = np.column_stack([clip.positions.reshape(12, 18), np.zeros(12)])
    frame = DataFrame(values, [*columns, "EMG"], np.arange(12))
    assert same(interop.from_dataframe(frame, 120), clip)
    with pytest.raises(ClipError, match="index counts rows instead of seconds; give the rate"):
        interop.from_dataframe(frame)


def test_subjects_units_and_options():
    labels = [f"{who}:{name}" for who in ("Ann", "Bob") for name in LABELS[:3]]
    positions = standing() / 10
    clip = interop.from_arrays(positions, labels, 50, unit="cm", subject="Bob", first_frame=4)
    assert (clip.subject, clip.first_frame, clip.labels) == ("Bob", 4, LABELS[:3])
    assert np.allclose(clip.positions, standing()[:, 3:])
    zero = standing()
    zero[2, 2] = 0
    assert interop.from_arrays(zero, LABELS, 50).missing.sum() == 1
    assert interop.from_arrays(zero, LABELS, 50, zeros_missing=False).missing.sum() == 0


def test_the_array_given_is_not_changed():
    positions = standing()
    positions[2, 2] = 0.0
    positions[3, 1, 0] = np.nan
    before = positions.copy()
    clip = interop.from_arrays(positions, LABELS, 50, unit="cm")
    assert np.array_equal(positions, before, equal_nan=True)
    assert clip.missing.sum() == 2
    assert np.allclose(clip.positions[0], 10 * before[0])


def test_unusable_data():
    with pytest.raises(TypeError, match="unexpected keyword argument 'units'"):
        interop.from_arrays(standing(), LABELS, 100, units="m")
    with pytest.raises(OptionError, match="unit 'ell' is unknown"):
        interop.from_arrays(standing(), LABELS, 100, unit="ell")
    with pytest.raises(ClipError, match=r"shape \(12, 6, 3\); \(frames, 2, 3\) or \(frames, 6\)"):
        interop.from_arrays(standing(), ["a", "b"], 100)
    with pytest.raises(ClipError, match="markers 2 and 4 are both named RTOE; rename one"):
        interop.from_arrays(standing(), ["LTOE", "RTOE", "LKNE", "RTOE", "C7", "LFHD"], 100)
    with pytest.raises(ClipError, match="no data of shape"):
        interop.from_timeseries(TimeSeries(time=[0, 1], data={"EMG": [1, 2]}))
    series = interop.to_timeseries(with_gap(), TimeSeries)
    series.time = np.append(series.time[:-1], 9.0)
    with pytest.raises(ClipError, match="times are not evenly spaced"):
        interop.from_timeseries(series)
    with pytest.raises(ClipError, match="has the dimensions x, y; axis, channel, time are needed"):
        interop.from_xarray(DataArray(np.zeros((2, 2)), ("x", "y"), {}))
    with pytest.raises(ClipError, match="no marker with columns for x, y and z, only a, b"):
        interop.from_dataframe(DataFrame(np.zeros((3, 2)), ["a", "b"], [0, 1, 2]))
    columns = ["A_X", "A_Y", "A_Z", "A x"]
    with pytest.raises(ClipError, match="two columns of A x; rename"):
        interop.from_dataframe(DataFrame(np.zeros((3, 4)), columns, [0, 1, 2]), rate=100)
    series = interop.to_timeseries(with_gap(), TimeSeries)
    series.data["LTOE"] = series.data["LTOE"][:5]
    with pytest.raises(ClipError, match="LTOE has 5 frames, and there are 12 times"):
        interop.from_timeseries(series)
    series = interop.to_timeseries(with_gap(), TimeSeries)
    series.info["LTOE"] = {"Unit": "mm"}
    with pytest.raises(ClipError, match="has markers in m and in mm; convert them"):
        interop.from_timeseries(series)


def test_columns_by_axes_are_refused():
    columns = with_gap().positions.transpose(0, 2, 1).reshape(12, 18)
    with pytest.raises(FormatError, match="hold X of all markers before Y and Z"):
        interop.from_arrays(columns, LABELS, 120)


def test_times_replace_a_rate_that_they_contradict():
    array = interop.to_xarray(with_gap(), DataArray)

    def rate(times: Any, stated: float | None = 120.0) -> float:
        array.coords["time"].values = np.asarray(times)
        array.attrs = {"rate": stated, "units": "mm"}
        return interop.from_xarray(array).rate

    seconds = np.arange(12) / 60
    assert rate(seconds) == pytest.approx(60.0)
    assert rate(seconds, None) == pytest.approx(60.0)
    assert rate((1000 * seconds).astype("timedelta64[ms]")) == pytest.approx(60.0, rel=0.01)
    assert rate(np.arange(12)) == 120.0
    assert rate(2 * np.arange(12)) == 60.0
    assert rate(np.full(12, np.nan)) == 120.0
    with pytest.raises(ClipError, match="times are not evenly spaced"):
        rate(np.delete(np.arange(13) / 120, 5))
    assert interop.from_xarray(array, rate=50.0).rate == 50.0


def test_masked_samples_are_missing():
    clip = with_gap()
    masked = np.ma.masked_array(np.nan_to_num(clip.positions, nan=-999.0), np.isnan(clip.positions))
    for made in (
        interop.from_arrays(masked, LABELS, 120, unit="mm"),
        Clip(masked, LABELS, 120.0),
        clip.with_positions(masked.astype(int)),
    ):
        assert (made.missing == clip.missing).all()
    series = interop.to_timeseries(clip, TimeSeries)
    series.data["LTOE"] = np.ma.masked_array(series.data["LTOE"], mask=False)
    series.data["LTOE"][3] = np.ma.masked
    assert interop.from_timeseries(series).missing[3, LABELS.index("LTOE")]


def test_the_packages_themselves(tmp_path):
    """Uses the packages that are installed; the other tests need none of them."""
    clip = with_gap()
    pandas = pytest.importorskip("pandas")
    frame = interop.to_dataframe(clip, pandas.DataFrame)
    assert same(interop.from_dataframe(frame), clip)
    pairs = pandas.MultiIndex.from_product([LABELS, ["x", "y", "z"]])
    frame.columns = pairs
    assert same(interop.from_dataframe(frame), clip)
    xarray = pytest.importorskip("xarray")
    array = interop.to_xarray(clip, xarray.DataArray)
    assert array.sel(axis="z", channel="C7").dims == ("time",)
    assert same(interop.from_xarray(array.transpose("time", "axis", "channel")), clip)
    toolkit = pytest.importorskip("kineticstoolkit")
    series = interop.to_timeseries(clip, toolkit.TimeSeries)
    assert series.info["LTOE"]["Unit"] == "m"
    assert same(interop.from_timeseries(series), clip)
    assert same(interop.from_timeseries(series.copy()), clip)


def test_unknown_units_are_refused() -> None:
    clip = interop.from_arrays(standing(), LABELS, 100, unit="mm")
    for convert in (interop.to_timeseries, interop.to_xarray, interop.to_dataframe):
        with pytest.raises(OptionError, match="unit 'ell' is unknown; use one of mm"):
            convert(clip, dict, "ell")


@pytest.fixture(scope="module")
def result() -> pf.Result:
    """A fill whose clip begins at frame 92."""
    clip = with_gap()
    return pf.fill(replace(clip, first_frame=92, source=None), method="linear")


def test_result_as_a_dataset(result: pf.Result) -> None:
    made = interop.result_to_xarray(result, lambda *a, **k: SimpleNamespace(variables=a[0], **k))
    dims, values, attributes = made.variables["error_bound_90"]
    assert dims == ("frame", "marker")
    assert np.array_equal(values, result.error_bound_90_mm, equal_nan=True)
    assert attributes == {"units": "mm"}
    assert made.variables["position"][0] == ("frame", "marker", "axis")
    assert made.coords["frame"][0] == 92
    assert made.coords["time"][1][1] == pytest.approx(1 / result.clip.rate)
    provenance = json.loads(made.attrs["provenance"])
    assert pf.Provenance.from_dict(provenance) == result.provenance
    assert all(isinstance(value, (str, float)) for value in made.attrs.values())  # of NetCDF


def test_result_as_a_table(result: pf.Result) -> None:
    made = interop.result_to_dataframe(result, lambda data: SimpleNamespace(data=data, attrs={}))
    columns = made.data
    row = list(zip(columns["marker"], columns["frame"], strict=True)).index((LABELS[2], 97))
    marker = result.clip.index(LABELS[2])
    assert columns["filled"][row]
    assert columns["error_bound_90_mm"][row] == result.error_bound_90_mm[5, marker]
    at = [columns[f"{axis}_mm"][row] for axis in "xyz"]
    assert np.array_equal(at, result.clip[LABELS[2]][5])
    assert columns["filled"].sum() == result.filled.sum()
    assert made.attrs["method"] == "linear"


def test_results_with_the_packages_themselves(result: pf.Result) -> None:
    pandas = pytest.importorskip("pandas")
    xarray = pytest.importorskip("xarray")
    dataset, table = result.to_xarray(), result.to_dataframe()
    assert isinstance(dataset, xarray.Dataset)
    assert isinstance(table, pandas.DataFrame)
    one = dataset.sel(frame=97, marker=LABELS[2])
    assert bool(one.filled)
    row = table[(table.marker == LABELS[2]) & (table.frame == 97)].iloc[0]
    assert row.error_bound_90_mm == float(one.error_bound_90)
    assert row.x_mm == float(one.position.sel(axis="x"))


def test_without_the_packages(result: pf.Result, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(interop, "find_spec", lambda name: None)
    for export, name in ((result.to_xarray, "xarray"), (result.to_dataframe, "pandas")):
        with pytest.raises(OptionError, match=f"pip install {name}"):
            export()


@pytest.mark.parametrize(
    ("attribute", "value", "message"),
    [
        ("rate", "fast", "its attribute rate is 'fast'; give it a number"),
        ("first_frame", "one", "its attribute first_frame is 'one'; give it a number"),
        ("first_frame", 1.7, "the first frame is 1.7; give a whole number"),
        ("first_frame", np.nan, "the first frame is nan; give a whole number"),
    ],
)
def test_attributes_that_are_no_numbers(attribute: str, value: object, message: str) -> None:
    array = interop.to_xarray(with_gap(), DataArray)
    array.attrs[attribute] = value
    with pytest.raises(ClipError, match=message):
        interop.from_xarray(array)


@pytest.mark.parametrize(("attribute", "value"), [("first_frame", None), ("rate", np.nan)])
def test_attributes_that_are_unknown(attribute: str, value: object) -> None:
    array = interop.to_xarray(with_gap(), DataArray)
    array.attrs[attribute] = value
    assert same(interop.from_xarray(array), with_gap())


def test_times_that_are_no_numbers() -> None:
    array = interop.to_xarray(with_gap(), DataArray)
    array.coords["time"].values = np.array(["early"] * 12)
    with pytest.raises(ClipError, match="its times are no numbers"):
        interop.from_xarray(array)


@pytest.mark.parametrize("kind", ["datetime64[ns]", "timedelta64[ns]"])
def test_an_index_of_dates_or_durations_is_in_seconds(kind: str) -> None:
    frame = interop.to_dataframe(replace(with_gap(), rate=125.0), DataFrame)
    frame._index = (np.arange(12) * 8_000_000).astype(kind)
    assert interop.from_dataframe(frame).rate == pytest.approx(125.0)


class NAType:
    """pandas.NA, which is no number."""

    def __float__(self) -> float:
        raise TypeError("float() argument must be a real number, not 'NAType'")


@pytest.mark.parametrize("blank", [NAType(), None])
def test_blanks_of_columns_that_hold_objects(blank: object) -> None:
    clip = with_gap()
    frame = interop.to_dataframe(clip, DataFrame)
    values = frame.values.astype(object)
    values[np.isnan(frame.values)] = blank
    frame.values = values
    assert same(interop.from_dataframe(frame), clip)


def test_a_dataset_in_place_of_an_array() -> None:
    array = interop.to_xarray(with_gap(), DataArray)
    array.data_vars = {}
    with pytest.raises(TypeError, match="`array` is a Dataset; give one of its variables"):
        interop.from_xarray(array)
