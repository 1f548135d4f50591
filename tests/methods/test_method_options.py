"""Options by dotted name."""

from __future__ import annotations

from dataclasses import dataclass, field
from inspect import signature
from typing import Literal

import pytest

from priorfill.errors import OptionError
from priorfill.gp.kernels import Exponential, Matern32, Matern52, Matern72
from priorfill.methods import METHODS, get_method, get_options
from priorfill.methods.options import differing, flattened, with_values
from priorfill.runtime.option_checks import check_at_least, check_between


@dataclass(frozen=True)
class Training:
    max_poses: int = 250
    min_poses: int = 90
    share: float = 0.5
    limit: float | None = None
    parts: tuple[int, int] = (60, 30)
    scales: tuple[float, ...] = (0.4, 0.7)

    def __post_init__(self) -> None:
        check_at_least(self, 1, "max_poses")
        check_between(self, 0.0, 1.0, "share")
        check_between(self, 0, self.max_poses, "min_poses")


@dataclass(frozen=True)
class Everything:
    training: Training = field(default_factory=Training)
    frame: Literal["rigid", "heading"] = "rigid"
    smooth: bool = True
    title: str = ""


def test_flattened_and_differing() -> None:
    changed = Everything(Training(share=0.6), smooth=False)
    assert flattened(changed) == {
        "training.max_poses": 250,
        "training.min_poses": 90,
        "training.share": 0.6,
        "training.limit": None,
        "training.parts": (60, 30),
        "training.scales": (0.4, 0.7),
        "frame": "rigid",
        "smooth": False,
        "title": "",
    }
    assert differing(changed) == {"training.share": 0.6, "smooth": False}
    assert differing(Everything()) == {}


@pytest.mark.parametrize(
    ("name", "given", "stored"),
    [
        ("training.max_poses", "300", 300),
        ("training.max_poses", 300.0, 300),
        ("training.share", "0.25", 0.25),
        ("training.share", 1, 1.0),
        ("training.limit", "3.5", 3.5),
        ("training.limit", "None", None),
        ("training.parts", "1, 2", (1, 2)),
        ("training.parts", [1, 2], (1, 2)),
        ("training.scales", "(0.1,0.2,0.3)", (0.1, 0.2, 0.3)),
        ("frame", "heading", "heading"),
        ("smooth", "no", False),
        ("smooth", True, True),
        ("title", "12", "12"),
    ],
)
def test_values_by_name(name: str, given: object, stored: object) -> None:
    changed = with_values(Everything(training=Training(limit=9.0)), {name: given})
    value = flattened(changed)[name]
    assert value == stored
    assert type(value) is type(stored)
    others = flattened(Everything(training=Training(limit=9.0)))
    assert {k: v for k, v in flattened(changed).items() if k != name} == {
        k: v for k, v in others.items() if k != name
    }


def test_values_that_depend_on_each_other_are_set_at_once() -> None:
    for order in (1, -1):
        given = list({"training.max_poses": 50, "training.min_poses": 20}.items())[::order]
        changed = with_values(Everything(), dict(given))
        assert (changed.training.max_poses, changed.training.min_poses) == (50, 20)


@pytest.mark.parametrize(
    ("name", "given", "message"),
    [
        ("training.max_poses", "many", "training.max_poses cannot be 'many'; it must be an int"),
        ("training.max_poses", 2.5, "must be an integer"),
        ("training.max_poses", True, "must be an integer"),
        ("training.share", "1.5", "^training.share is 1.5; it must be from 0 to 1"),
        ("training.max_poses", 0, "^training.max_poses is 0; it must be at least 1"),
        ("training.min_poses", 300, "it must be from 0 to 250"),
        ("training.share", float("nan"), "must be"),
        ("training.share", "nan", "training.share cannot be 'nan'; it must be a finite number"),
        ("training.limit", "inf", "must be a finite number or none"),
        ("training.limit", float("-inf"), "must be a finite number or none"),
        ("training.max_poses", float("inf"), "must be an integer"),
        ("training.limit", "x", "must be a finite number or none"),
        ("training.parts", "1,2,3", "must be 2 values, each an integer"),
        ("training.scales", "a", "must be a list, each item a finite number"),
        ("frame", "upright", "must be one of 'rigid', 'heading'"),
        ("smooth", "maybe", "must be true or false"),
        ("title", 3, "must be text"),
        ("training", 3, "no option 'training'"),
        ("training.max_pose", 3, "did you mean training.max_poses"),
        ("share", 3, "did you mean training.share"),
        ("zzz", 3, "use one of training.max_poses, "),
    ],
)
def test_wrong_values_are_refused(name: str, given: object, message: str) -> None:
    with pytest.raises(OptionError, match=message.replace("(", r"\(")) as error:
        with_values(Everything(), {name: given})
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", METHODS)
def test_methods_accept_their_options(name: str) -> None:
    options = get_options(name)
    accepted = signature(get_method(name)).parameters
    assert ("options" in accepted) == (options is not None)
    if options is not None:
        assert differing(options) == {}
        assert options.__dataclass_params__.frozen
        assert with_values(options, {}) == options
        for option, value in flattened(options).items():
            if isinstance(value, int | float):
                assert with_values(options, {option: str(value)}) == options


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("interpolation.process.noise_variance", -1.0),
        ("interpolation.process.kernel.time_scale", 0.0),
        ("blackout.marker_decay_seconds", "0.2,0"),
        ("blackout.common_decay_seconds", "-1"),
    ],
)
def test_values_that_no_process_can_have(name: str, value: object) -> None:
    with pytest.raises(OptionError, match=f"^{name} is .*must be at least"):
        with_values(get_options("gpr"), {name: value})


SIGNED = ("blackout.correction_exponents",)


@pytest.mark.parametrize("name", METHODS)
def test_negative_numbers_are_refused(name: str) -> None:
    options = get_options(name)
    for option, value in ({} if options is None else flattened(options)).items():
        items = value if isinstance(value, tuple) else (value,)
        if option in SIGNED or not all(type(item) in (int, float) for item in items):
            continue
        negative = (-1,) * len(items) if isinstance(value, tuple) else -1
        with pytest.raises(OptionError, match=f"^{option} (is|are) "):
            with_values(options, {option: negative})


@pytest.mark.parametrize("kernel", [Exponential, Matern32, Matern52, Matern72])
def test_time_scales_are_positive(kernel: type) -> None:
    with pytest.raises(OptionError, match="time_scale is 0"):
        kernel(0.0)


def test_a_message_lists_few_options_only() -> None:
    """The default method has some hundred: the message names the command that lists them."""
    with pytest.raises(OptionError, match=r"no option 'zzz'; see: priorfill methods METHOD$"):
        with_values(get_options("gpr"), {"zzz": 1})
