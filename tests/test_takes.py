from pathlib import Path

import numpy as np
import pytest

from priorfill.clip import Clip
from priorfill.database import PriorDatabase
from priorfill.markerset import load
from priorfill.takes import own_take, takes_from

RATE = 60.0


def moving(markers, frames=120, seed=0):
    rng = np.random.default_rng(seed)
    time = np.arange(frames)[:, None, None] / RATE
    return rng.normal(0, 300, (markers, 3)) + [0, 0, 1000] + 50 * np.sin(2 * time + seed)


@pytest.fixture
def database(tmp_path: Path):
    with PriorDatabase.create(tmp_path / "db") as database:
        yield database


def test_columns_are_in_the_clips_order(database) -> None:
    positions = moving(3)
    database.add(Clip(positions, ("A", "B", "C"), RATE, name="one", subject="S1"))
    (take,) = takes_from(database, ("C", "X", "A"))
    assert (take.name, take.subject, take.own) == ("one", "S1", False)
    assert len(take.levels) == database.levels
    record = next(iter(database.clips()))
    for number, level in enumerate(take.levels):
        assert level.rate == pytest.approx(database.rate / 2**number)
        assert level.step == 2**number
        stored = database.positions(record, number)
        assert level.positions.dtype == np.float32
        assert level.positions.shape == (len(stored), 3, 3)
        np.testing.assert_array_equal(level.positions[:, 0], stored[:, record.labels.index("C")])
        np.testing.assert_array_equal(level.positions[:, 2], stored[:, record.labels.index("A")])
        assert np.isnan(level.positions[:, 1]).all()
    # of the recording itself: 60 Hz, every 60 / rate-th frame of it
    every = round(RATE / take.levels[0].rate)
    found = take.levels[0].positions[:, [2, 0]]
    np.testing.assert_allclose(found[3:-3], positions[::every][: len(found), [0, 2]][3:-3], atol=2)


def test_clips_without_a_common_marker_are_no_takes(database) -> None:
    database.add(Clip(moving(2), ("A", "B"), RATE, name="one"))
    database.add(Clip(moving(2, seed=1), ("C", "D"), RATE, name="two"))
    database.add(Clip(moving(2, seed=2), ("B", "D"), RATE, name="three"))
    assert [take.name for take in takes_from(database, ("A", "B"))] == ["one", "three"]
    assert takes_from(database, ("E",)) == ()


def test_other_spellings_are_the_same_marker(database) -> None:
    marker_set = load("plug-in-gait")
    alias, label = next(iter(marker_set.aliases.items()))
    labels = tuple(name for name in marker_set.labels if name not in marker_set.optional)
    other = tuple(alias if name == label else name.lower() for name in labels)
    database.add(Clip(moving(len(other)), other, RATE, name="lower case"))
    (take,) = takes_from(database, labels, marker_set)
    assert not np.isnan(take.levels[0].positions).any()


def test_gaps_stay_missing(database) -> None:
    positions = moving(2)
    positions[:, 1] = np.nan
    positions[40:80, 0] = np.nan
    database.add(Clip(positions, ("A", "B"), RATE, name="one"))
    (take,) = takes_from(database, ("A", "B"))
    for level in take.levels:
        time = np.arange(len(level.positions)) / level.rate
        inside = (time > 40 / RATE) & (time < 79 / RATE)
        assert np.isnan(level.positions[inside, 0]).all()
        assert not np.isnan(level.positions[time < 38 / RATE, 0]).any()
        assert np.isnan(level.positions[:, 1]).all()


def test_an_upright_clip_and_one_that_lies_in_the_file_are_the_same(database) -> None:
    positions = moving(4)
    lying = positions[..., [1, 2, 0]]  # x of the file is y upright, y is z, z is x
    database.add(Clip(positions, tuple("ABCD"), RATE, name="z"))
    database.add(Clip(lying, tuple("ABCD"), RATE, up="+Y", name="y"))
    one, two = takes_from(database, tuple("ABCD"))
    np.testing.assert_allclose(
        one.levels[0].positions[..., 2], two.levels[0].positions[..., 2], atol=1e-3
    )


def test_own_take() -> None:
    positions = moving(3)
    positions[10:20, 1] = np.nan
    take = own_take(positions, RATE, 3, "mine", "me")
    assert (take.name, take.subject, take.own) == ("mine", "me", True)
    assert [level.rate for level in take.levels] == [60, 30, 15]
    np.testing.assert_array_equal(take.levels[0].positions, positions)


@pytest.mark.parametrize(("rate", "nearest"), [(500, 60), (60, 60), (43, 60), (42, 30), (1, 15)])
def test_nearest_level_is_by_ratio(rate, nearest) -> None:
    take = own_take(moving(1), RATE, 3, "mine", "")
    assert take.nearest_level(rate).rate == nearest
