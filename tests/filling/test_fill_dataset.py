"""Datasets in the layout of movement; xarray is replaced by minimal classes."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from text_files import LABELS, standing

import priorfill as pf
from priorfill.errors import ClipError, OptionError

DIMS = ("time", "space", "keypoints", "individuals")


class DataArray:
    """The attributes used of xarray's class."""

    def __init__(self, values, dims, coords=None, attrs=None) -> None:
        self.values, self.dims, self.attrs = np.asarray(values), tuple(dims), attrs or {}
        self.coords = coords or {}

    def copy(self, data) -> DataArray:
        assert data.shape == self.values.shape
        return DataArray(data, self.dims, self.coords, self.attrs)


class Dataset:
    """The attributes used of xarray's class."""

    def __init__(self, variables, coords, attrs) -> None:
        self.coords = {k: DataArray(v, (k,)) for k, v in coords.items()}
        self.data_vars = {
            name: one if isinstance(one, DataArray) else DataArray(one[1], one[0], self.coords)
            for name, one in variables.items()
        }
        self.attrs = attrs

    def __getitem__(self, name: str) -> DataArray:
        return self.data_vars[name]

    def assign(self, variables) -> Dataset:
        coords = {k: v.values for k, v in self.coords.items()}
        return Dataset({**self.data_vars, **variables}, coords, self.attrs)

    def assign_attrs(self, attrs) -> Dataset:
        coords = {k: v.values for k, v in self.coords.items()}
        return Dataset(self.data_vars, coords, {**self.attrs, **attrs})


def bodies() -> tuple[np.ndarray, np.ndarray]:
    """Two individuals with a gap each, and one that was never seen; position and confidence."""
    positions = np.stack([standing(30), standing(30) * 0.8, np.full((30, 6, 3), np.nan)]) / 1000
    positions[0, 5:8, 2] = np.nan
    confidence = np.full((3, 30, 6), 0.9)
    confidence[1, 12:15, 4] = 0.3
    return positions.transpose(1, 3, 2, 0), confidence.transpose(1, 2, 0)


def dataset(dims: tuple[str, ...] = DIMS, **attrs: Any) -> Dataset:
    position, confidence = bodies()
    without = [dim for dim in dims if dim != "space"]
    variables = {
        "position": (dims, position.transpose([DIMS.index(dim) for dim in dims])),
        "confidence": (without, confidence.transpose(["tki".index(dim[0]) for dim in without])),
    }
    coords = {
        "time": np.arange(30) / 50,
        "space": ["x", "y", "z"],
        "keypoints": list(LABELS),
        "individuals": ["a", "b", "never"],
    }
    attributes = {"fps": 50.0, "time_unit": "seconds", "source_software": "Anipose", **attrs}
    return Dataset(variables, coords, attributes)


def filled(given: Dataset, **options: Any) -> Dataset:
    return pf.fill_dataset(given, **{"min_confidence": 0.6, "method": "linear", **options})


def test_each_individual_is_filled_by_itself() -> None:
    given = dataset()
    made = filled(given)
    assert np.array_equal(given["position"].values, bodies()[0], equal_nan=True)
    expected = np.zeros((30, 6, 3), dtype=bool)
    expected[12:15, 4, 1] = True
    assert np.array_equal(made["dropped"].values, expected)
    expected[5:8, 2, 0] = True
    assert np.array_equal(made["filled"].values, expected)
    assert (
        made["filled"].dims == made["expected_error"].dims == ("time", "keypoints", "individuals")
    )
    assert np.array_equal(np.isfinite(made["expected_error"].values), expected)
    assert (made["error_bound_90"].values[expected] < 0.1).all()
    kept = ~expected[:, None].repeat(3, axis=1)
    same = made["position"].values[kept], bodies()[0][kept]
    assert np.array_equal(*same, equal_nan=True)
    record = json.loads(made.attrs["priorfill"])
    assert (record["unit"], record["min_confidence"]) == ("m", 0.6)
    assert "m is assumed from the spread" in record["notes"][0]
    assert "nothing is filled" in record["individuals"]["never"]["notes"][0]
    pf.Provenance.from_dict(record["individuals"]["b"]["provenance"])
    assert made.attrs["source_software"] == "Anipose"


def test_order_of_dimensions_and_axes() -> None:
    expected = filled(dataset())["position"].values
    dims = ("individuals", "keypoints", "time", "space")
    made = filled(dataset(dims))
    assert made["position"].dims == dims
    back = made["position"].values.transpose(2, 3, 1, 0)
    assert np.array_equal(back, expected, equal_nan=True)
    turned = dataset()
    turned.coords["space"].values = np.array(["z", "x", "y"])
    turned["position"].values = turned["position"].values[:, [2, 0, 1]]
    turned["position"].values.setflags(write=False)
    made = filled(turned)["position"].values
    assert np.array_equal(made[:, [1, 2, 0]], expected, equal_nan=True)


def test_what_was_filled_before_is_filled_again() -> None:
    once = filled(dataset())
    twice = filled(once)
    for name in ("position", "filled", "dropped", "expected_error"):
        assert np.array_equal(twice[name].values, once[name].values, equal_nan=True)
    assert "6 samples that were filled before" in json.loads(twice.attrs["priorfill"])["notes"][0]


def test_one_individual_without_its_dimension() -> None:
    given = dataset()
    position = DataArray(bodies()[0][..., 1], DIMS[:3], given.coords)
    confidence = DataArray(bodies()[1][..., 1], ("time", "keypoints"), given.coords)
    given.coords["individuals"].values = np.array("b")
    given.data_vars |= {"position": position, "confidence": confidence}
    made = filled(given)
    assert made["filled"].dims == ("time", "keypoints")
    assert made["filled"].values.sum() == 3
    assert list(json.loads(made.attrs["priorfill"])["individuals"]) == ["b"]


def test_without_a_threshold_only_missing_samples_are_filled() -> None:
    made = filled(dataset(), min_confidence=None)
    assert made["dropped"].values.sum() == 0
    assert made["filled"].values.sum() == 3


@pytest.mark.parametrize(
    ("attrs", "times", "rate", "expected"),
    [
        ({}, np.arange(30) / 50, None, 50.0),
        ({"fps": None}, np.arange(30) / 50, None, 50.0),
        ({"fps": 100.0}, np.arange(30) / 50, None, 50.0),  # every other frame of a recording
        ({"fps": 100.0, "time_unit": "frames"}, np.arange(0, 60, 2), None, 50.0),
        ({"fps": None, "time_unit": "frames"}, np.arange(30), 50.0, 50.0),
        ({"fps": 50.0, "time_unit": None}, np.arange(30), None, 50.0),
        ({"fps": None}, np.arange(30) * np.timedelta64(20, "ms"), None, 50.0),
    ],
)
def test_frame_rate(attrs: dict, times: np.ndarray, rate: float | None, expected: float) -> None:
    given = dataset(**attrs)
    given.coords["time"].values = times
    made = filled(given, rate=rate, gap_filter=pf.GapFilter(max_gap=0.0601))
    assert made["filled"].values.sum() == 6  # 3 frames of 20 ms
    made = filled(given, rate=rate, gap_filter=pf.GapFilter(max_gap=0.0599))
    assert made["filled"].values.sum() == 0
    notes = json.loads(made.attrs["priorfill"])["notes"]
    assert any("fps is 100; the times are used" in note for note in notes) == (
        attrs.get("fps") == 100.0 and "time_unit" not in attrs
    )


def changed(name: str, **changes: Any) -> Dataset:
    given = dataset()
    for attribute, value in changes.items():
        setattr(given.coords.get(name) or given[name], attribute, value)
    return given


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        (dataset(fps=None, time_unit="frames"), ClipError, "neither fps nor times in seconds"),
        (changed("time", values=np.arange(30) ** 1.5), ClipError, "not evenly spaced"),
        (changed("position", values=bodies()[0][:, :2]), ClipError, "has 2 spatial dimensions"),
        (changed("space", values=["rho", "phi", "z"]), ClipError, "rho, phi, z; x, y, z are"),
        (changed("position", dims=(*DIMS[:3], "views")), ClipError, "time, space, keypoints, vie"),
        (changed("confidence", dims=("a", "b", "c")), ClipError, "confidence has the dimensions"),
        (Dataset({}, {}, {}), ClipError, "no variable position"),
        (changed("position", values=bodies()[0][:0]), ClipError, "the dataset has no frames"),
        (changed("position", values=bodies()[0][:, :, :0]), ClipError, "has no keypoints"),
        (changed("position", values=bodies()[0][..., :0]), ClipError, "has no individuals"),
        (standing(), ClipError, "no variable position"),
        (changed("confidence", values=bodies()[1] * np.nan), OptionError, "has no confidences"),
    ],
)
def test_other_layouts_are_refused(given: Any, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        filled(given)


@pytest.mark.parametrize("argument", ["rate", "min_confidence", "unit", "up"])
def test_arguments_of_a_wrong_type(argument: str) -> None:
    value = 3 if argument in ("unit", "up") else "much"
    with pytest.raises(TypeError, match=f"`{argument}` is of type .*; give a"):
        filled(dataset(), **{argument: value})


def test_with_xarray_itself() -> None:
    """Uses xarray, and dask, if installed; the other tests need neither."""
    xarray = pytest.importorskip("xarray")
    stand_in = dataset()
    variables = {name: (one.dims, one.values) for name, one in stand_in.data_vars.items()}
    coords = {name: one.values for name, one in stand_in.coords.items()}
    given = xarray.Dataset(variables, coords, stand_in.attrs)
    made = filled(given)
    expected = filled(stand_in)["position"].values
    assert np.array_equal(made.position.values, expected, equal_nan=True)
    assert made.sel(keypoints="C7", individuals="b").filled.values.sum() == 3
    pytest.importorskip("dask")
    lazy = filled(given.chunk({"time": 7}))
    assert lazy.identical(made)
