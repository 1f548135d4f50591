"""A state machine compares the database with a model: a dict of its clips.

It adds, accepts, removes, compacts, merges, reopens, keeps readers open, lets calls fail and
simulates crashes, in the orders that hypothesis generates.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)
from scripted import load_script
from windows_files import as_on_windows

from priorfill.clip import Clip
from priorfill.database import ClipOrigin, ClipRecord, PriorDatabase
from priorfill.database.segments import HEADER_BYTES, MARK_BYTES
from priorfill.errors import DatabaseError, DuplicateClipError
from priorfill.signal.resample import pyramid, resample

FRAMES, RATE, LEVELS = 130, 60.0, 3
LABELS = ("LASI", "RASI", "SACR", "C7", "LKNE")
RECORDINGS = 3
GAP = slice(40, 48)
CROPPED = 129
"""Frames of a clip that lacks the last frame: still the same recording."""
PART = slice(30, 80)
"""Frames of a clip that is a part of the recording, and therefore another clip."""

KINDS = ("whole", "gappy", "filled", "refilled", "cropped", "part")
CALLS = ("", "", "sqlite commit", "fsync", "open", "replace", "unlink")
"""Where a fault occurs: at any call, or at one of these."""

IN_MEMORY = Path("/dev/shm")
"""A folder in memory, where flushing is fast and more steps are possible."""


@lru_cache
def version(recording: int, kind: str) -> tuple[Clip, np.ndarray | None]:
    """A version of a recording, and its mask of filled samples."""
    rng = np.random.default_rng([99, recording])
    t = np.arange(FRAMES)[:, None, None] / RATE
    place = rng.uniform(-500, 500, (1, len(LABELS), 3))
    positions = place + 200 * np.sin(2 * np.pi * rng.uniform(0.5, 2, place.shape) * t)
    mask = None
    if kind in ("gappy", "filled", "refilled"):
        positions[GAP, 1:3] = np.nan
    if kind in ("filled", "refilled"):
        mask = np.isnan(positions[..., 0])
        positions[GAP, 1:3] = place[:, 1:3] + (0 if kind == "filled" else 50)
    if kind == "cropped":
        positions = positions[:CROPPED]
    if kind == "part":
        positions = positions[PART]
    return Clip(positions, LABELS, RATE, name=f"{kind} {recording}", subject="of the file"), mask


@dataclass(frozen=True, eq=False)
class Kept:
    """A clip of the model."""

    recording: int
    kind: str
    levels: tuple[np.ndarray, ...]
    mask: np.ndarray | None
    subject: str
    session: str
    filled_by: str

    @property
    def measured(self) -> list[int]:
        """Measured frames of each marker at level 0."""
        there = ~np.isnan(self.levels[0][..., 0])
        return list((there if self.mask is None else there & ~self.mask).sum(axis=0))

    @property
    def present(self) -> list[int]:
        """Measured and filled frames of each marker at level 0."""
        return list((~np.isnan(self.levels[0][..., 0])).sum(axis=0))

    @property
    def frames(self) -> int:
        """Frames of the recording."""
        return len(version(self.recording, self.kind)[0].positions)

    def measures_all_of(self, old: Kept) -> bool:
        """Return whether it has measured whatever another version measured or filled."""
        return all(n >= o for n, o in zip(self.measured, old.present, strict=True))

    def equals(self, database: PriorDatabase, record: ClipRecord) -> bool:
        """Return whether the database holds exactly this."""
        mask = database.filled(record)
        none = np.zeros(self.levels[0].shape[:2], dtype=bool)
        own = none if self.mask is None else self.mask
        return (
            all(
                database.positions(record, level).tobytes() == positions.tobytes()
                for level, positions in enumerate(self.levels)
            )
            and np.array_equal(none if mask is None else mask, own)
            and record.frames == tuple(len(positions) for positions in self.levels)
            and (record.name, record.labels) == (f"{self.kind} {self.recording}", LABELS)
            and (record.subject, record.session) == (self.subject, self.session)
            and record.filled_by == self.filled_by
            and list(record.measured) == self.measured
            and list(record.present) == self.present
            and (record.original_rate, record.original_frames) == (RATE, self.frames)
        )


def kept(recording: int, kind: str, subject: str, session: str, filled_by: str) -> Kept:
    clip, mask = version(recording, kind)
    fine = resample(clip.positions, RATE, 30.0)
    levels = tuple(level.positions.astype("<f4") for level in pyramid(fine, 30.0, LEVELS))
    at_level_0 = None
    if mask is not None and filled_by:
        at_level_0 = mask[::2][: len(fine)]
    return Kept(recording, kind, levels, at_level_0, subject, session, filled_by)


Model = dict[str, Kept]  # by content hash


def put(model: Model, content: str, new: Kept, *, accepted: bool) -> Model | None:
    """The model with another clip; None if the clip must be refused."""
    result = dict(model)
    for key, old in model.items():
        same = (old.kind == "part") == (new.kind == "part")
        if old.recording != new.recording or not same:
            continue
        if key == content:
            if not (accepted and new.measured != old.measured):
                return None
        elif new.mask is None:
            whole = old.mask is not None and old.frames == new.frames and new.measures_all_of(old)
            if not whole:
                return None  # nothing new, or for the user to decide
        elif any(o > n for o, n in zip(old.measured, new.measured, strict=True)):
            return None  # measured samples are preferred
        elif old.mask is not None and not accepted:
            return None
        if accepted:
            new = replace(
                new, subject=new.subject or old.subject, session=new.session or old.session
            )
        del result[key]
    if not new.subject:
        new = replace(new, subject=version(new.recording, new.kind)[0].subject)
    result[content] = new
    return result


class Crash(BaseException):
    """The process has ended."""


recordings = st.integers(0, RECORDINGS - 1)
kinds = st.sampled_from(KINDS)
words = st.sampled_from(["", "anna", "ben"])


class Machine(RuleBasedStateMachine):
    """The database and its model."""

    others: tuple[tuple[Path, Model], ...] = ()  # databases to merge, made once
    script: ModuleType

    def __init__(self) -> None:
        super().__init__()
        place = IN_MEMORY if IN_MEMORY.is_dir() else None
        self.root = Path(tempfile.mkdtemp(prefix="priorfill-machine-", dir=place))
        self.model: Model = {}
        self.readers: list[tuple[PriorDatabase, Model]] = []
        self.images = 0
        # permanently, because every new connection is patched
        self.faults = self.script.Faults(self.root)
        self.faults.__enter__()
        self.faults.disarm()
        self.system = ExitStack()
        self.is_sound = True  # no operation of this writer failed

    @initialize(windows=st.booleans())
    def create(self, windows: bool) -> None:
        if windows and sys.platform == "linux":  # refuse what Windows refuses
            self.system.enter_context(as_on_windows())
        self.folder = self.root / "db"
        self.writer = PriorDatabase.create(self.folder)

    def teardown(self) -> None:
        if hasattr(self, "writer"):
            for reader, model in self.readers:
                check(reader, model)
                reader.close()
            self.writer.close()
            self._build_at_once()
        self.system.close()
        self.faults.__exit__()
        shutil.rmtree(self.root)

    def _build_at_once(self) -> None:
        """A database with the same clips added in another order is the same."""
        with PriorDatabase.create(self.root / "once") as once:
            for new in sorted(self.model.values(), key=lambda k: (k.kind, k.recording)):
                clip, mask = version(new.recording, new.kind)
                once.add(
                    clip,
                    ClipOrigin(subject=new.subject, session=new.session),
                    filled=mask if new.filled_by else np.zeros_like(clip.missing),
                    filled_by=new.filled_by,
                )
            check(once, self.model)

    # --- operations of users

    @rule(recording=recordings, kind=kinds, subject=words, session=words, masked=st.booleans())
    def add(self, recording: int, kind: str, subject: str, session: str, masked: bool) -> None:
        self._do(*self._adding(recording, kind, subject, session, masked))

    @rule(
        recording=recordings,
        kind=st.sampled_from(["filled", "refilled"]),
        subject=words,
        session=words,
    )
    def accept(self, recording: int, kind: str, subject: str, session: str) -> None:
        self._do(*self._accepting(recording, kind, subject, session))

    @precondition(lambda self: self.model)
    @rule(data=st.data())
    def remove(self, data: st.DataObject) -> None:
        self._do(*self._removing(data))

    @rule()
    def compact(self) -> None:
        self._do(*self._compacting())
        live = sum(sum(p.nbytes for p in clip.levels) for clip in self.model.values())
        files = list(self.folder.glob("segments/*"))
        held = [path for path in files if not self._is_current(path)]
        assert not held or self.readers
        extra = HEADER_BYTES * (len(files) - len(held)) + MARK_BYTES * len(self.model)
        assert sum(path.stat().st_size for path in files if path not in held) == live + extra

    def _is_current(self, path: Path) -> bool:
        """Return whether a segment is one of this writer's, not one that readers hold."""
        return int(path.stem) in self.writer._catalogue.segments_list.segments

    @rule(which=st.integers(0, 2))
    def merge(self, which: int) -> None:
        self._do(*self._merging(which))

    @rule()
    def reopen(self) -> None:
        self.writer.close()
        self.writer = PriorDatabase.open(self.folder, write=True)
        self.is_sound = True

    # --- readers

    @precondition(lambda self: len(self.readers) < 3)
    @rule(looks=st.booleans())
    def open_reader(self, looks: bool) -> None:
        reader = PriorDatabase.open(self.folder)
        if looks:  # before later changes, or only after them
            check(reader, self.model)
        self.readers.append((reader, self.model))

    @precondition(lambda self: self.readers)
    @rule(which=st.integers(0, 2), closes=st.booleans())
    def look(self, which: int, closes: bool) -> None:
        reader, model = self.readers[which % len(self.readers)]
        check(reader, model)
        if closes:
            reader.close()
            self.readers.remove((reader, model))

    # --- faults

    @rule(
        at=st.integers(1, 25),
        only=st.sampled_from(CALLS),
        late=st.booleans(),
        for_ever=st.booleans(),
        data=st.data(),
        crashes=st.booleans(),
    )
    def fault(
        self, at: int, only: str, late: bool, for_ever: bool, data: st.DataObject, crashes: bool
    ) -> None:
        """A call fails, or the process ends at it."""
        ways = [self._compacting]
        ways.append(lambda: self._merging(data.draw(st.integers(0, 2))))
        ways.append(lambda: self._adding(data.draw(recordings), data.draw(kinds), "", "torn", True))
        ways.append(lambda: self._accepting(data.draw(recordings), "filled", "", "torn"))
        if self.model:
            ways.append(lambda: self._removing(data))
        act, after = data.draw(st.sampled_from(ways))()
        image = self.root / f"image{self.images}"

        def strike() -> None:
            if crashes:
                self.images += 1
                shutil.copytree(self.folder, image)

        error: Callable[[], BaseException] | None = Crash if crashes else None
        before = self.model
        self.faults.arm(
            self.script.Fault(
                1 + at % 3 if only else at,
                only=only,
                late=late,
                for_ever=for_ever or crashes,
                strike=strike,
                error=error,
            )
        )
        try:
            act()
        except DuplicateClipError:
            assert self.faults.struck or after is None
        except (Crash, OSError, DatabaseError):
            assert self.faults.struck or not self.is_sound
            after = before if not self.faults.struck else after
        finally:
            self.faults.disarm()
        if not self.faults.struck:
            self.model = before if after is None else after
            return
        self.is_sound = False
        if crashes:
            with suppress(OSError, DatabaseError):
                self.writer.close()
            self.folder = image
        with PriorDatabase.open(self.folder) as reader:
            found = {record.content for record in reader.clips()}
        after = before if after is None else after
        if found == set(before):
            pass
        elif act.__name__ == "merge":
            assert set(before) <= found | set(before) - set(after), "a merge removed something"
            self.model = {c: after.get(c, before.get(c)) for c in found}  # type: ignore[misc]
            assert None not in self.model.values()
        else:
            assert found == set(after), "neither the former state nor the new one"
            self.model = after
        if crashes:
            self.writer = PriorDatabase.open(self.folder, write=True)
            self.is_sound = True

    # --- invariants

    @invariant()
    def a_new_reader_sees_what_the_model_says(self) -> None:
        if hasattr(self, "writer"):
            with PriorDatabase.open(self.folder) as reader:
                check(reader, self.model)
            if self.is_sound:
                check(self.writer, self.model)

    # --- operations: what is done, and the model afterwards (None: refused)

    def _do(self, act: Callable[[], object], after: Model | None) -> None:
        try:
            refused = not self._tried(act)
        except DatabaseError:
            # after a failure a writer may refuse to go on, but must not do damage
            if self.is_sound:
                raise
            self.reopen()
            refused = not self._tried(act)
        assert refused == (after is None)
        if after is not None:
            self.model = after

    def _tried(self, act: Callable[[], object]) -> bool:
        try:
            act()
        except DuplicateClipError:
            return False
        return True

    def _adding(
        self, recording: int, kind: str, subject: str, session: str, masked: bool
    ) -> tuple[Callable[[], object], Model | None]:
        clip, mask = version(recording, kind)
        by = "splines" if masked and mask is not None else ""
        new = kept(recording, kind, subject, session, by)

        def add() -> None:
            self.writer.add(
                clip,
                ClipOrigin(subject=subject or None, session=session),
                filled=mask if by else None,
                filled_by=by,
            )

        return add, put(self.model, content_of(recording, kind), new, accepted=False)

    def _accepting(
        self, recording: int, kind: str, subject: str, session: str
    ) -> tuple[Callable[[], object], Model | None]:
        clip, mask = version(recording, kind)
        assert mask is not None
        new = kept(recording, kind, subject, session, "gpr")

        def accept() -> None:
            before = {record.content for record in self.writer.clips()}
            done = self.writer.accept(
                clip,
                mask,
                filled_by="gpr",
                origin=ClipOrigin(subject=subject or None, session=session),
            )
            gone = {record.content for record in done.replaced}
            now = {record.content for record in self.writer.clips()}
            assert now == before - gone | {done.record.content}

        return accept, put(self.model, content_of(recording, kind), new, accepted=True)

    def _removing(self, data: st.DataObject) -> tuple[Callable[[], object], Model]:
        some = data.draw(st.sets(st.sampled_from(sorted(self.model)), min_size=1, max_size=3))

        def remove() -> None:
            with PriorDatabase.open(self.folder) as reader:
                self.writer.remove([r for r in reader.clips() if r.content in some])

        return remove, {key: value for key, value in self.model.items() if key not in some}

    def _compacting(self) -> tuple[Callable[[], object], Model]:
        def compact() -> None:
            self.writer.clips()  # after a change that failed, it removes what that one left
            segments = list(self.folder.glob("segments/*"))
            size = sum(path.stat().st_size for path in segments)
            given_back = self.writer.compact()
            left = sum(path.stat().st_size for path in self.folder.glob("segments/*"))
            assert given_back == max(0, size - left)  # readers may hold what is replaced

        return compact, self.model

    def _merging(self, which: int) -> tuple[Callable[[], object], Model]:
        folder, theirs = self.others[which]
        after, added = self.model, set()
        for content, new in sorted(theirs.items()):
            changed = put(after, content, new, accepted=False)
            if changed is not None:
                after = changed
                added.add(content)

        def merge() -> None:
            with PriorDatabase.open(folder) as other:
                merged = self.writer.merge(other)
            if self.is_sound:
                assert {record.content for record in merged.added} == added
                assert {record.content for record in merged.skipped} == set(theirs) - added

        return merge, after


def check(database: PriorDatabase, model: Model) -> None:
    """Compare a database with the model."""
    records = database.clips()
    assert [record.content for record in records] == sorted(model)
    for record in records:
        assert model[record.content].equals(database, record), record
    assert database.verify() == []


@lru_cache
def content_of(recording: int, kind: str) -> str:
    """The content hash of a version, from a separate database."""
    place = IN_MEMORY if IN_MEMORY.is_dir() else None
    folder = Path(tempfile.mkdtemp(prefix="priorfill-machine-", dir=place))
    try:
        with PriorDatabase.create(folder / "db") as database:
            return database.add(version(recording, kind)[0]).content
    finally:
        shutil.rmtree(folder)


def test_a_transaction_that_cannot_be_rolled_back_is_rolled_back_later(tmp_path: Path) -> None:
    """Else, the first clip of a merge would count as damaged, and be left out."""
    for name, recordings_of in (("own", ()), ("other", ((0, "gappy"), (1, "whole")))):
        with PriorDatabase.create(tmp_path / name) as database:
            for recording, kind in recordings_of:
                database.add(version(recording, kind)[0], ClipOrigin(subject="carl"))
    script = load_script("torture_database")
    with script.Faults(tmp_path) as faults:
        faults.disarm()
        with (
            PriorDatabase.open(tmp_path / "own", write=True) as writer,
            PriorDatabase.open(tmp_path / "other") as other,
        ):
            faults.arm(script.Fault(1, only="sqlite commit", for_ever=True))
            with pytest.raises((OSError, DatabaseError)):
                writer.add(version(2, "whole")[0], ClipOrigin(subject="carl"))
            faults.disarm()
            assert writer.clips() == ()
            merged = writer.merge(other)
        assert (len(merged.added), merged.damaged) == (2, ())


def test_the_database_is_what_the_model_says(tmp_path: Path) -> None:
    others = []
    for number, clips in enumerate(
        (
            ((0, "gappy"), (1, "whole")),
            ((0, "filled"), (2, "part")),
            ((1, "gappy"), (2, "filled"), (0, "cropped")),
        )
    ):
        folder, model = tmp_path / f"other{number}", {}
        with PriorDatabase.create(folder) as database:
            for recording, kind in clips:
                clip, mask = version(recording, kind)
                by = "them" if mask is not None else ""
                database.add(clip, ClipOrigin(subject="carl"), filled=mask, filled_by=by)
                model[content_of(recording, kind)] = kept(recording, kind, "carl", "", by)
        others.append((folder, model))
    Machine.others = tuple(others)
    Machine.script = load_script("torture_database")
    run_state_machine_as_test(
        Machine,
        settings=settings(
            max_examples=12,
            stateful_step_count=25,
            deadline=None,
            suppress_health_check=list(HealthCheck),
        ),
    )


@pytest.mark.parametrize("late", [False, True], ids=["not done", "done"])
@pytest.mark.parametrize("operation", ["add", "accept", "remove", "compact"])
def test_a_writer_goes_on_after_any_failed_call(
    in_memory: Path, operation: str, late: bool
) -> None:
    """For each call: the clip added next exists, as do all that were committed."""
    script = load_script("torture_database")
    start = in_memory / f"{operation}-{late}"
    with PriorDatabase.create(start) as made:
        made.add(version(0, "gappy")[0])
        gone = made.add(version(1, "whole")[0])
        if operation == "compact":
            made.remove([gone])
    for at in range(1, 80):
        folder = in_memory / f"{operation}-{late}-{at}"
        shutil.copytree(start, folder)
        with script.Faults(folder) as faults:
            faults.disarm()
            writer = PriorDatabase.open(folder, write=True)
            clip, mask = version(0, "filled")
            act = {
                "add": lambda w=writer: w.add(version(2, "gappy")[0]),
                "accept": lambda w=writer, c=clip, m=mask: w.accept(c, m, filled_by="gpr"),
                "remove": lambda w=writer: w.remove([gone]),
                "compact": writer.compact,
            }[operation]
            faults.arm(script.Fault(at, late=late))
            with suppress(OSError, DatabaseError):
                act()
            struck = faults.struck
            faults.disarm()
            new = version(2, "part")[0]
            try:
                writer.add(new)
            except DatabaseError:  # it may refuse, but the next one must not
                writer.close()
                writer = PriorDatabase.open(folder, write=True)
                writer.add(new)
            writer.close()
        with PriorDatabase.open(folder) as reader:
            assert reader.verify() == [], f"call {at}: {struck}"
            names = {record.name for record in reader.clips()}
            assert new.name in names
            for record in reader.clips():
                kind, recording = record.name.split()
                expected = kept(int(recording), kind, "of the file", "", record.filled_by)
                assert expected.equals(reader, record), f"call {at}: {struck}"
        if not struck:
            return
    raise AssertionError("the operation makes more calls than expected")
