"""The prior database: what is added can be read, whatever happens in between."""

from __future__ import annotations

import io
import json
import os
import shutil
import sqlite3
import stat
import time
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from db_processes import (
    LOCKED,
    PLACES,
    add_one,
    die_as_writer,
    die_in_add,
    make_clip,
    run_and_die,
    spoil,
    start,
    write_on,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from priorfill.clip import Clip
from priorfill.database import ClipOrigin, PriorDatabase, catalogue, catalogue_rows, segments
from priorfill.errors import (
    ClipError,
    DatabaseCorruptError,
    DatabaseError,
    DatabaseFormatError,
    DatabaseLockedError,
    DatabaseNotFoundError,
    DuplicateClipError,
    OptionError,
)
from priorfill.geometry.axes import to_upright
from priorfill.markers.definitions import load
from priorfill.signal.resample import pyramid, resample


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "db"


def segment_bytes(clips: Iterable[bytes]) -> int:
    """The size of a segment with these clips: a header, and a mark after each clip."""
    return segments.HEADER_BYTES + sum(len(data) + segments.MARK_BYTES for data in clips)


def snapshot(folder: Path) -> dict[str, bytes]:
    with PriorDatabase.open(folder) as database:
        return {
            record.content: b"".join(
                database.positions(record, level).tobytes() for level in range(database.levels)
            )
            for record in database.clips()
        }


# --- adding and reading ---


def test_a_segment_read_by_several_threads_is_opened_once(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If it were opened twice, the file of one thread would be closed while it is read."""
    with PriorDatabase.create(folder) as database:
        record = database.add(make_clip())
    opened = []
    really = Path.open

    def slowly(path: Path, *given: Any, **more: Any) -> Any:
        if path.suffix == ".f32":
            opened.append(path)
            time.sleep(0.05)
        return really(path, *given, **more)

    with PriorDatabase.open(folder, write=True) as database:  # readers open all segments at once
        monkeypatch.setattr(Path, "open", slowly)
        with ThreadPoolExecutor(max_workers=4) as pool:
            found = list(pool.map(lambda level: database.checked_positions(record, level), [0] * 4))
        assert len(opened) == 1
        for positions in found:
            np.testing.assert_array_equal(positions, database.positions(record))


def test_round_trip(folder: Path) -> None:
    clip = make_clip(subject="anna", up="+Y")
    with PriorDatabase.create(folder) as database:
        added = database.add(
            clip, ClipOrigin(session="s1", licence="CC0", credit="me", synthetic=True)
        )
    with PriorDatabase.open(folder) as database:
        (record,) = database.clips()
        assert record == added
        assert record.name == "clip0"
        assert (record.subject, record.session, record.licence) == ("anna", "s1", "CC0")
        assert (record.credit, record.synthetic, record.source) == ("me", True, "")
        assert (record.original_rate, record.rate) == (120.0, 30.0)
        assert record.frames == (33, 17, 9)
        assert record.duration == pytest.approx(33 / 30)
        assert record.labels == clip.labels
        assert not record.has_filled
        assert database.filled(record) is None
        fine = resample(to_upright(clip.positions, "+Y"), 120, 30)
        for level, expected in enumerate(pyramid(fine, 30, 3)):
            stored = database.positions(record, level)
            assert stored.dtype == np.float32
            np.testing.assert_array_equal(stored, expected.positions.astype(np.float32))
            assert not stored.flags.writeable
            assert np.isnan(stored).any()
        assert database.verify() == []


def test_positions_outlive_the_database(folder: Path) -> None:
    with PriorDatabase.create(folder) as database:
        record = database.add(make_clip(0))
        positions = database.positions(record)
        expected = positions.copy()
        database.remove([record])
        database.compact()
    np.testing.assert_array_equal(positions, expected)
    assert not positions.flags.writeable


@pytest.mark.windows
@pytest.mark.parametrize("has_pread", [True, False])
def test_several_threads_read_one_segment(
    folder: Path, monkeypatch: pytest.MonkeyPatch, has_pread: bool
) -> None:
    """Also where a file has to be positioned before it is read, as on Windows."""
    with PriorDatabase.create(folder) as database:
        records = [database.add(make_clip(seed)) for seed in range(8)]
        expected = [database.positions(record).tobytes() for record in records]
    if not has_pread:
        monkeypatch.delattr(os, "pread", raising=False)
    elif not hasattr(os, "pread"):
        pytest.skip("this system has no pread")
    with PriorDatabase.open(folder) as database, ThreadPoolExecutor(max_workers=8) as pool:
        for _ in range(20):
            found = pool.map(lambda record: database.checked_positions(record).tobytes(), records)
            assert list(found) == expected


def test_reads_that_return_less_than_asked_for(folder: Path) -> None:
    class Slow(io.FileIO):
        def read(self, size: int = -1, /) -> bytes:
            return super().read(min(size, 100))  # type: ignore[return-value]

    folder.write_bytes(bytes(range(250)))
    with pytest.MonkeyPatch.context() as patch, Slow(folder) as file:
        patch.delattr(os, "pread", raising=False)
        assert segments.read_at(file, 10, 230) == bytes(range(10, 240))  # type: ignore[arg-type]
        assert segments.read_at(file, 200, 100) == bytes(range(200, 250))  # type: ignore[arg-type]


def test_info(folder: Path) -> None:
    with PriorDatabase.create(folder, rate=25, levels=2) as database:
        database.add(make_clip(0), ClipOrigin(subject="anna"))
        database.add(make_clip(1), ClipOrigin(subject="anna", synthetic=True))
        database.add(make_clip(2))
    with PriorDatabase.open(folder) as database:
        info = database.info()
    assert (info.version, info.rate, info.levels) == (3, 25.0, 2)
    assert (info.clips, info.subjects, info.synthetic) == (3, 1, 1)
    assert info.frames == 3 * 27
    assert info.seconds == pytest.approx(3 * 27 / 25)
    assert info.marker_sets == {"": 3}
    assert info.bytes == sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    assert sum(len(data) for data in snapshot(folder).values()) == 3 * (27 + 14) * 4 * 12


def test_info_while_a_commit_removes_its_journal(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with PriorDatabase.create(folder) as database:
        database.add(make_clip(0))
        expected = database.info().bytes
        journal = folder / "catalogue.sqlite-journal"
        journal.write_bytes(b"unfinished")
        really = Path.is_symlink

        def removed(path: Path) -> bool:
            answer = really(path)
            if path == journal:
                journal.unlink()
            return answer

        with monkeypatch.context() as patch:
            patch.setattr(Path, "is_symlink", removed)
            assert database.info().bytes == expected


def test_marker_set_is_recognised(folder: Path) -> None:
    labels = load("baumann41").labels
    positions = np.random.default_rng(0).normal(0, 300, (60, 41, 3))
    with PriorDatabase.create(folder) as database:
        assert database.add(Clip(positions, labels, 60.0)).marker_set == "baumann41"


def test_filled_mask(folder: Path) -> None:
    clip = make_clip()
    filled = np.zeros((130, 4), dtype=bool)
    filled[8, 0] = filled[9, 2] = True  # 120 Hz: frame 8 is frame 2 of level 0, 9 is none
    filled[100:110, 3] = True
    with PriorDatabase.create(folder) as database:
        record = database.add(clip, filled=filled)
        other = database.add(make_clip(1), filled=np.zeros((130, 4), dtype=bool))
        assert not other.has_filled
    with PriorDatabase.open(folder) as database:
        assert record.has_filled
        mask = database.filled(record)
        assert mask is not None
        expected = np.zeros((33, 4), dtype=bool)
        expected[2, 0] = True
        expected[25:28, 3] = True
        np.testing.assert_array_equal(mask, expected)
    with (
        pytest.raises(OptionError, match=r"shape \(3, 4\)"),
        PriorDatabase.open(folder, write=True) as database,
    ):
        database.add(make_clip(2), filled=filled[:3])


@pytest.fixture(scope="module")
def added_at_once(in_memory: Path) -> dict[str, bytes]:
    """Contents of a database of five clips, added in one session."""
    folder = in_memory / "once"
    with PriorDatabase.create(folder) as database:
        for seed in range(5):
            database.add(make_clip(seed))
    return snapshot(folder)


@settings(max_examples=8, deadline=None)
@given(order=st.permutations(range(5)), cut=st.integers(0, 5))
def test_order_of_insertion_does_not_matter(
    order: list[int], cut: int, added_at_once: dict[str, bytes], in_memory: Path
) -> None:
    """Adding in any order, in one session or two, gives the same database."""
    root = in_memory / "order"
    root.mkdir()
    with PriorDatabase.create(root / "grown") as database:
        for seed in order[:cut]:
            database.add(make_clip(seed))
    with PriorDatabase.open(root / "grown", write=True) as database:
        for seed in order[cut:]:
            database.add(make_clip(seed))
    grown = snapshot(root / "grown")
    assert list(added_at_once.items()) == list(grown.items())
    shutil.rmtree(root)


def test_rate_of_the_clip(folder: Path) -> None:
    with PriorDatabase.create(folder) as database:
        for rate, frames in [(100.0, 39), (240.0, 17), (30.0, 130), (15.0, 259)]:
            record = database.add(make_clip(int(rate), rate=rate))
            assert record.frames[0] == frames
        with pytest.raises(ClipError, match=r"has 14\.9 Hz, too few for a database of 30 Hz"):
            database.add(make_clip(rate=14.9))


def test_segments_roll_over(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(segments, "SEGMENT_BYTES", 5000)
    with PriorDatabase.create(folder) as database:
        for seed in range(4):
            database.add(make_clip(seed))  # 59 frames of 4 markers, 2832 bytes
    before = snapshot(folder)
    assert sorted(path.name for path in (folder / "segments").iterdir()) == [
        f"{i:06d}.f32" for i in range(1, 5)
    ]
    with PriorDatabase.open(folder, write=True) as database:
        database.add(make_clip(4, frames=40))
        assert database.verify() == []
    after = snapshot(folder)
    assert {content: after[content] for content in before} == before


# --- refusals ---


def test_duplicates(folder: Path) -> None:
    with PriorDatabase.create(folder) as database:
        database.add(make_clip())
        with pytest.raises(DuplicateClipError, match=r"other: is in the database already \(as "):
            database.add(make_clip(name="other"))
        assert len(database.clips()) == 1
    with PriorDatabase.open(folder, write=True) as database, pytest.raises(DuplicateClipError):
        database.add(make_clip())


def test_useless_clips_are_refused(folder: Path) -> None:
    def clip(positions: np.ndarray) -> Clip:
        return Clip(positions, ("A", "B"), 120.0, name="x")

    moving = np.cumsum(np.ones((200, 2, 3)), axis=0)
    with PriorDatabase.create(folder) as database:
        with pytest.raises(ClipError, match="x: no marker is ever seen"):
            database.add(clip(np.full((200, 2, 3), np.nan)))
        with pytest.raises(ClipError, match=r"x: is static \(no marker moves by 10 mm\)"):
            database.add(clip(np.ones((200, 2, 3)) * 100))
        with pytest.raises(ClipError, match=r"x: is too short \(0\.07 s\)"):
            database.add(clip(moving[:8]))
        one_gone = moving.copy()
        one_gone[:, 0] = np.nan
        database.add(clip(one_gone))
        assert len(database.clips()) == 1


def test_opened_for_reading(folder: Path) -> None:
    PriorDatabase.create(folder).close()
    with PriorDatabase.open(folder) as database, pytest.raises(DatabaseError, match="for reading"):
        database.add(make_clip())


def test_no_database(tmp_path: Path) -> None:
    with pytest.raises(DatabaseNotFoundError, match="there is no database; make one with"):
        PriorDatabase.open(tmp_path / "no")
    with pytest.raises(DatabaseNotFoundError, match=r"--database (['\"]).*lab priors\1 \.\.\."):
        PriorDatabase.open(tmp_path / "lab priors")
    (tmp_path / "file").write_text("x")
    with pytest.raises(DatabaseNotFoundError, match="is a file"):
        PriorDatabase.open(tmp_path / "file")
    with pytest.raises(DatabaseFormatError, match="is a file"):
        PriorDatabase.open_or_create(tmp_path / "file")
    with pytest.raises(DatabaseFormatError, match="is not a priorfill database"):
        PriorDatabase.open(tmp_path)
    with pytest.raises(DatabaseNotFoundError, match=r"the folder .*no does not exist"):
        PriorDatabase.create(tmp_path / "no" / "db")


def test_a_folder_with_other_files_does_not_become_a_database(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("x")
    for make in (PriorDatabase.create, PriorDatabase.open_or_create):
        with pytest.raises(DatabaseFormatError, match=r"contains other files \(thesis.tex\)"):
            make(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_create_and_open_or_create(folder: Path) -> None:
    folder.mkdir()  # an empty folder is accepted
    with PriorDatabase.open_or_create(folder, rate=25) as database:
        database.add(make_clip())
    with PriorDatabase.open_or_create(folder, rate=50) as database:
        assert database.rate == 25
        assert len(database.clips()) == 1
    with pytest.raises(DatabaseFormatError, match="contains other files"):
        PriorDatabase.create(folder)
    for rate in (0.0, np.nan):
        with pytest.raises(OptionError, match="a database rate of"):
            PriorDatabase.create(folder / "x", rate=rate)
    with pytest.raises(OptionError, match="0 levels"):
        PriorDatabase.create(folder / "x", levels=0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"version": 4},
            "has format version 4, but this priorfill reads versions 1 to 3; install a newer",
        ),
        ({"version": 0}, "has format version 0, but this priorfill reads versions 1 to 3; restore"),
        ({"id": "../.."}, "has no valid id; restore it from a copy"),
        ({"rate": float("nan")}, "has no valid rate and levels"),
        ({"version": None}, "is damaged or was not written by priorfill"),
        ({"format": "other"}, "was not written by priorfill"),
        ({"rate": "fast"}, "has no valid rate and levels"),
    ],
)
def test_other_versions_are_refused(folder: Path, change: dict[str, object], message: str) -> None:
    PriorDatabase.create(folder).close()
    file = folder / "priorfill-database.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | change))
    for write in (False, True):
        with pytest.raises(DatabaseFormatError, match=message) as caught:
            PriorDatabase.open(folder, write=write)
        assert "\n" not in str(caught.value)


def test_level_out_of_range(folder: Path) -> None:
    with PriorDatabase.create(folder) as database:
        record = database.add(make_clip())
        for level in (-1, 3):
            with pytest.raises(OptionError, match=f"level {level} is not in the database"):
                database.positions(record, level)


# --- one writer, many readers ---


@pytest.mark.windows
def test_one_writer_and_readers_with_their_own_state(folder: Path) -> None:
    with PriorDatabase.create(folder) as writer:
        writer.add(make_clip(0))
        with PriorDatabase.open(folder) as reader:
            writer.add(make_clip(1))
            assert len(reader.clips()) == 1
            assert len(writer.clips()) == 2
        with PriorDatabase.open(folder) as reader:
            assert len(reader.clips()) == 2
        with pytest.raises(DatabaseLockedError, match=rf"process {os.getpid()} on .* is writing"):
            PriorDatabase.open(folder, write=True)
    PriorDatabase.open(folder, write=True).close()


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() == 0,
    reason="root may write anywhere, and Windows does not protect folders in this way",
)
def test_read_only_folder(folder: Path) -> None:
    with PriorDatabase.create(folder) as database:
        database.add(make_clip())
    before = snapshot(folder)
    paths = [folder, *folder.rglob("*")]
    modes = {path: path.stat().st_mode for path in paths}
    for path in paths:
        path.chmod(stat.S_IRUSR | (stat.S_IXUSR if path.is_dir() else 0))
    try:
        assert snapshot(folder) == before
        with pytest.raises(DatabaseError, match="cannot be written to"):
            PriorDatabase.open(folder, write=True)
    finally:
        for path in paths:
            path.chmod(modes[path])


@pytest.mark.windows
def test_reading_changes_nothing(folder: Path) -> None:
    with PriorDatabase.create(folder) as database:
        database.add(make_clip())
    before = {path: path.stat().st_mtime_ns for path in [folder, *folder.rglob("*")]}
    snapshot(folder)
    assert {path: path.stat().st_mtime_ns for path in [folder, *folder.rglob("*")]} == before


# --- crashes ---


@pytest.mark.parametrize("where", list(PLACES))
def test_killed_before_the_commit(folder: Path, where: str) -> None:
    """The clip whose row is not committed does not exist, the previous one does."""
    with PriorDatabase.create(folder) as database:
        database.add(make_clip(0))
    run_and_die(die_in_add, folder, where)
    left = snapshot(folder)
    segment = folder / "segments" / "000001.f32"
    committed = segment_bytes(left.values())
    assert len(left) == 2
    size = segment.stat().st_size
    assert size > committed if where != "at first" else size == committed
    with PriorDatabase.open(folder, write=True) as database:
        assert segment.stat().st_size == committed
        database.add(make_clip(2))
        assert database.verify() == []
    assert {content: snapshot(folder)[content] for content in left} == left


def test_an_error_leaves_the_previous_state(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with PriorDatabase.create(folder) as database:
        database.add(make_clip(0))
        before = snapshot(folder)

        def full(*_: object) -> int:
            raise OSError(28, "No space left on device")

        for module, name in ((catalogue_rows, "row_checksum"), (segments, "flush_file")):
            with monkeypatch.context() as patch:
                patch.setattr(module, name, full)
                with pytest.raises(OSError, match="No space left"):
                    database.add(make_clip(1))
            assert snapshot(folder) == before
        database.add(make_clip(1))  # the same writer can go on
        assert database.verify() == []
    assert len(snapshot(folder)) == 2


def test_killed_in_create(folder: Path) -> None:
    folder.mkdir()
    (folder / "priorfill-database.json.new").write_text('{"form')
    with PriorDatabase.open_or_create(folder) as database:
        database.add(make_clip())
    assert len(snapshot(folder)) == 1


def test_killed_after_the_catalogue_before_the_manifest(folder: Path) -> None:
    PriorDatabase.create(folder).close()
    (folder / "priorfill-database.json").unlink()
    with PriorDatabase.open_or_create(folder) as database:
        database.add(make_clip())
    assert len(snapshot(folder)) == 1
    (folder / "priorfill-database.json").unlink()  # of a database that has clips
    for make in (PriorDatabase.open_or_create, PriorDatabase.open):
        with pytest.raises(DatabaseFormatError, match=r"restore priorfill-database\.json from a"):
            make(folder)


@pytest.mark.windows
def test_a_lock_does_not_outlive_its_holder(folder: Path) -> None:
    PriorDatabase.create(folder).close()
    run_and_die(die_as_writer, folder)
    PriorDatabase.open(folder, write=True).close()


def test_hot_journal_is_rolled_back_by_a_reader(folder: Path) -> None:
    """A writer killed during SQLite's commit leaves a journal, which readers roll back."""
    with PriorDatabase.create(folder) as database:
        database.add(make_clip(0))
    before = snapshot(folder)
    run_and_die(spoil, folder / "catalogue.sqlite")
    assert (folder / "catalogue.sqlite-journal").exists()
    assert snapshot(folder) == before


def test_hot_journal_on_read_only_media(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The catalogue is read as it was before the change that was not completed."""
    with PriorDatabase.create(folder) as database:
        database.add(make_clip(0))
    before = snapshot(folder)
    run_and_die(spoil, folder / "catalogue.sqlite")
    files = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    really = sqlite3.connect

    def read_only(address: Any, *given: Any, **more: Any) -> Any:
        return really(str(address).replace("?mode=rw", "?mode=ro"), *given, **more)

    monkeypatch.setattr(sqlite3, "connect", read_only)
    assert snapshot(folder) == before
    with PriorDatabase.open(folder) as database:
        assert "a writer was killed here" in database.notes[0]
        assert database.verify() == []
    assert {path: path.read_bytes() for path in files} == files


def test_several_processes_create_one_database(folder: Path) -> None:
    """Each adds its clip, or is told that another one is writing."""
    processes = [start(add_one, folder, seed) for seed in range(6)]
    for process in processes:
        process.join()
    codes = [process.exitcode for process in processes]
    assert set(codes) <= {0, LOCKED}
    assert len(snapshot(folder)) == codes.count(0) >= 1


def test_a_reader_that_is_open_when_a_writer_is_killed(folder: Path) -> None:
    with PriorDatabase.create(folder) as database:
        expected = database.add(make_clip(0))
    with PriorDatabase.open(folder) as reader:
        run_and_die(spoil, folder / "catalogue.sqlite")
        assert (folder / "catalogue.sqlite-journal").exists()
        assert reader.clips() == (expected,)
        assert reader.verify() == []


def test_a_compaction_while_a_reader_verifies(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It removes the reader's file between two looks at the folder."""
    with PriorDatabase.create(folder) as database:
        gone = database.add(make_clip(0))
        database.add(make_clip(1))
    check_disk = catalogue.Catalogue._check_disk
    with PriorDatabase.open(folder) as reader:

        def compacted(self: catalogue.Catalogue) -> None:
            if self is reader._catalogue:
                with PriorDatabase.open(folder, write=True) as writer:
                    writer.remove([gone])
                    writer.compact()
            check_disk(self)

        monkeypatch.setattr(catalogue.Catalogue, "_check_disk", compacted)
        assert len(reader.clips()) == 2
        assert reader.verify() == []


def test_readers_while_a_writer_adds_removes_and_compacts(folder: Path) -> None:
    with PriorDatabase.create(folder) as database:
        database.add(make_clip(0))

    writer = start(write_on, folder)
    try:
        seen = set()
        until = time.monotonic() + 3
        while time.monotonic() < until or (len(seen) <= 3 and time.monotonic() < until + 60):
            with PriorDatabase.open(folder) as reader:
                records = reader.clips()
                time.sleep(0.01)
                assert reader.verify() == []
                assert reader.clips() == records
                seen.update(record.name for record in records)
        assert len(seen) > 3
        assert writer.is_alive()
    finally:
        writer.kill()
        writer.join()
    with PriorDatabase.open(folder, write=True) as database:
        assert database.verify() == []


# --- damage ---


def flip(path: Path, position: int) -> None:
    data = bytearray(path.read_bytes())
    data[position] ^= 1
    path.write_bytes(bytes(data))


def test_a_flipped_byte_in_a_segment_is_found(folder: Path) -> None:
    with PriorDatabase.create(folder) as database:
        for seed in range(3):
            database.add(make_clip(seed))
    flip(folder / "segments" / "000001.f32", 64 + 2832 + 8 + 33 * 4 * 12 + 5)  # clip1, level 1
    calls: list[tuple[int, int]] = []
    with PriorDatabase.open(folder) as database:
        (problem,) = database.verify(lambda done, total: calls.append((done, total)))
        assert "positions of clip clip1 are damaged (level 1); restore" in problem
        assert calls == [(1, 3), (2, 3), (3, 3)]
        for record in database.clips():
            if record.name == "clip1":
                with pytest.raises(DatabaseCorruptError, match="clip1"):
                    database.check(record)
            else:
                database.check(record)


def test_a_changed_row_is_found(folder: Path) -> None:
    filled = np.zeros((130, 4), dtype=bool)
    filled[0] = True
    with PriorDatabase.create(folder) as database:
        database.add(make_clip(0))
        database.add(make_clip(1), filled=filled)
    for change in ("name = 'clipX' WHERE name = 'clip0'", "filled = x'00' WHERE name = 'clip1'"):
        connection = sqlite3.connect(folder / "catalogue.sqlite")
        connection.execute(f"UPDATE clips SET {change}")
        connection.commit()
        connection.close()
    with PriorDatabase.open(folder) as database:
        assert database.clips() == ()
        assert sorted(database.damaged) == ["clip1", "clipX"]
        problems = sorted(database.verify())
        for name in database.damaged:
            assert any(f"the catalogue's row of clip {name} is damaged" in p for p in problems)
    with pytest.raises(DatabaseCorruptError, match="rows of clip1, clipX changed"):
        PriorDatabase.open(folder, write=True)


def test_a_row_with_an_impossible_segment_leaves_the_others_readable(folder: Path) -> None:
    with PriorDatabase.create(folder) as database:
        database.add(make_clip(0))
        kept = database.add(make_clip(1))
    connection = sqlite3.connect(folder / "catalogue.sqlite")
    connection.execute("UPDATE clips SET segment = 'x' WHERE name = 'clip0'")
    connection.commit()
    connection.close()
    with PriorDatabase.open(folder) as database:
        assert (database.clips(), database.damaged) == ((kept,), ("clip0",))
        database.check(kept)
    with pytest.raises(DatabaseCorruptError, match="rows of clip0 changed"):
        PriorDatabase.open(folder, write=True)


def test_a_damaged_catalogue(folder: Path) -> None:
    with PriorDatabase.create(folder) as database:
        database.add(make_clip(0))
    file = folder / "catalogue.sqlite"
    good = file.read_bytes()
    file.write_bytes(b"rubbish!" * 512)
    with pytest.raises(DatabaseCorruptError, match="is damaged"):
        PriorDatabase.open(folder)
    file.write_bytes(good[:100] + bytes(4000) + good[4100:])
    with pytest.raises(DatabaseCorruptError, match="is damaged"):
        PriorDatabase.open(folder)
    file.unlink()
    with pytest.raises(
        DatabaseCorruptError, match="is missing, so nothing is known of the segments"
    ):
        PriorDatabase.open(folder, write=True)


def test_a_segment_that_is_short_or_missing(folder: Path) -> None:
    with PriorDatabase.create(folder) as database:
        database.add(make_clip(0))
    segment = folder / "segments" / "000001.f32"
    os.truncate(segment, 100)
    with PriorDatabase.open(folder) as database:
        assert "is shorter than the catalogue states" in database.verify()[0]
    with pytest.raises(DatabaseCorruptError, match="has 100 bytes, but the catalogue counts"):
        PriorDatabase.open(folder, write=True)
    segment.unlink()
    with PriorDatabase.open(folder) as database:
        assert "is missing" in database.verify()[0]
    with pytest.raises(DatabaseCorruptError):
        PriorDatabase.open(folder, write=True)
    PriorDatabase.open(folder).close()
