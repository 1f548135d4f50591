"""Fields of dataclasses against their type hints, and options that are checked so."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import priorfill as pf
from priorfill.errors import ArgumentTypeError
from priorfill.reviewing.start import ReviewOptions
from priorfill.runtime.field_types import check_field_types


@dataclass(frozen=True)
class Example:
    count: int = 0
    length: float = 0.0
    names: tuple[str, ...] = ()
    done: Callable[[int], None] | None = None


@pytest.mark.parametrize(
    "fields",
    [{}, {"count": np.int64(3)}, {"length": 2}, {"length": np.float32(2.0)}, {"done": print}],
)
def test_fields_of_the_right_type(fields: dict[str, Any]) -> None:
    check_field_types(Example(**fields))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"count": 1.5}, r"Example.count is of type float; give int"),
        ({"count": True}, r"Example.count is of type bool; give int"),
        ({"length": "3"}, r"Example.length is of type str; give float"),
        ({"names": ["a"]}, r"Example.names is of type list; give tuple\[str, ...\]"),
        ({"names": (1,)}, r"Example.names is of type tuple; give tuple\[str, ...\]"),
        ({"done": 3}, r"Example.done is of type int; give Callable\[\[int\], None\] \| None"),
    ],
)
def test_fields_of_a_wrong_type(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ArgumentTypeError, match=message):
        check_field_types(Example(**fields))


@pytest.mark.parametrize(
    "make",
    [
        lambda: pf.StudyOptions(workers="2"),
        lambda: pf.StudyOptions(time_limit=None),
        lambda: pf.StudyOptions(summary=3),
        lambda: ReviewOptions(port="80"),
        lambda: pf.EvaluationOptions(selection="anna"),
        lambda: pf.FillOptions(plausibility=3),
        lambda: pf.FillOptions(cache={}),
        lambda: pf.evaluate([], seed="1"),
        lambda: pf.evaluate([], jobs=1.5),
        lambda: pf.evaluate([], options={"overwrite": True}),
        lambda: pf.evaluate([], output=3),
        lambda: pf.evaluate([], database=3),
    ],
)
def test_options_of_a_wrong_type_are_named(make: Callable[[], object]) -> None:
    with pytest.raises(ArgumentTypeError, match=r"is of type \w+; give "):
        make()
