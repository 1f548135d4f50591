"""A database keeps one version of a recording, and removed clips have no effect."""

from __future__ import annotations

import shutil
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from db_cli import small_clip
from gappy import person, with_gaps
from hypothesis import given, settings
from hypothesis import strategies as st
from platforms import WINDOWS
from scripted import load_script

from priorfill.clip import Clip
from priorfill.database import ClipOrigin, PriorDatabase, Selection
from priorfill.database.segments import MARK_BYTES
from priorfill.database.sketch import (
    MIN_HASHES,
    MIN_SHARED_HASHES,
    is_version,
    sketch,
)
from priorfill.errors import (
    DatabaseCorruptError,
    DatabaseError,
    DuplicateClipError,
    OptionError,
)
from priorfill.filling.fill_clip import fill
from priorfill.filling.fill_options import FillOptions

FIXTURE = Path(__file__).parents[1] / "fixtures" / "database-1"
FIRST_SAMPLE = (-168.127609, 111.895973, 7.632660)
"""mm. First marker of the clip ``walk1`` in its first frame."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "db"


def gappy_and_filled(seed: int = 0) -> tuple[Clip, Clip, np.ndarray]:
    whole = person(seed=seed)
    gappy = with_gaps(whole, (60, 120, ("LKNE", "LANK", "LTOE")))
    moved = whole.positions + gappy.missing[..., None] * 3.0
    return gappy, whole.with_positions(moved), gappy.missing


def state(folder: Path) -> list[tuple[object, ...]]:
    """Everything that a fill reads from a database."""
    with PriorDatabase.open(folder) as database:
        assert database.verify() == []
        return [
            (
                record.content,
                record.name,
                record.measured,
                record.filled_by,
                None if (mask := database.filled(record)) is None else mask.tobytes(),
                *(database.positions(record, n).tobytes() for n in range(database.levels)),
            )
            for record in database.clips()
        ]


# --- sketches ---


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.1, 0.6), st.booleans())
def test_sketches_identify_versions_of_a_recording(seed: int, gone: float, mirrored: bool) -> None:
    rng = np.random.default_rng(seed)
    whole = np.cumsum(rng.normal(0, 3, (500, 30, 3)), axis=0)
    gappy = whole.copy()
    gappy[rng.random((500, 30)) < gone] = np.nan
    filled = np.where(np.isnan(gappy), whole + 1.0, gappy)
    if mirrored:  # neither the order of markers nor of frames matters
        filled = filled[::-1, ::-1]
    one, other = sketch(gappy), sketch(filled)
    assert (np.diff(one.astype(int)) > 0).all() and len(one) >= MIN_HASHES - 1
    shared = len(np.intersect1d(one, other))
    assert is_version(shared, len(one), len(other), same_length=True)
    stranger = sketch(np.cumsum(rng.normal(0, 3, (500, 30, 3)), axis=0))
    assert len(np.intersect1d(one, stranger)) == 0


def test_sketches_are_sets_of_present_samples() -> None:
    positions = np.random.default_rng(0).normal(0, 300, (4, 2, 3))
    assert len(sketch(positions)) == 8
    assert len(sketch(np.concatenate([positions, positions]))) == 8
    assert len(sketch(np.full((4, 2, 3), np.nan))) == 0
    zero = np.zeros((1, 1, 3))
    assert sketch(zero).tolist() == sketch(-zero).tolist()


def test_a_part_is_not_a_version_of_a_longer_recording() -> None:
    positions = np.cumsum(np.random.default_rng(1).normal(0, 3, (3000, 41, 3)), axis=0)
    whole, part = sketch(positions), sketch(positions[1000:1500])
    assert len(np.intersect1d(whole, part)) >= 3
    assert not is_version(
        len(np.intersect1d(whole, part)), len(whole), len(part), same_length=False
    )


@pytest.mark.parametrize(
    ("shared", "one", "other", "same_length", "expected"),
    [
        (10, 100, 1000, True, True),  # a tenth of the smaller one
        (10, 1000, 100, True, True),
        (9, 100, 1000, True, False),
        (MIN_SHARED_HASHES, 4, 5, True, True),
        (MIN_SHARED_HASHES - 1, 3, 3, True, False),
        (90, 90, 100, False, True),  # nine tenths of the larger one
        (89, 100, 89, False, False),
        (100, 100, 1000, False, False),  # a part of a longer recording
    ],
)
def test_the_share_that_versions_have_in_common(
    shared: int, one: int, other: int, same_length: bool, expected: bool
) -> None:
    assert is_version(shared, one, other, same_length=same_length) == expected


# --- which version is kept ---


def test_a_filled_clip_replaces_the_one_with_gaps(folder: Path) -> None:
    gappy, filled, mask = gappy_and_filled()
    with PriorDatabase.create(folder) as database:
        first = database.add(
            gappy, ClipOrigin(subject="anna", session="s1", licence="CC0", credit="me")
        )
        accepted = database.accept(filled, mask, filled_by="gpr")
        assert accepted.replaced == (first,)
        assert database.clips() == (accepted.record,)
        new = accepted.record
        assert (new.subject, new.session, new.licence, new.credit) == (
            "anna",
            "s1",
            "CC0",
            "me",
        )
        assert new.filled_by == "gpr" and new.has_filled
        assert new.measured == first.measured and new.present != new.measured
        assert database.verify() == []
        # the one with gaps is now refused
        with pytest.raises(DuplicateClipError, match="is in the database already, filled"):
            database.add(gappy)
        with pytest.raises(DuplicateClipError, match="nothing to do"):
            database.accept(filled, mask, filled_by="gpr")


def test_either_order_gives_the_same(folder: Path, tmp_path: Path) -> None:
    gappy, filled, mask = gappy_and_filled()
    with PriorDatabase.create(folder) as database:
        database.add(gappy)
        database.accept(filled, mask, filled_by="gpr")
    with PriorDatabase.create(tmp_path / "other") as database:
        database.accept(filled, mask, filled_by="gpr")
        with pytest.raises(DuplicateClipError):
            database.add(gappy)
    assert state(folder) == state(tmp_path / "other")


def test_an_accepted_fill_replaces_another_one(folder: Path) -> None:
    _, filled, mask = gappy_and_filled()
    better = filled.with_positions(filled.positions + mask[..., None] * 1.0)
    with PriorDatabase.create(folder) as database:
        first = database.accept(filled, mask, filled_by="linear").record
        with pytest.raises(DuplicateClipError, match="to put this one in its place, accept it"):
            database.add(better, filled=mask, filled_by="gpr")
        assert database.accept(better, mask, filled_by="gpr").replaced == (first,)
        assert [record.filled_by for record in database.clips()] == ["gpr"]


def test_measured_samples_are_not_replaced_by_filled_ones(folder: Path) -> None:
    _, filled, mask = gappy_and_filled()
    with PriorDatabase.create(folder) as database:
        database.add(person(seed=0))
        with pytest.raises(DuplicateClipError, match="with samples measured that are filled here"):
            database.accept(filled, mask, filled_by="gpr")
        assert not database.clips()[0].has_filled


def test_a_fill_added_as_measured_can_be_corrected(folder: Path) -> None:
    gappy, filled, mask = gappy_and_filled()
    with PriorDatabase.create(folder) as database:
        wrong = database.add(filled)
        with pytest.raises(DuplicateClipError, match="with as many samples or more"):
            database.add(gappy)
        assert database.accept(filled, mask, filled_by="gpr").replaced == (wrong,)
        assert database.clips()[0].measured != wrong.measured


def test_a_complete_version_must_be_accepted(folder: Path) -> None:
    gappy, filled, _ = gappy_and_filled()
    with PriorDatabase.create(folder) as database:
        database.add(gappy)
        with pytest.raises(DuplicateClipError, match=r"accept it \(priorfill db accept\)"):
            database.add(filled)


def test_a_part_of_a_clip_is_another_clip(folder: Path) -> None:
    whole = person(seconds=6.0)
    part = Clip(whole.positions[100:260], whole.labels, whole.rate, name="part")
    with PriorDatabase.create(folder) as database:
        database.add(whole)
        database.add(part)
        assert len(database.clips()) == 2


def test_interpolated_samples_of_a_file(folder: Path) -> None:
    """A clip whose file marks interpolated samples is added with the mask."""
    from dataclasses import replace

    from priorfill.clip import Source

    gappy, filled, mask = gappy_and_filled()
    source = Source(Path("x.c3d"), "", (), (), interpolated=mask)
    with PriorDatabase.create(folder) as database:
        first = database.add(gappy)
        record = database.add(replace(filled, source=source))
        assert record.measured == first.measured
        assert record.filled_by == "another program"
        assert database.clips() == (record,)


def test_a_clip_is_not_filled_from_its_own_recording(folder: Path) -> None:
    clip = with_gaps(person(), (60, 90, ("LKNE", "LANK")))
    whole = person()
    with PriorDatabase.create(folder) as database:
        database.add(Clip(whole.positions[20:200], whole.labels, whole.rate, name="cut"))
        database.add(whole)
        for seed in range(4, 7):
            database.add(person(seed=seed, body=seed))
        assert {record.name for record in database.versions(clip)} == {"cut", whole.name}
        result = fill(clip, database=database)
        assert any("of the same recording as the clip" in note for note in result.notes)
        used = {name for gap in result.gaps for name in gap.source_clips}
        assert "cut" not in used


# --- removing, compacting, merging ---


def test_remove_and_compact(folder: Path) -> None:
    with PriorDatabase.create(folder) as database:
        records = [database.add(person(seed=seed)) for seed in range(4)]
        database.remove(records[1:3])
    before = state(folder)
    assert len(before) == 2
    with PriorDatabase.open(folder) as reader, PriorDatabase.open(folder, write=True) as database:
        assert database.info().removed_bytes == 2 * (records[0].nbytes + MARK_BYTES)
        calls: list[tuple[int, int]] = []
        freed = database.compact(lambda done, total: calls.append((done, total)))
        # Windows removes nothing that the reader has open
        assert freed == (0 if WINDOWS else 2 * (records[0].nbytes + MARK_BYTES))
        assert calls == [(1, 2), (2, 2)]
        assert database.info().removed_bytes == 0
        assert database.compact() == 0
        assert reader.verify() == []  # of the state it has open
        with pytest.raises(DatabaseError, match="is not in the database"):
            database.remove(records[1:2])
        again = database.add(person(seed=1))
        database.remove([again])
    assert state(folder) == before


@pytest.mark.windows
def test_readers_keep_the_state_they_opened(folder: Path) -> None:
    with PriorDatabase.create(folder) as database:
        records = [database.add(person(seed=seed)) for seed in range(3)]
    with PriorDatabase.open(folder) as reader:
        with PriorDatabase.open(folder, write=True) as database:
            database.remove(records[:2])
            database.add(person(seed=7))
            database.compact()
            database.remove(database.clips())
            database.compact()
            database.add(person(seed=8))
        assert sorted(reader.clips(), key=str) == sorted(records, key=str)
        assert reader.verify() == []
    assert len(state(folder)) == 1


def test_merge(folder: Path, tmp_path: Path) -> None:
    gappy, filled, mask = gappy_and_filled(5)
    one, other, both = (tmp_path / name for name in ("one", "other", "both"))
    with PriorDatabase.create(one) as database:
        database.add(person(seed=1), ClipOrigin(subject="anna"))
        database.add(gappy)
    with PriorDatabase.create(other) as database:
        database.add(person(seed=1), ClipOrigin(subject="somebody else"))
        database.add(person(seed=2), ClipOrigin(synthetic=True, licence="CC0"))
        database.accept(filled, mask, filled_by="gpr")
    with PriorDatabase.create(both) as database:
        database.add(person(seed=2), ClipOrigin(synthetic=True, licence="CC0"))
        database.accept(filled, mask, filled_by="gpr")
        database.add(person(seed=1), ClipOrigin(subject="anna"))
    with PriorDatabase.open(one, write=True) as database, PriorDatabase.open(other) as source:
        merged = database.merge(source)
        assert len(merged.added) == 2
        assert [record.subject for record in merged.skipped] == ["somebody else"]
        assert database.merge(source).added == ()
    assert state(one) == state(both)
    slow = PriorDatabase.create(tmp_path / "slow", rate=25)
    with (
        slow,
        PriorDatabase.open(one) as source,
        pytest.raises(OptionError, match="levels from 30"),
    ):
        slow.merge(source)
    with PriorDatabase.open(one) as database, pytest.raises(DatabaseError, match="for reading"):
        database.remove(database.clips())


def test_damage_of_its_own_ends_a_merge(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is not reported as damage of the other database."""
    for name, seed in (("own", 1), ("other", 2)):
        with PriorDatabase.create(tmp_path / name) as database:
            database.add(person(seed=seed))

    def damaged(*_: object, **__: object) -> None:
        raise DatabaseCorruptError("own: the catalogue is damaged")

    with (
        PriorDatabase.open(tmp_path / "own", write=True) as database,
        PriorDatabase.open(tmp_path / "other") as other,
        monkeypatch.context() as patch,
    ):
        patch.setattr(database, "_store", damaged)
        with pytest.raises(DatabaseCorruptError, match="own: the catalogue"):
            database.merge(other)


# --- growth ---


@pytest.mark.parametrize("method", ["gpr", "baumann2011"])
def test_the_order_of_changes_has_no_effect(tmp_path: Path, method: str) -> None:
    """Any order, with removals and compactions in between, gives the same fill bit for bit."""
    clips = [person(seconds=2.0, seed=seed, body=seed) for seed in range(10, 14)]
    gappy, filled, mask = gappy_and_filled(20)
    clip = with_gaps(person(seconds=1.5), (30, 60, ("LKNE", "LANK", "LTOE")), (0, 90, ("RTOE",)))
    results = []
    for number, order in enumerate([(0, 1, 2, 3), (3, 1, 0, 2), (2, 3, 1, 0)]):
        folder = tmp_path / str(number)
        with PriorDatabase.create(folder) as database:
            if number == 1:
                database.accept(filled, mask, filled_by="gpr")
            for i in order:
                record = database.add(clips[i])
                if number == 2:
                    database.remove([record])
                    database.compact()
                    database.add(clips[i])
            if number != 1:
                database.add(gappy)
                database.accept(filled, mask, filled_by="gpr")
        results.append(fill(clip, database=folder, method=method))
    for result in results[1:]:
        assert result.clip.positions.tobytes() == results[0].clip.positions.tobytes()
        assert result.expected_rms_mm.tobytes() == results[0].expected_rms_mm.tobytes()


# --- selection ---


def test_selection(folder: Path) -> None:
    with PriorDatabase.create(folder) as database:
        for seed, subject in enumerate(("anna", "anna", "ben")):
            positions = person(seed=seed).positions
            labels = person(seed=seed).labels
            database.add(
                Clip(positions[:, : 41 - seed], labels[: 41 - seed], 60, name=f"walk_{seed}"),
                ClipOrigin(subject=subject),
            )
        records = database.clips()

    def names(**options: tuple[str, ...]) -> list[str]:
        return sorted(record.name for record in Selection(**options).choose(records))

    assert names() == ["walk_0", "walk_1", "walk_2"]
    assert names(names=("walk_[01]",)) == ["walk_0", "walk_1"]
    assert names(names=("*_2", "walk_0")) == ["walk_0", "walk_2"]
    assert names(names=("walk",)) == []
    assert names(names=(records[0].content[:8],)) == [records[0].name]
    assert names(names=(records[0].content[:7],)) == []
    assert names(subjects=("an*",)) == ["walk_0", "walk_1"]
    assert names(not_subjects=("anna",)) == ["walk_2"]
    assert names(not_names=("*1", "*2")) == ["walk_0"]
    assert names(markers=(person().labels[40],)) == ["walk_0"]
    assert names(markers=(person().labels[39], person().labels[0])) == ["walk_0", "walk_1"]
    assert names(subjects=("anna",), not_names=("walk_0",)) == ["walk_1"]


# --- format on disk ---


def test_a_database_of_format_version_1_is_read(tmp_path: Path) -> None:
    with PriorDatabase.open(FIXTURE) as database:
        assert database.info().version == 1
        assert database.info().removed_bytes > 0
        assert database.verify() == []
        records = {record.name: record for record in database.clips()}
        assert sorted(records) == ["placed", "walk0", "walk1", "walk2"]
        accepted = records["walk0"]
        assert (accepted.filled_by, accepted.session, accepted.licence) == ("gpr", "s1", "CC0")
        assert (accepted.measured, accepted.present) == ((21, 16, 21, 21), (21,) * 4)
        mask = database.filled(accepted)
        assert mask is not None and mask[5:10, 1].all() and mask.sum() == 5
        assert [name for name, record in records.items() if record.synthetic] == ["walk2"]
        assert [name for name, record in records.items() if record.virtual_markers] == ["placed"]
        first = database.positions(records["walk1"])[0, 0]
        np.testing.assert_allclose(first, FIRST_SAMPLE, atol=1e-3)
        assert not (FIXTURE / "lock").exists()
    copy = tmp_path / "copy"
    shutil.copytree(FIXTURE, copy)
    before = state(copy)
    with PriorDatabase.open(copy, write=True) as database:
        assert database.info().version == 3  # converted, without the removed clip
        assert database.compact() == 0
        assert database.verify() == []
    assert state(copy) == before
    assert sorted(path.name for path in copy.iterdir()) == [
        "catalogue-2.checksum",
        "catalogue-2.sqlite",
        "lock",
        "priorfill-database.json",
        "segments",
    ]


@pytest.mark.parametrize("late", [False, True], ids=["not done", "done"])
def test_a_conversion_that_is_interrupted_anywhere(in_memory: Path, late: bool) -> None:
    """The old or the new version is there, and the next writer completes it."""
    script = load_script("torture_database")
    for at in range(5 if late else 2, 240, 9):
        folder = in_memory / f"converted-{late}-{at}"
        shutil.copytree(FIXTURE, folder)
        with script.Faults(folder, script.Fault(at, late=late, for_ever=True)) as faults:
            with suppress(OSError, DatabaseError):
                PriorDatabase.open(folder, write=True).close()
            struck = faults.struck
        assert state(folder) == state(FIXTURE), f"call {at}: {struck}"
        with PriorDatabase.open(folder, write=True) as database:
            assert database.verify() == [], f"call {at}: {struck}"
            assert database.info().version == 3
        assert state(folder) == state(FIXTURE)
        assert len([*folder.glob("segments/*"), *folder.glob("*.sqlite")]) == 2
        shutil.rmtree(folder)
        if not struck:
            return
    raise AssertionError("a conversion makes more calls than expected")


def test_an_older_version_with_bytes_of_no_clip_is_not_converted(tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(FIXTURE, copy)
    (segment,) = copy.glob("segments/*")
    with segment.open("ab") as file:
        file.write(bytes(40))
    with pytest.raises(DatabaseError, match="but the catalogue counts"):
        PriorDatabase.open(copy, write=True)
    with PriorDatabase.create(tmp_path / "new") as database, PriorDatabase.open(copy) as old:
        assert "but the catalogue counts" in old.verify()[0]
        assert len(database.merge(old).added) == 4


def test_measured_samples_replace_filled_ones(folder: Path) -> None:
    """A version that measured all of them does; one that repeats the fill does not."""
    measured = small_clip("walk", 1, frames=240)
    filled = np.zeros(measured.missing.shape, dtype=bool)
    filled[40:80, 2] = True
    moved = measured.positions + 5 * filled[:, :, None]
    with PriorDatabase.create(folder) as database:
        database.add(replace(measured, positions=moved, name="fill"), filled=filled)
        again = moved + 0.001 * filled[:, :, None]
        with pytest.raises(DuplicateClipError, match="filled"):
            database.add(replace(measured, positions=again, name="again"))
        gappy = np.where(filled[:, :, None], np.nan, measured.positions)
        with pytest.raises(DuplicateClipError, match="filled"):
            database.add(replace(measured, positions=gappy, name="gappy"))
        database.add(measured)
        (record,) = database.clips()
        assert (record.name, record.has_filled) == ("walk", False)


def test_edit(folder: Path) -> None:
    with PriorDatabase.create(folder) as database:
        filled = np.zeros((240, 4), dtype=bool)
        filled[40:80, 2] = True
        database.add(small_clip("a", 1, frames=240), ClipOrigin(subject="male"), filled=filled)
        database.add(small_clip("b", 2, frames=240))
    with PriorDatabase.open(folder, write=True) as database:
        (old,) = (record for record in database.clips() if record.name == "a")
        (new,) = database.edit([old], subject="anna", session="2\n")
        assert (new.subject, new.session) == ("anna", "2_")
        assert replace(new, subject=old.subject, session=old.session) == old
        assert database.edit([new]) == (new,)
        (other,) = (record for record in database.clips() if record.name == "b")
        database.remove([other])
        with pytest.raises(DatabaseError, match="is not in the database"):
            database.edit([new, other], subject="x")
        assert database.edit([old], subject="anna") == (new,)  # the session stays
        assert database.verify() == []
        assert database.versions(small_clip("a", 1, frames=240)) == (new,)
        mask = database.filled(new)
        assert mask is not None and mask.any()
    with PriorDatabase.open(folder, write=True) as database:
        database.compact()
        assert database.verify() == []
        assert sorted(record.subject for record in database.clips()) == ["anna"]


def test_words_that_are_no_names_of_subjects(folder: Path) -> None:
    with PriorDatabase.create(folder) as database:
        for seed, word in enumerate(("male", "Female", "New Patient", "subject", " test ")):
            clip = replace(small_clip(f"c{seed}", seed), subject=word)
            assert database.add(clip).subject == ""
        clip = replace(small_clip("named", 9), subject="Subject 7")
        assert database.add(clip).subject == "Subject 7"
        said = database.add(small_clip("said", 10), ClipOrigin(subject="male"))
        assert said.subject == "male"


def test_the_same_recording_in_another_format(tmp_path: Path) -> None:
    """Rounded, rotated and with a gap, it is recognised; other takes are not."""
    one = small_clip("walk", 1, frames=480)
    turned = one.positions[..., [1, 2, 0]]  # +Y up
    turned[100:200, 2] = np.nan
    exported = Clip(turned.round(1), tuple(x.lower() for x in one.labels), 119.9, up="+Y", name="x")
    with PriorDatabase.create(tmp_path / "db") as database:
        database.add(one)
        database.add(small_clip("run", 2, frames=480))
        database.add(small_clip("part", 1, frames=240))
        assert [record.name for record in database.versions(exported)] == ["walk"]
        still = Clip(np.ones((480, 4, 3)), one.labels, 120.0)
        assert database.versions(still) == ()


# --- earlier states ---


def test_an_earlier_state_is_read_until_a_compaction(folder: Path) -> None:
    gappy, filled, mask = gappy_and_filled()
    with PriorDatabase.create(folder) as database:
        first = database.add(gappy)
        before = database.state
        database.accept(filled, mask, filled_by="linear")  # in place of the first
        database.add(small_clip("other", seed=9))
        after = database.state
    with PriorDatabase.open(folder, state=before) as past:
        assert past.clips() == (first,)
        assert past.positions(first).shape[0] == first.frames[0]
        assert [record.content for record in past.versions(filled)] == [first.content]
        assert past.state == before
    with PriorDatabase.open(folder, state=after) as present:
        assert len(present.clips()) == 2
    with pytest.raises(DatabaseError, match="compacted"):
        PriorDatabase.open(folder, state="1:99")
    with pytest.raises(OptionError, match="only be read"):
        PriorDatabase.open(folder, state=before, write=True)
    with PriorDatabase.open(folder, write=True) as database:
        database.compact()
    with pytest.raises(DatabaseError, match="compacted"):
        PriorDatabase.open(folder, state=before)


def test_a_fill_learns_from_an_earlier_state(folder: Path) -> None:
    gappy, _, _ = gappy_and_filled()
    with PriorDatabase.create(folder) as database:
        database.add(person(seed=1))
        before = database.state
        database.add(person(seed=2))
    options = FillOptions(database_state=before)
    result = fill(gappy, database=folder, method="linear", options=options)
    latest = fill(gappy, database=folder, method="linear")
    assert result.provenance.database is not None and latest.provenance.database is not None
    assert (result.provenance.database.clips, latest.provenance.database.clips) == (1, 2)
