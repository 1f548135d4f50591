from pathlib import Path

import numpy as np
import pytest

from priorfill.clip import Clip
from priorfill.database import PriorDatabase
from priorfill.errors import DatabaseCorruptError
from priorfill.markers.definitions import load
from priorfill.search.takes import own_take, takes_from
from priorfill.signal.resample import pyramid

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
    (take,) = takes_from(database, database.clips(), ("C", "X", "A"))
    assert (take.name, take.subject, take.own) == ("one", "S1", False)
    assert len(take.rates) == len(take.lengths) == database.levels
    record = next(iter(database.clips()))
    np.testing.assert_array_equal(take.shown, [record.measured[2], 0, record.measured[0]])
    for number, (rate, length) in enumerate(zip(take.rates, take.lengths, strict=True)):
        assert rate == pytest.approx(database.rate / 2**number)
        positions_here = take.positions(number)
        stored = database.positions(record, number)
        assert positions_here.dtype == np.float32
        assert positions_here.shape == (len(stored), 3, 3) == (length, 3, 3)
        np.testing.assert_array_equal(positions_here[:, 0], stored[:, record.labels.index("C")])
        np.testing.assert_array_equal(positions_here[:, 2], stored[:, record.labels.index("A")])
        assert np.isnan(positions_here[:, 1]).all()
        some = take.positions(number, np.array([2, 1]))
        np.testing.assert_array_equal(some, positions_here[:, [2, 1]])
    # of the recording itself: 60 Hz, every 60 / rate-th frame of it
    every = round(RATE / take.rates[0])
    found = take.positions(0)[:, [2, 0]]
    np.testing.assert_allclose(found[3:-3], positions[::every][: len(found), [0, 2]][3:-3], atol=2)


def test_clips_without_a_common_marker_are_no_takes(database) -> None:
    database.add(Clip(moving(2), ("A", "B"), RATE, name="one"))
    database.add(Clip(moving(2, seed=1), ("C", "D"), RATE, name="two"))
    database.add(Clip(moving(2, seed=2), ("B", "D"), RATE, name="three"))
    takes = takes_from(database, database.clips(), ("A", "B"))
    assert {take.name for take in takes} == {"one", "three"}  # in the order of their contents
    assert takes_from(database, database.clips(), ("E",)) == ()


def test_other_spellings_are_the_same_marker(database) -> None:
    marker_set = load("plug-in-gait")
    alias, label = next(iter(marker_set.aliases.items()))
    labels = tuple(name for name in marker_set.labels if name not in marker_set.optional)
    other = tuple(alias if name == label else name.lower() for name in labels)
    database.add(Clip(moving(len(other)), other, RATE, name="lower case"))
    (take,) = takes_from(database, database.clips(), labels, marker_set)
    assert not np.isnan(take.positions(0)).any()


def test_gaps_stay_missing(database) -> None:
    positions = moving(2)
    positions[:, 1] = np.nan
    positions[40:80, 0] = np.nan
    database.add(Clip(positions, ("A", "B"), RATE, name="one"))
    (take,) = takes_from(database, database.clips(), ("A", "B"))
    for number, rate in enumerate(take.rates):
        found = take.positions(number)
        time = np.arange(len(found)) / rate
        inside = (time > 40 / RATE) & (time < 79 / RATE)
        assert np.isnan(found[inside, 0]).all()
        assert not np.isnan(found[time < 38 / RATE, 0]).any()
        assert np.isnan(found[:, 1]).all()


def test_an_upright_clip_and_one_that_lies_in_the_file_are_the_same(database) -> None:
    positions = moving(4)
    lying = positions[..., [1, 2, 0]]  # x of the file is y upright, y is z, z is x
    database.add(Clip(positions, tuple("ABCD"), RATE, name="z"))
    database.add(Clip(lying, tuple("ABCD"), RATE, up="+Y", name="y"))
    one, two = takes_from(database, database.clips(), tuple("ABCD"))
    np.testing.assert_allclose(one.positions(0)[..., 2], two.positions(0)[..., 2], atol=1e-3)


def test_filled_samples_are_no_prior_unless_trusted(database) -> None:
    positions = moving(2)
    filled = np.zeros((120, 2), dtype=bool)
    filled[40:80, 0] = True
    clip = Clip(positions, ("A", "B"), RATE, name="one")
    record = database.accept(clip, filled, filled_by="me").record
    (take,) = takes_from(database, [record], ("A", "B"))
    (trusting,) = takes_from(database, [record], ("A", "B"), trust_filled=True)
    for number, rate in enumerate(take.rates):
        found = take.positions(number)
        time = np.arange(len(found)) / rate
        inside = (time > 39 / RATE) & (time < 80 / RATE)
        np.testing.assert_array_equal(np.isnan(found[:, 0, 0]), inside)
        assert not np.isnan(found[:, 1]).any()
        stored = database.positions(record, number)
        np.testing.assert_array_equal(trusting.positions(number), stored)
    assert list(trusting.shown - take.shown) == [20, 0]


def test_a_damaged_clip_shows_nothing(tmp_path: Path) -> None:
    with PriorDatabase.create(tmp_path / "db") as database:
        database.add(Clip(moving(2), ("A", "B"), RATE, name="one"))
    segment = tmp_path / "db" / "segments" / "000001.f32"
    data = bytearray(segment.read_bytes())
    data[100] ^= 4
    segment.write_bytes(data)
    with PriorDatabase.open(tmp_path / "db") as database:
        (take,) = takes_from(database, database.clips(), ("A",))
        with pytest.raises(DatabaseCorruptError, match="positions of clip one are damaged"):
            take.positions(0)
        damaged = []
        (take,) = takes_from(database, database.clips(), ("A",), on_damaged=damaged.append)
        assert np.isnan(take.positions(0)).all()
        assert np.isnan(take.positions(1)).all()  # nothing of the clip is used
        assert {str(error) for error in damaged} == {str(damaged[0])}


def test_what_is_found_damaged_late_is_withdrawn(tmp_path: Path) -> None:
    with PriorDatabase.create(tmp_path / "db") as database:
        record = database.add(Clip(moving(2), ("A", "B"), RATE, name="one"))
    segment = tmp_path / "db" / "segments" / "000001.f32"
    data = bytearray(segment.read_bytes())
    data[record.offset + record.frames[0] * 2 * 3 * 4 + 8] ^= 4  # in the second resolution
    segment.write_bytes(data)
    with PriorDatabase.open(tmp_path / "db") as database:
        damaged = []
        given = (database, database.clips(), ("A",))
        after_use = {}
        callbacks = {"on_damaged": damaged.append, "on_damaged_after_use": after_use.__setitem__}
        (take,) = takes_from(*given, **callbacks)
        assert not np.isnan(take.positions(0)).any()
        assert after_use == {}
        for level in (1, 0, 2):
            assert np.isnan(take.positions(level)).all()
            assert list(after_use) == [record.content]
        assert "positions of clip one are damaged" in str(after_use[record.content])
        assert damaged == []
        (take,) = takes_from(*given, **callbacks)
        for level in (1, 0, 2):  # in this order nothing had been used yet
            assert np.isnan(take.positions(level)).all()
        assert len(damaged) == 1


def test_own_take() -> None:
    positions = moving(3)
    positions[10:20, 1] = np.nan
    take = own_take(pyramid(positions, RATE, 3), "mine", "me")
    assert (take.name, take.subject, take.own) == ("mine", "me", True)
    assert take.rates == (60, 30, 15)
    np.testing.assert_array_equal(take.positions(0), positions)


@pytest.mark.parametrize(("rate", "nearest"), [(500, 60), (60, 60), (43, 60), (42, 30), (1, 15)])
def test_nearest_level_is_by_ratio(rate, nearest) -> None:
    take = own_take(pyramid(moving(1), RATE, 3), "mine", "")
    assert take.rates[take.nearest_level(rate)] == nearest


def test_damage_after_use_without_a_callback_of_its_own(tmp_path: Path) -> None:
    with PriorDatabase.create(tmp_path / "db") as database:
        record = database.add(Clip(moving(2), ("A", "B"), RATE, name="one"))
    segment = tmp_path / "db" / "segments" / "000001.f32"
    data = bytearray(segment.read_bytes())
    data[record.offset + record.frames[0] * 2 * 3 * 4 + 8] ^= 4  # in the second resolution
    segment.write_bytes(data)
    with PriorDatabase.open(tmp_path / "db") as database:
        damaged = []
        (take,) = takes_from(database, database.clips(), ("A",), on_damaged=damaged.append)
        take.positions(0)
        assert damaged == []
        assert np.isnan(take.positions(1)).all()
        assert "positions of clip one are damaged" in str(damaged[0])
        (take,) = takes_from(database, database.clips(), ("A",))
        take.positions(0)
        with pytest.raises(DatabaseCorruptError, match="positions of clip one are damaged"):
            take.positions(1)
