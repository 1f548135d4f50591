"""Bits that change on the disk: found, named by clip, and never learnt from."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gappy import ARM, person, with_gaps
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from priorfill.clip import Clip
from priorfill.database import ClipOrigin, ClipRecord, PriorDatabase
from priorfill.errors import DatabaseCorruptError, DatabaseError, DatabaseFormatError
from priorfill.filling.fill_clip import fill
from priorfill.filling.result import Result

LABELS = ("LASI", "RASI", "SACR", "C7")
CLIPS = 5
LEVELS = 3


def small_clip(seed: int) -> Clip:
    rng = np.random.default_rng([5, seed])
    t = np.arange(60 + 7 * seed)[:, None, None] / 60
    place = rng.uniform(-500, 500, (1, len(LABELS), 3))
    positions = place + 200 * np.sin(2 * np.pi * rng.uniform(0.5, 2, place.shape) * t)
    positions[20:30, 1] = np.nan
    return Clip(positions, LABELS, 60.0, name=f"clip{seed}", subject=f"subject{seed}")


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A database of small clips, one with filled samples, and one removed."""
    folder = tmp_path_factory.mktemp("sound") / "db"
    with PriorDatabase.create(folder) as database:
        for seed in range(CLIPS):
            clip = small_clip(seed)
            filled = np.zeros(clip.missing.shape, dtype=bool)
            filled[5:15, 2] = seed == 1
            database.add(clip, ClipOrigin(licence="CC0"), filled=filled, filled_by="splines")
        database.remove([record for record in database.clips() if record.name == "clip3"])
    return folder


@pytest.fixture
def copy(sound: Path, in_memory: Path) -> Iterator[Path]:
    folder = in_memory / "copy"
    shutil.copytree(sound, folder)
    yield folder
    shutil.rmtree(folder)


def everything(folder: Path) -> dict[str, tuple[Any, ...]]:
    """What a reader gets of each clip: record, positions, mask."""
    with PriorDatabase.open(folder) as database:
        return {record.content: of(database, record) for record in database.clips()}


def of(database: PriorDatabase, record: ClipRecord) -> tuple[Any, ...]:
    mask = database.filled(record)
    return (
        asdict(record),
        *(database.positions(record, level).tobytes() for level in range(LEVELS)),
        None if mask is None else mask.tobytes(),
    )


def flip(file: Path, position: int, bit: int) -> None:
    data = bytearray(file.read_bytes())
    data[position] ^= 1 << bit
    file.write_bytes(data)


def findings(folder: Path) -> list[str]:
    """The damage that opening and verifying report."""
    try:
        with PriorDatabase.open(folder) as database:
            return database.verify()
    except DatabaseError as error:
        return [str(error)]


several = settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@several
@given(where=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_a_bit_of_a_segment(where: float, bit: int, sound: Path, copy: Path) -> None:
    """Found and named by clip; the others are unchanged."""
    file = copy / "segments" / "000001.f32"
    shutil.copyfile(sound / "segments" / "000001.f32", file)
    position = int(where * file.stat().st_size)
    flip(file, position, bit)
    with PriorDatabase.open(copy) as database:
        hit = [r for r in database.clips() if r.offset <= position < r.offset + r.nbytes]
        (problem,) = database.verify()
        names = [record.name for record in hit] or ["000001.f32"]  # where the clip was removed
        assert names[0] in problem
        was = everything(sound)
        for record in database.clips():
            if record in hit:
                with pytest.raises(DatabaseCorruptError, match=record.name):
                    database.check(record)
            else:
                database.check(record)
                assert of(database, record) == was[record.content]


@several
@given(where=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7), has_checksum=st.booleans())
@example(where=0.0, bit=0, has_checksum=True)
def test_a_bit_of_the_catalogue(
    where: float, bit: int, has_checksum: bool, sound: Path, copy: Path
) -> None:
    """Found, or without effect: what is not reported as damaged reads as written."""
    (file,) = copy.glob("*.sqlite")
    (checksum,) = sound.glob("*.checksum")
    shutil.copyfile(sound / file.name, file)
    shutil.copyfile(checksum, copy / checksum.name)
    if not has_checksum:  # as after a killed writer
        (copy / checksum.name).unlink()
    flip(file, int(where * file.stat().st_size), bit)
    found = findings(copy)
    if has_checksum:
        assert found, "the checksum file covers every byte"
    assert all("\n" not in line for line in found)
    was = everything(sound)
    if not found:
        assert everything(copy) == was
        return
    try:
        with PriorDatabase.open(copy) as database:
            for record in database.clips():
                with suppress(DatabaseCorruptError):
                    database.check(record)
                    # clips that pass the check are unchanged
                    assert of(database, record) == was[record.content]
    except DatabaseError:
        pass  # cannot be opened, with an error
    with pytest.raises(DatabaseError) if has_checksum else suppress(DatabaseError):
        PriorDatabase.open(copy, write=True).close()  # writers refuse it


@several
@given(where=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7), name=st.integers(0, 1))
def test_a_bit_of_the_small_files(
    where: float, bit: int, name: int, sound: Path, copy: Path
) -> None:
    """The checksum file and the manifest: found, or without effect."""
    (checksum,) = sound.glob("*.checksum")
    names = (checksum.name, "priorfill-database.json")
    for each in names:
        shutil.copyfile(sound / each, copy / each)
    file = copy / names[name]
    flip(file, int(where * file.stat().st_size), bit)
    found = findings(copy)
    if not found:
        assert everything(copy) == everything(sound)
    assert found or names[name] != checksum.name


def test_a_row_is_named(copy: Path) -> None:
    """A byte in a clip's row: the clip is named, the others can be read."""
    (file,) = copy.glob("*.sqlite")
    position = file.read_bytes().rindex(b"subject4")
    flip(file, position, 0)
    (first, *_) = findings(copy)
    assert "the catalogue's row of clip clip4 is damaged" in first
    with PriorDatabase.open(copy) as database:
        assert "clip4" in database.damaged
        assert {record.name for record in database.clips()} == {"clip0", "clip1", "clip2"}


def test_an_undamaged_database(sound: Path) -> None:
    assert findings(sound) == []
    assert len(everything(sound)) == CLIPS - 1


# --- filling ---


@pytest.fixture(scope="module")
def prior(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four people who walk."""
    folder = tmp_path_factory.mktemp("gpr") / "db"
    with PriorDatabase.create(folder) as database:
        for body in range(1, 5):
            database.add(person("walking", 3.0, seed=body, body=body))
    return folder


@pytest.fixture(scope="module")
def gappy() -> Clip:
    """A clip whose arm is never seen, so that it is filled from the database alone."""
    clip = person("walking", 2.0, seed=9, body=9)
    return with_gaps(clip, (0, clip.frames, ARM[:3]))


def without(folder: Path, content: str, place: Path) -> Path:
    """The database without a clip."""
    shutil.copytree(folder, place)
    with PriorDatabase.open(place, write=True) as database:
        database.remove([record for record in database.clips() if record.content == content])
        database.compact()
    return place


def assert_same(one: Result, other: Result) -> None:
    np.testing.assert_array_equal(one.filled, other.filled)
    np.testing.assert_array_equal(one.clip.positions, other.clip.positions)
    np.testing.assert_array_equal(one.expected_rms_mm, other.expected_rms_mm)


@lru_cache
def fill_of_undamaged(gappy: Clip, prior: Path, method: str) -> Result:
    return fill(gappy, database=prior, method=method)


@pytest.mark.parametrize("method", ["gpr", "baumann2011"])
@pytest.mark.parametrize("level", range(LEVELS))
def test_a_damaged_clip_is_not_learnt_from(
    prior: Path, gappy: Clip, tmp_path: Path, level: int, method: str
) -> None:
    """The fill is the one without the clip, and the clip is named if it was needed."""
    folder = tmp_path / "db"
    shutil.copytree(prior, folder)
    with PriorDatabase.open(folder) as database:
        record = database.clips()[1]
    before = sum(record.frames[:level]) * len(record.labels) * 12
    # in the middle of the level, where a coordinate changes but does not become NaN
    middle = before + record.frames[level] // 2 * len(record.labels) * 12
    flip(folder / "segments" / "000001.f32", record.offset + middle, 3)
    result = fill(gappy, database=folder, method=method)
    named = [note for note in result.notes if record.name in note and "damaged" in note]
    sound = fill_of_undamaged(gappy, prior, method)
    assert sound.notes == ()
    if named:
        left_out = without(prior, record.content, tmp_path / "without")
        assert_same(result, fill(gappy, database=left_out, method=method))
    else:  # a level that the method did not read
        assert_same(result, sound)
    if level == {"gpr": 1, "baumann2011": 0}[method]:  # the level it reads first
        assert named


def test_a_clip_with_a_damaged_row_is_not_learnt_from(
    prior: Path, gappy: Clip, tmp_path: Path
) -> None:
    folder = tmp_path / "db"
    shutil.copytree(prior, folder)
    with PriorDatabase.open(folder) as database:
        record = database.clips()[2]
    (file,) = folder.glob("*.sqlite")
    flip(file, file.read_bytes().index(record.content.encode()), 0)
    result = fill(gappy, database=folder)
    assert any("damaged" in note and record.name in note for note in result.notes)
    assert_same(result, fill(gappy, database=without(prior, record.content, tmp_path / "without")))


fills_without: dict[tuple[Path, frozenset[str]], list[Result]] = {}
"""Fills by database and by the clips removed from it; each takes a second."""


@settings(
    max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_a_fill_never_uses_what_is_damaged(
    data: st.DataObject, prior: Path, gappy: Clip, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Any bit of any file: refused, or filled as from the undamaged clips."""
    root = tmp_path_factory.mktemp("any")
    folder = root / "db"
    shutil.copytree(prior, folder)
    files = sorted(p for p in folder.rglob("*") if p.is_file() and p.name != "lock")
    file = data.draw(st.sampled_from(files))
    flip(file, data.draw(st.integers(0, file.stat().st_size - 1)), data.draw(st.integers(0, 7)))
    try:
        result = fill(gappy, database=folder)
    except (DatabaseCorruptError, DatabaseFormatError, DatabaseError):
        return
    with PriorDatabase.open(prior) as database:
        records = database.clips()
    left_out = {r.content for r in records if any(r.name in note for note in result.notes)}
    known = fills_without.setdefault((prior, frozenset(left_out)), [])
    if not known:
        expected = root / "expected"
        shutil.copytree(prior, expected)
        with PriorDatabase.open(expected, write=True) as database:
            database.remove([r for r in database.clips() if r.content in left_out])
        known.append(fill(gappy, database=expected))
    assert_same(result, known[0])
    shutil.rmtree(root)
