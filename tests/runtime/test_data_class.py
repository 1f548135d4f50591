"""Dataclasses behave as those of the standard library."""

import copy
import dataclasses
import pickle
import re
from collections.abc import Callable
from inspect import signature
from pathlib import Path
from typing import Any

import pytest

import priorfill
from priorfill.runtime import data_class
from priorfill.runtime.data_class import dataclass


def point(decorator: Callable[..., Any], **options: bool) -> Any:
    """Make a class with every kind of field."""

    @decorator(**options)
    class Point:
        """A point."""

        x: float
        y: float = 1.5
        names: list[str] = dataclasses.field(default_factory=list)
        note: str = dataclasses.field(default="", repr=False, compare=False)
        key: int = dataclasses.field(default=3, hash=False)
        counted: int = dataclasses.field(default=0, init=False)
        made: tuple[int, ...] = dataclasses.field(default_factory=tuple, init=False)

        def twice(self) -> float:
            return 2 * self.x

    return Point


STANDARD = (  # modules with the decorator of the standard library
    "data_class.py",
    "ensemble.py",
    "ensembles.py",
    "fitted_models.py",
    "kernels.py",
    "process.py",
)

KINDS = [{}, {"eq": False}, {"frozen": True}, {"frozen": True, "eq": False}]


def outcome(act: Callable[[], object]) -> object:
    """Return what a call returns, or its error."""
    try:
        return act()
    except Exception as error:
        return type(error), str(error)


@pytest.mark.parametrize("options", KINDS)
def test_classes_are_alike(options: dict[str, bool]) -> None:
    ours, standard = point(dataclass, **options), point(dataclasses.dataclass, **options)
    assert str(signature(ours)) == str(signature(standard))
    assert ours.__match_args__ == standard.__match_args__
    assert [one.name for one in dataclasses.fields(ours)] == [
        one.name for one in dataclasses.fields(standard)
    ]
    actions: list[Callable[[Any], object]] = [
        lambda cls: repr(cls(1.0)),
        lambda cls: repr(cls(1.0, 2.0, ["a"], "unseen", 4)),
        lambda cls: cls(),
        lambda cls: cls(1.0, counted=3),
        lambda cls: cls(1.0, nothing=3),
        lambda cls: cls(1, 2, [], "", 3, 4),
        lambda cls: cls(1.0) == cls(1.0),
        lambda cls: cls(1.0) == cls(1.0, key=4),
        lambda cls: cls(1.0, note="a") == cls(1.0, note="b"),
        lambda cls: cls(1.0) == 1.0,
        lambda cls: cls(1.0).names is cls(1.0).names,
        lambda cls: hash(cls(1.0, names=())) == hash(cls(1.0, names=(), key=4, note="c")),
        lambda cls: hash(cls(1.0, names=())) == hash(cls(2.0, names=())),
        lambda cls: hash(cls(1.0)),
        lambda cls: setattr(cls(1.0), "x", 2.0),
        lambda cls: setattr(cls(1.0), "other", 2.0),
        lambda cls: delattr(cls(1.0), "x"),
        lambda cls: dataclasses.asdict(cls(1.0, 3)),
        lambda cls: dataclasses.replace(cls(1.0, 3), y=5.0).y,
        lambda cls: dataclasses.replace(cls(1.0, 3), made=(1,)),
        lambda cls: copy.deepcopy(cls(1.0, names=["a"])).names,
        lambda cls: repr(cls(cls(1.0))),
        lambda cls: cls(1.0).twice(),
        lambda cls: cls.__init__.__qualname__,
    ]
    for index, act in enumerate(actions):
        one, other = outcome(lambda act=act: act(ours)), outcome(lambda act=act: act(standard))
        if index == 13 and "eq" in options:  # the hash of an object is its place in memory
            assert isinstance(one, int)
        else:
            assert one == other, index


def test_an_object_may_contain_itself():
    one = point(dataclass)(1.0)
    one.names.append(one)
    assert re.fullmatch(r".*Point\(x=1\.0, y=1\.5, names=\[\.\.\.\], .*\)", repr(one))


def test_methods_of_the_class_itself_stay():
    @dataclass(frozen=True)
    class Named:
        name: str

        def __repr__(self) -> str:
            return self.name

        def __eq__(self, other: object) -> bool:
            return True

        def __hash__(self) -> int:
            return 7

    assert (repr(Named("a")), Named("a") == Named("b"), hash(Named("a"))) == ("a", True, 7)


def test_values_are_completed_after_the_fields():
    @dataclass
    class Sum:
        first: int
        second: int
        total: int = dataclasses.field(init=False)

        def __post_init__(self) -> None:
            self.total = self.first + self.second

    assert Sum(1, second=2).total == 3


@pytest.mark.parametrize("decorator", [dataclass, dataclasses.dataclass])
def test_frozen_classes_have_frozen_subclasses_alone(decorator: Callable[..., Any]) -> None:
    base = point(dataclass, frozen=True)

    @decorator(frozen=True)
    class Further(base):
        """With one more field."""

        z: float = 4.0

    assert Further(1.0, z=5.0).z == 5.0
    with pytest.raises(dataclasses.FrozenInstanceError, match="cannot assign to field 'x'"):
        Further(1.0).x = 2.0
    with pytest.raises(TypeError, match="cannot inherit non-frozen"):

        @decorator
        class Changeable(base):
            """Cannot be changed."""

    class Plain(base):
        """No dataclass: what it adds may change."""

    plain = Plain(1.0)
    plain.added = 3  # type: ignore[attr-defined]
    with pytest.raises(dataclasses.FrozenInstanceError):
        plain.x = 2.0


def test_objects_are_ordered():
    @dataclass(frozen=True, order=True)
    class Version:
        major: int
        minor: int = 0

    assert Version(1, 2) < Version(2)


@dataclass(frozen=True)
class Kept:
    """A class that pickle finds."""

    value: int


def test_objects_are_pickled():
    assert pickle.loads(pickle.dumps(Kept(3))) == Kept(3)


def test_a_class_that_is_not_used_compiles_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    compiled = data_class._initializer
    monkeypatch.setattr(data_class, "_initializer", lambda cls: made.append(cls) or compiled(cls))
    unused, used = point(dataclass, frozen=True), point(dataclass, frozen=True)
    used(1.0), used(2.0)
    assert unused not in made
    assert made == [used]


def test_modules_use_this_decorator():
    """Each class of the standard one costs every process that imports it 0.4 to 0.8 ms."""
    folder = Path(priorfill.__file__).parent
    standard = re.compile(r"^from dataclasses import .*\bdataclass\b|^import dataclasses", re.M)
    assert [
        module.relative_to(folder).as_posix()
        for module in sorted(folder.rglob("*.py"))
        if standard.search(module.read_text("utf-8")) and module.name not in STANDARD
    ] == []
