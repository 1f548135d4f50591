#!/usr/bin/env python
"""Check that a prior database loses nothing when writers are killed or the disk fails.

    python scripts/checks/torture_database.py [--rounds 200] [--kind KIND] [--seed 0]

Two hundred small C3D files are made. In each round a process works on a database and is disturbed:

kill    SIGKILL: at a random time, shortly after a line of output, when an unfinished file (such as
        a journal) appears in the database, or before, during or after a random call that writes,
        flushes, commits, renames or removes
term    the same with SIGTERM
hup     the same with SIGHUP
swap    files are exchanged while no process is at work: the catalogue is emptied, removed, replaced
        by that of another database or by its own older copy; segments are removed, emptied,
        shortened, lengthened, replaced by those of another database or by older copies; files that
        are not of the database are put next to them
full    no file may grow beyond a random size, or the database is on a tmpfs that becomes full
fsync   one call that writes, flushes, commits, renames or removes fails (a write after half of its
        bytes), fails although it was carried out, or fails like every later one

The process is ``priorfill db add`` with all files, or a driver that removes, accepts, compacts,
merges and adds by a random plan and prints what it has begun and finished.

After each round a reader opens the database, verifies it, and compares every clip bit for bit with
an independent computation: every reported clip is present, a change that was begun is present
completely or not at all, and nothing else is present. Then the next writer (``db add``, or the rest
of the plan) must succeed. After an exchange of files, commands must notice it, and change no byte.
Exit status 1 if data was lost or unexpected, or if a disturbed process ended without a clean
message.
"""

from __future__ import annotations

import argparse
import builtins
import errno
import io
import json
import os
import random
import re
import resource
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Sequence
from contextlib import nullcontext, redirect_stdout, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from priorfill.database import PriorDatabase

FILES = 200
"""Number of clips for ``db add``."""

KEPT_FOR = 3
"""Number of rounds with one database."""

STEPS = 40
"""Number of operations in the plan of a driver."""

PLAN_CLIPS = 24
"""Number of clips a driver starts with; every other one has gaps to fill."""

OTHER_CLIPS = 10
"""Number of clips in the database that is merged; three are in both."""

RATE = 60.0
LABELS = ("LASI", "RASI", "SACR", "C7", "LKNE", "RKNE")
DATABASE_RATE = 30.0
LEVELS = 3

SMALL_SEGMENT = 20_000
"""Bytes per segment in some rounds, so that the catalogue is the largest file and reaches the limit
of the file size."""

RESTING = re.compile(r"priorfill-database\.json|catalogue(-\d+)?\.(sqlite|checksum)|segments|lock")
"""Files of a database without a writer; anything else is unfinished."""

NEW = {
    "lock",
    "segments",
    "priorfill-database.json.new",
    "catalogue.sqlite",
    "catalogue.sqlite.new",
    "catalogue.sqlite.new-journal",
    "catalogue.checksum",
    "catalogue.checksum.new",
}
"""Files of a database that was being made."""

AT_A_CALL = 0.3
"""Share of kills at a random call that writes, flushes, ... instead of at a random time."""

COMMIT = 0.003
"""Approximate duration of a commit, s."""

TIMEOUT = 120.0
"""Seconds after which a disturbed process counts as hung."""

ADD = ("-c", "from priorfill.cli import main; main()", "db", "add", "--verbose", "-d")


SIGNALS = {"kill": signal.SIGKILL, "term": signal.SIGTERM, "hup": signal.SIGHUP}
KINDS = (*SIGNALS, "swap", "full", "fsync")


# --- faults ---


@dataclass(frozen=True)
class Fault:
    """A failure to inject.

    Attributes
    ----------
    at : int
        Number of the failing call, from 1; 0: none.
    late : bool
        Whether it fails after it was executed; otherwise before, a write after half of its bytes.
    for_ever : bool
        Whether all later calls fail too, without being executed.
    only : str
        Count only calls that have this in their name: ``fsync``, ``sqlite commit``, ...
    strike : callable, optional
        Called at the failing call, before the error is raised.
    error : callable, optional
        Returns the error; by default an OSError, for SQLite an OperationalError.
    """

    at: int = 0
    late: bool = False
    for_ever: bool = False
    only: str = ""
    strike: Callable[[], None] | None = None
    error: Callable[[], BaseException] | None = None


class Faults:
    """Counts the calls that change a disk, and makes one of them fail.

    Inside its ``with`` block, functions of `os`, `open` and new SQLite connections are patched.

    Parameters
    ----------
    inside : Path
        Calls on paths count in this folder only; calls on open files always count.
    fault : Fault, optional
        The failure; none by default.

    Attributes
    ----------
    calls : int
        Number of calls since `arm`.
    struck : str
        The call that failed; empty if none has.
    """

    PATHS = ("unlink", "remove", "rename", "replace", "mkdir", "rmdir", "truncate", "link")
    HANDLES = ("fsync", "fdatasync", "ftruncate", "write", "pwrite", "sendfile", "copy_file_range")
    STATEMENTS = ("BEGIN", "COMMIT", "INSERT", "UPDATE", "DELETE", "CREATE", "ROLLBACK", "PRAGMA U")

    def __init__(self, inside: Path, fault: Fault | None = None) -> None:
        self._inside = str(inside.resolve())
        self._undo: list[tuple[Any, str, Any]] = []
        self.arm(fault or Fault())

    def arm(self, fault: Fault) -> None:
        """Restart the count, with another fault."""
        self._fault: Fault | None = fault
        self.calls = 0
        self.struck = ""

    def disarm(self) -> None:
        """Stop injecting failures; open connections and files stay usable."""
        self._fault = None

    def __enter__(self) -> Faults:
        for name in self.PATHS:
            self._patch(os, name, self._on_paths)
        for name in self.HANDLES:
            self._patch(os, name, self._always)
        for module in (io, builtins):
            self._patch(module, "open", self._opening)
        self._patch(sqlite3, "connect", self._connecting)
        return self

    def __exit__(self, *_: object) -> None:
        for module, name, old in reversed(self._undo):
            setattr(module, name, old)
        self._undo.clear()
        self.disarm()

    def call(self, what: str, do: Callable[[], Any], half: Callable[[], Any] | None = None) -> Any:
        """Carry out a counted call, or make it fail."""
        fault = self._fault
        if fault is None:
            return do()
        self.calls += fault.only in what
        if self.struck and fault.for_ever:
            raise self._raised(fault, what)
        if self.calls != fault.at or self.struck or fault.only not in what:
            return do()
        if fault.late:
            done = do()
            if what == "open":
                done.close()
        elif half is not None:
            half()
        if fault.strike is not None:
            fault.strike()
        self.struck = what
        raise self._raised(fault, what)

    def _raised(self, fault: Fault, what: str) -> BaseException:
        if fault.error is not None:
            return fault.error()
        if what.startswith("sqlite"):
            return sqlite3.OperationalError("disk I/O error")
        return OSError(errno.EIO, f"Input/output error ({what})")

    def _patch(self, module: Any, name: str, wrap: Callable[[str, Any], Any]) -> None:
        old = getattr(module, name, None)
        if old is not None:
            self._undo.append((module, name, old))
            setattr(module, name, wrap(name, old))

    def _is_inside(self, path: object) -> bool:
        if not isinstance(path, (str, os.PathLike)):
            return isinstance(path, int)
        return os.path.realpath(path).startswith(self._inside)

    def _on_paths(self, name: str, old: Any) -> Any:
        def patched(path: Any, *more: Any, **options: Any) -> Any:
            if not self._is_inside(path):
                return old(path, *more, **options)
            return self.call(name, lambda: old(path, *more, **options))

        return patched

    def _always(self, name: str, old: Any) -> Any:
        return lambda *given, **options: self.call(name, lambda: old(*given, **options))

    def _opening(self, name: str, old: Any) -> Any:
        def patched(file: Any, mode: str = "r", *more: Any, **options: Any) -> Any:
            is_counted = set(mode) & set("wxa+") and self._is_inside(file)
            if not is_counted or isinstance(file, int):
                return old(file, mode, *more, **options)
            opened = self.call("open", lambda: old(file, mode, *more, **options))
            return _File(opened, self)

        return patched

    def _connecting(self, name: str, old: Any) -> Any:
        faults = self

        class Connection(sqlite3.Connection):
            """A connection whose changing statements count."""

            def execute(self, sql: str, *more: Any) -> sqlite3.Cursor:
                do = super().execute
                word = sql.lstrip().upper()
                if not word.startswith(Faults.STATEMENTS):
                    return do(sql, *more)
                what = f"sqlite {word.split()[0].lower()}"
                return faults.call(what, lambda: do(sql, *more))  # type: ignore[no-any-return]

            def executemany(self, sql: str, *more: Any) -> sqlite3.Cursor:
                do = super().executemany
                return faults.call("sqlite many", lambda: do(sql, *more))  # type: ignore[no-any-return]

            def executescript(self, sql: str) -> sqlite3.Cursor:
                do = super().executescript
                return faults.call("sqlite script", lambda: do(sql))  # type: ignore[no-any-return]

            def commit(self) -> None:
                faults.call("sqlite commit", super().commit)

        return lambda *given, **options: old(*given, **{"factory": Connection, **options})


class _File:
    """A file whose writes count."""

    def __init__(self, file: Any, faults: Faults) -> None:
        self._file = file
        self._faults = faults

    def write(self, data: Any) -> Any:
        do = self._file.write
        return self._faults.call("write", lambda: do(data), lambda: do(data[: len(data) // 2]))

    def __enter__(self) -> _File:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


# --- clips, and their expected content ---


@dataclass(frozen=True)
class Stored:
    """Expected contents of a database for a clip: bytes of all levels and of the mask."""

    positions: bytes
    filled: bytes


def make_clip(seed: int, *, gappy: bool = False) -> Any:
    """Return a small clip of six oscillating markers, optionally with a gap."""
    from priorfill.clip import Clip

    rng = np.random.default_rng([4711, seed])
    frames = int(rng.integers(50, 90))
    t = np.arange(frames)[:, None, None] / RATE
    place = rng.uniform(-500, 500, (1, len(LABELS), 3))
    speed = 2 * np.pi * rng.uniform(0.5, 2, (1, len(LABELS), 3))
    positions = place + [0, 0, 1000] + 200 * np.sin(speed * t + rng.uniform(0, 6, place.shape))
    if gappy:
        positions[20:30, rng.integers(len(LABELS))] = np.nan
    # float32 as in files: accepting a filled version must find equal samples
    return Clip(positions.astype(np.float32), LABELS, RATE, name=f"clip{seed:03d}")


def fill_of(clip: Any) -> tuple[Any, np.ndarray]:
    """Fill gaps linearly, and return the mask."""
    filled = clip.missing
    positions = clip.positions.copy()
    frames = np.arange(clip.frames)
    for marker in np.flatnonzero(filled.any(axis=0)):
        known = ~filled[:, marker]
        for i in range(3):
            positions[:, marker, i] = np.interp(frames, frames[known], positions[known, marker, i])
    return clip.with_positions(positions), filled


def must_be(clip: Any, filled: np.ndarray | None = None) -> Stored:
    """Return the expected contents for a clip, computed independently of the database."""
    from priorfill.geometry.axes import to_upright
    from priorfill.signal.resample import pyramid, resample

    fine = resample(to_upright(clip.positions, clip.up), clip.rate, DATABASE_RATE)
    levels = pyramid(fine, DATABASE_RATE, LEVELS)
    mask = np.zeros(fine.shape[:2], dtype=bool)
    if filled is not None:
        step = int(RATE / DATABASE_RATE)  # every sample of level 0 is one of the clip's
        mask = filled[::step][: len(mask)] & ~np.isnan(fine[..., 0])
    data = b"".join(level.positions.astype("<f4").tobytes() for level in levels)
    return Stored(data, mask.tobytes())


class WrongError(Exception):
    """Data was lost, or is unexpected."""


def contents(folder: Path, known: dict[str, dict[str, Stored]]) -> dict[str, str]:
    """Open and verify a database; return the version of each clip in it.

    Parameters
    ----------
    folder : Path
        The database; a missing folder counts as empty.
    known : dict
        Expected contents of each version, by clip name.

    Raises
    ------
    WrongError
        If it cannot be opened, fails to verify, or has unexpected contents.
    """
    from priorfill.errors import PriorfillError

    if not (folder / "priorfill-database.json").exists():
        left = [path.name for path in folder.iterdir()] if folder.exists() else []
        if set(left) <= NEW and not any(folder.glob("segments/*")):
            return {}
        raise WrongError(f"there is no database, but {left}")
    found: dict[str, str] = {}
    try:
        with PriorDatabase.open(folder) as database:
            problems = database.verify()
            if problems:
                raise WrongError("; ".join(problems))
            for record in database.clips():
                mask = database.filled(record)
                if mask is None:
                    mask = np.zeros((record.frames[0], len(record.labels)), dtype=bool)
                data = b"".join(
                    database.positions(record, level).tobytes() for level in range(LEVELS)
                )
                stored = Stored(data, mask.tobytes())
                if record.name in found:
                    raise WrongError(f"{record.name} exists twice")
                for version, expected in known.get(record.name, {}).items():
                    if stored == expected:
                        found[record.name] = version
                if record.name not in found:
                    raise WrongError(f"{record.name} is not what was added, bit for bit")
    except (PriorfillError, OSError, ValueError, KeyError) as error:
        raise WrongError(f"{type(error).__name__}: {error}") from error
    return found


# --- plans of the driver ---


@dataclass(frozen=True)
class Step:
    """One operation, and the contents before and after it."""

    kind: str
    names: tuple[str, ...]
    before: dict[str, str] = field(repr=False)
    after: dict[str, str] = field(repr=False)

    def admits(self, found: dict[str, str]) -> bool:
        """Return whether contents are valid after this step was begun but not reported."""
        if self.kind == "merge":  # clip by clip
            return all(self.after.get(name) == version for name, version in found.items()) and (
                set(self.before) <= set(found)
            )
        return found in (self.before, self.after)


def make_plan(rng: random.Random, own: dict[str, str], other: dict[str, str]) -> list[Step]:
    """Return a random sequence of steps that all make sense."""
    steps: list[Step] = []
    state = dict(own)
    pool = own | other
    while len(steps) < STEPS:
        gappy = sorted(name for name, version in state.items() if version == "gappy")
        gone = sorted(set(pool) - set(state))
        kind = rng.choice(("remove", "accept", "accept", "compact", "merge", "add", "add"))
        after = dict(state)
        names: tuple[str, ...] = ()
        if kind == "remove" and len(state) > 5:
            names = tuple(rng.sample(sorted(state), rng.randint(1, 3)))
            for name in names:
                del after[name]
        elif kind == "accept" and gappy:
            names = (rng.choice(gappy),)
            after[names[0]] = "filled"
        elif kind == "add" and gone:
            names = (rng.choice(gone),)
            after[names[0]] = pool[names[0]]
        elif kind == "merge":
            after = other | state
        elif kind != "compact":
            continue
        steps.append(Step(kind, names, state, after))
        state = after
    return steps


def drive(folder: Path, plan: Path, files: Path, other: Path) -> None:
    """Execute a plan; print when each step begins and is done (in another process)."""
    from priorfill import formats

    with PriorDatabase.open(folder, write=True) as database:
        for number, (kind, names) in enumerate(json.loads(plan.read_text())):
            print("begin", number, flush=True)
            if kind == "remove":
                database.remove([r for r in database.clips() if r.name in names])
            elif kind == "accept":
                filled, mask = fill_of(formats.read(files / f"{names[0]}.c3d"))
                database.accept(filled, mask, filled_by="straight lines")
            elif kind == "add":
                database.add(formats.read(files / f"{names[0]}.c3d"))
            elif kind == "compact":
                database.compact()
            elif kind == "merge":
                with PriorDatabase.open(other) as reader:
                    database.merge(reader)
            print("done", number, flush=True)


def kill_myself(number: int) -> None:
    """Send this process a signal; SIGKILL ends it immediately."""
    os.kill(os.getpid(), number)


def child(options: dict[str, Any], arguments: list[str]) -> None:
    """Run the command line or a plan with faults (in another process)."""
    from priorfill.cli import main
    from priorfill.database import segments
    from priorfill.errors import PriorfillError

    if options.get("segment_bytes"):
        segments.SEGMENT_BYTES = options["segment_bytes"]
    fault = Fault(
        options.get("at", 0),
        late=options.get("late", False),
        for_ever=options.get("for_ever", False),
        strike=partial(kill_myself, options["kill"]) if options.get("kill") else None,
    )
    faults = Faults(Path(options["folder"]), fault)
    try:
        with faults:
            if options.get("plan"):
                try:
                    drive(*(Path(options[key]) for key in ("folder", "plan", "files", "other")))
                except (PriorfillError, OSError) as error:
                    sys.exit(f"priorfill: {error}")
            else:
                main(arguments)
    finally:
        print(f"calls {faults.calls} {faults.struck}", file=sys.stderr)


def is_unfinished(folder: Path) -> bool:
    """Return whether a database has unfinished files or two catalogues."""
    try:
        names = [path.name for path in folder.iterdir()]
    except FileNotFoundError:
        return False
    catalogues = sum(name.endswith(".sqlite") for name in names)
    return catalogues > 1 or not all(RESTING.fullmatch(name) for name in names)


# --- exchanged files ---

FOREIGN = ("catalogue.sqlite.bak", "notes.txt", "segments/notes.txt", "segments/000777.f32")
"""Files that are not of the database."""


def fingerprint(folder: Path) -> dict[str, bytes]:
    """Return the bytes of all files of a database, except the lock."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != "lock"
    }


def _catalogue(folder: Path) -> Path:
    """Return the catalogue in use."""
    return max(folder.glob("catalogue*.sqlite"), key=lambda path: (len(path.name), path.name))


def empty_catalogue(folder: Path, older: Path, other: Path, rng: random.Random) -> bool:
    """Empty the catalogue, with or without its checksum file."""
    if rng.random() < 0.5:
        _catalogue(folder).with_suffix(".checksum").unlink()
    _catalogue(folder).write_bytes(b"")
    return True


def remove_catalogue(folder: Path, older: Path, other: Path, rng: random.Random) -> bool:
    """Remove the catalogue."""
    _catalogue(folder).unlink()
    return True


def foreign_catalogue(folder: Path, older: Path, other: Path, rng: random.Random) -> bool:
    """Replace the catalogue by that of another database, with or without its checksum file."""
    there = _catalogue(folder)
    shutil.copyfile(_catalogue(other), there)
    if rng.random() < 0.5:
        checksum = _catalogue(other).with_suffix(".checksum")
        shutil.copyfile(checksum, there.with_suffix(".checksum"))
    return True


def new_catalogue(folder: Path, older: Path, other: Path, rng: random.Random) -> bool:
    """Replace the catalogue by that of a new database without clips."""
    made = folder.parent / "made"
    shutil.rmtree(made, ignore_errors=True)
    PriorDatabase.create(made).close()
    return foreign_catalogue(folder, older, made, rng)


def older_catalogue(folder: Path, older: Path, other: Path, rng: random.Random) -> bool:
    """Replace the catalogue by its older copy, with its checksum file or without any."""
    there, copy = _catalogue(folder), _catalogue(older)
    if there.name != copy.name or fingerprint(older) == fingerprint(folder):
        return remove_catalogue(folder, older, other, rng)
    sizes = [
        {path.name: path.stat().st_size for path in one.glob("segments/*")}
        for one in (folder, older)
    ]
    shutil.copyfile(copy, there)
    if sizes[0] != sizes[1]:
        if rng.random() < 0.5:
            shutil.copyfile(copy.with_suffix(".checksum"), there.with_suffix(".checksum"))
        else:
            there.with_suffix(".checksum").unlink()
    return True


def spoilt_segment(folder: Path, older: Path, other: Path, rng: random.Random) -> bool:
    """Remove, empty, shorten, lengthen or exchange a segment."""
    segment = rng.choice(sorted(folder.glob("segments/*.f32")))
    data = segment.read_bytes()
    foreign = next(iter(sorted(other.glob("segments/*.f32")))).read_bytes()
    copies = [path.read_bytes() for path in older.glob(f"segments/{segment.name}")]
    choices = [None, b"", data[:-4], data[: len(data) // 2], data + bytes(400), foreign]
    choices += [copy for copy in copies if copy != data]
    chosen = rng.choice(choices)
    if chosen is None:
        segment.unlink()
    else:
        segment.write_bytes(chosen)
    return True


def foreign_files(folder: Path, older: Path, other: Path, rng: random.Random) -> bool:
    """Put files that are not of the database into its folder; this is no damage."""
    for name in FOREIGN:
        source = rng.choice([*other.glob("segments/*.f32"), _catalogue(older)])
        shutil.copyfile(source, folder / name)
    return False


SWAPS = (
    empty_catalogue,
    remove_catalogue,
    foreign_catalogue,
    new_catalogue,
    older_catalogue,
    spoilt_segment,
    spoilt_segment,
    foreign_files,
)


# --- processes, and how they are disturbed ---


class Fork:
    """A copy of this process that runs something else; it starts fast, with everything imported.

    Parameters
    ----------
    arguments : sequence of str
        Python's arguments, in one of the two forms used in this script.
    prepare : callable
        Called in the new process.
    """

    def __init__(self, arguments: Sequence[str], prepare: Callable[[], None]) -> None:
        pipes = [os.pipe(), os.pipe()]
        with warnings.catch_warnings():
            # forking a threaded process can hang a child that takes their locks; none does here
            warnings.simplefilter("ignore", DeprecationWarning)
            self._pid = os.fork()
        if self._pid == 0:
            self._run_child(arguments, prepare, [write for _, write in pipes])
        for _, write in pipes:
            os.close(write)
        self.stdout, self.stderr = (os.fdopen(read, "rb", 0) for read, _ in pipes)
        self._status: int | None = None

    def _run_child(
        self, arguments: Sequence[str], prepare: Callable[[], None], outputs: list[int]
    ) -> None:
        status: object = 1
        try:
            for number, name in enumerate(("stdout", "stderr"), start=1):
                os.dup2(outputs[number - 1], number)
                setattr(sys, name, open(number, "w", closefd=False))  # noqa: SIM115
            prepare()
            if arguments[0] == "-c":
                from priorfill.cli import main

                main(list(arguments[2:]))
            else:
                child(json.loads(arguments[2]), list(arguments[3:]))
            status = 0
        except SystemExit as error:
            status = error.code or 0
            if isinstance(status, str):
                print(status, file=sys.stderr)
        except BaseException:
            traceback.print_exc()
        with suppress(OSError):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(status if isinstance(status, int) else 1)

    def poll(self) -> int | None:
        """Return its exit status if it has ended."""
        if self._status is None:
            pid, status = os.waitpid(self._pid, os.WNOHANG)
            if pid:
                self._status = os.waitstatus_to_exitcode(status)
        return self._status

    def kill(self) -> None:
        """Send SIGKILL."""
        self.send_signal(signal.SIGKILL)

    def send_signal(self, number: int) -> None:
        """Send a signal."""
        if self.poll() is None:
            os.kill(self._pid, number)

    def wait(self, timeout: float | None = None) -> int:
        """Wait until it has ended."""
        end = time.monotonic() + (TIMEOUT if timeout is None else timeout)
        while (status := self.poll()) is None:
            if time.monotonic() > end:
                raise subprocess.TimeoutExpired("fork", TIMEOUT)
            time.sleep(0.001)
        return status


class Run:
    """A process whose output is collected while it runs.

    Parameters
    ----------
    arguments : sequence of str
        Python's arguments.
    file_limit : int, optional
        Maximum bytes of the files it writes.
    fork : bool
        Whether it is a copy of this process.
    """

    def __init__(
        self, arguments: Sequence[str], file_limit: int | None = None, *, fork: bool = False
    ) -> None:
        def limit() -> None:
            # Python ignores SIGXFSZ, so a write beyond the limit fails with EFBIG
            if file_limit is not None:
                resource.setrlimit(resource.RLIMIT_FSIZE, (file_limit, file_limit))

        environment = dict(os.environ, PYTHONDONTWRITEBYTECODE="1")
        environment.pop("PRIORFILL_DEBUG", None)
        self.began = time.monotonic()
        self._process: Any = (
            Fork(arguments, limit)
            if fork
            else subprocess.Popen(
                [sys.executable, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                env=environment,
                preexec_fn=limit if file_limit is not None else None,
            )
        )
        self._output = b""
        self._errors = b""
        self._changed = threading.Condition()
        self._readers = [
            threading.Thread(target=self._read, args=(self._process.stdout, "_output")),
            threading.Thread(target=self._read, args=(self._process.stderr, "_errors")),
        ]
        for reader in self._readers:
            reader.start()

    def _read(self, pipe: Any, name: str) -> None:
        while data := os.read(pipe.fileno(), 65536):
            with self._changed:
                setattr(self, name, getattr(self, name) + data)
                self._changed.notify()

    @property
    def lines(self) -> list[str]:
        """Complete lines of its output so far."""
        return self._output.decode().split("\n")[:-1]

    @property
    def errors(self) -> str:
        """Its output on stderr."""
        return self._errors.decode().strip()

    @property
    def runs(self) -> bool:
        """Whether it is still running."""
        return self._process.poll() is None

    def wait_for_lines(self, count: int, word: str = "") -> None:
        """Wait for a number of lines that begin with a word, or for its end."""

        def enough() -> bool:
            there = sum(line.startswith(word) for line in self.lines)
            return there >= count or not self.runs

        with self._changed:
            while not self._changed.wait_for(enough, 1.0) and self.seconds < TIMEOUT:
                pass

    def wait_for_unfinished(self, folder: Path) -> None:
        """Wait until the database has an unfinished file, or for its end."""
        end = self.began + TIMEOUT
        while self.runs and time.monotonic() < end:
            if is_unfinished(folder):
                return

    def end(self, *, kill: int = 0) -> int:
        """Send a signal, unless it is 0; wait for the end, and return the exit status."""
        if kill:
            self._process.send_signal(kill)
        try:
            status = self._process.wait(TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            raise WrongError(f"hangs; {self.errors[-300:]}") from None
        finally:
            for reader in self._readers:
                reader.join()
            for pipe in (self._process.stdout, self._process.stderr):
                assert pipe is not None
                pipe.close()
        return status

    @property
    def seconds(self) -> float:
        """Time since its start (s)."""
        return time.monotonic() - self.began


def kill_some_time(
    run: Run, job: Job, rng: random.Random, share: float, number: int = signal.SIGKILL
) -> bool:
    """Kill a process at a random moment; return whether it was still running.

    Parameters
    ----------
    run : Run
        The process.
    job : Job
        Its job, with the undisturbed duration.
    rng : random.Random
        Chooses the moment.
    share : float
        Share of the work that remains.
    number : int
        The signal.
    """
    how = rng.choice(("time", "line", "file", "file"))
    working = (job.seconds - job.starting) * share
    if how == "time":
        time.sleep(rng.uniform(0, job.starting + working))
    else:
        run.wait_for_lines(rng.randint(0, max(0, int(job.lines * share) - 2)), job.counts)
        if how == "line":  # then at any stage of the following step
            time.sleep(rng.uniform(0, 1.5 * (job.seconds - job.starting) / job.lines))
        else:
            run.wait_for_unfinished(job.folder)
            time.sleep(rng.uniform(0, COMMIT) * rng.randint(0, 1))
    return run.end(kill=number) != 0


@dataclass
class Row:
    """A row of the table."""

    title: str
    rounds: int = 0
    disturbed: int = 0
    unfinished: int = 0
    reported: int = 0
    found: int = 0
    skipped: str = ""
    faults: list[str] = field(default_factory=list)
    seconds: float = 0.0


class Torture:
    """All rounds, and what they share.

    Parameters
    ----------
    work : Path
        An empty folder.
    seed : int
        Seed of the disturbances; the clips are always the same.
    files : int
        Number of clips for ``db add``.
    progress : callable, optional
        Called with a line about the progress.
    mounts : bool
        Whether to mount a tmpfs.
    forks : bool
        Whether processes killed at a random time may be copies of this one, as all others are.
        These start so fast that their start is not disturbed.
    """

    def __init__(
        self,
        work: Path,
        seed: int = 0,
        files: int = FILES,
        progress: Callable[[str], None] = lambda _: None,
        *,
        mounts: bool = True,
        forks: bool = False,
    ) -> None:
        from priorfill import formats

        self.work = work
        self._seed = seed
        self._say = progress
        self._mounts = mounts
        self._forks = forks
        self.rows: list[Row] = []
        self._signal = signal.SIGKILL
        self.known: dict[str, dict[str, Stored]] = {}
        self._files = work / "files"
        self._files.mkdir()
        self._paths = []
        plan_clips = min(PLAN_CLIPS, files * 2 // 3)
        other_clips = min(OTHER_CLIPS, files - plan_clips)
        for number in range(files):
            path = self._files / f"clip{number:03d}.c3d"
            formats.write(path, make_clip(number, gappy=number % 2 == 1))
            clip = formats.read(path)
            self.known[path.stem] = {"gappy" if number % 2 else "whole": must_be(clip)}
            if number % 2:
                self.known[path.stem]["filled"] = must_be(*fill_of(clip))
            self._paths.append(path)
        names = [path.stem for path in self._paths]
        self.own = {name: next(iter(self.known[name])) for name in names[:plan_clips]}
        others = names[plan_clips - 3 : plan_clips - 3 + other_clips]
        self._other = {name: next(iter(self.known[name])) for name in others}
        self._start, self._to_merge = work / "start", work / "other"
        for folder, clips in ((self._start, self.own), (self._to_merge, self._other)):
            with PriorDatabase.create(folder) as database:
                for name in clips:
                    database.add(formats.read(self._files / f"{name}.c3d"))

    def run(self, kind: str, rounds: int) -> None:
        """Run the rounds of one of `KINDS`; ``none`` disturbs nothing."""
        if kind in SIGNALS:
            self._signal = SIGNALS[kind]
            name = self._signal.name
            self._adding(f"{name} in db add", rounds, self._killed)
            self._planned(f"{name} in remove, accept, compact, merge", rounds, self._killed)
        elif kind == "swap":
            self._swapped("exchanged files", rounds)
        elif kind == "full":
            self._adding("file-size limit in db add", rounds, self._limited)
            self._planned("file-size limit in remove, ...", rounds, self._limited)
            if self._mounts:
                self._adding("full tmpfs in db add", rounds, self._undisturbed, on_tmpfs=True)
        elif kind == "fsync":
            self._adding("failing calls in db add", rounds, self._tripped)
            self._planned("failing calls in remove, ...", rounds, self._tripped)
        elif kind == "none":
            self._planned("undisturbed", rounds, self._undisturbed)

    # --- disturbances: each starts a process and returns it, and whether it was disturbed

    def _killed(self, job: Job, rng: random.Random) -> tuple[Run, bool]:
        if rng.random() < AT_A_CALL:
            at = rng.randint(1, max(1, int(job.calls * job.share)))
            late = rng.random() < 0.5
            run = Run(job.with_faults(at=at, late=late, kill=int(self._signal)), fork=True)
            return run, run.end() != 0
        run = Run(job.plain(), fork=job.forks)
        return run, kill_some_time(run, job, rng, job.share, self._signal)

    def _limited(self, job: Job, rng: random.Random) -> tuple[Run, bool]:
        small = rng.random() < 0.5
        largest = job.catalogue if small else max(job.bytes, job.catalogue)
        # even an empty catalogue has a size, as has the database that a plan starts with
        least = job.floor or largest // 2
        largest = max(largest, 2 * job.floor)
        size = rng.randint(least, largest) if rng.random() < 0.7 else rng.randint(0, largest)
        arguments = job.with_faults(segment_bytes=SMALL_SEGMENT) if small else job.plain()
        run = Run(arguments, size, fork=True)
        return run, run.end() != 0

    def _undisturbed(self, job: Job, rng: random.Random) -> tuple[Run, bool]:
        run = Run(job.plain(), fork=True)
        return run, run.end() != 0

    def _tripped(self, job: Job, rng: random.Random) -> tuple[Run, bool]:
        late, for_ever = rng.choice(((False, False), (True, False), (False, True), (True, True)))
        at = rng.randint(1, max(1, int(job.calls * job.share)))
        run = Run(job.with_faults(at=at, late=late, for_ever=for_ever), fork=True)
        return run, run.end() != 0

    # --- rounds

    def _adding(
        self,
        title: str,
        rounds: int,
        disturb: Callable[[Job, random.Random], tuple[Run, bool]],
        *,
        on_tmpfs: bool = False,
    ) -> None:
        row = Row(title)
        self.rows.append(row)
        rng = random.Random(f"{title} {self._seed}")
        began = time.monotonic()
        folder = self.work / "db"
        mount = Mount(self.work / "tmpfs")
        if on_tmpfs:
            folder = mount.folder / "db"
            row.skipped = mount.why_not()
        files = [str(path) for path in self._paths]
        rng.shuffle(files)
        job = Job(folder, (*ADD, str(folder), *files), forks=self._forks)
        if not row.skipped:
            with mount if on_tmpfs else nullcontext():
                job.measure()
                shutil.rmtree(folder)
        must: set[str] = set()
        for number in range(0 if row.skipped else rounds):
            if number % KEPT_FOR == 0 or len(must) == len(files) or on_tmpfs:
                shutil.rmtree(folder, ignore_errors=True)
                must = set()
                rng.shuffle(files)
                job.arguments = (*ADD, str(folder), *files)
            row.rounds += 1
            job.share = 1 - len(must) / len(files)
            mount.bytes = rng.randint(20_000, job.bytes + job.catalogue)
            try:
                with mount if on_tmpfs else nullcontext():
                    must = self._add_round(row, job, rng, disturb, must, mount)
            except WrongError as error:
                self._failed(row, number, folder, error)
                must = set()
            self._say(f"{title}: {row.rounds} of {rounds}, {len(row.faults)} faults")
        row.seconds = time.monotonic() - began

    def _add_round(
        self,
        row: Row,
        job: Job,
        rng: random.Random,
        disturb: Callable[[Job, random.Random], tuple[Run, bool]],
        must: set[str],
        mount: Mount,
    ) -> set[str]:
        """Run a round; return the names of the clips that the database must have afterwards."""
        run, was_disturbed = disturb(job, rng)
        self._check_end(run, killed=disturb == self._killed)
        row.disturbed += was_disturbed
        files = job.arguments[len(ADD) + 1 :]
        names = {f"added {file}": Path(file).stem for file in files}
        reported = {names[line] for line in run.lines if line in names}
        row.unfinished += is_unfinished(job.folder)
        found = contents(job.folder, self.known)
        row.reported += len(reported)
        row.found += len(found)
        if missing := (must | reported) - set(found):
            raise WrongError(f"reported as added but missing: {', '.join(sorted(missing))}")
        # the next process adds some clips that exist and some that do not
        mount.grow()
        there = [file for file in files if Path(file).stem in found][:2]
        new = [file for file in files if Path(file).stem not in found][:2]
        if not there + new:
            return set(found)
        after = Run((*ADD, str(job.folder), *there, *new), fork=True)
        status = after.end()
        if status != 0:
            raise WrongError(f"the next db add ended with {status}: {after.errors[-400:]}")
        wanted = [f"added {file}" for file in new]
        if [line for line in after.lines if line in names] != wanted:
            raise WrongError(f"the next db add printed {after.lines} instead of {wanted}")
        now = set(contents(job.folder, self.known))
        if now != set(found) | {Path(file).stem for file in new}:
            raise WrongError("after the next db add the database has the wrong clips")
        return now

    def _planned(
        self, title: str, rounds: int, disturb: Callable[[Job, random.Random], tuple[Run, bool]]
    ) -> None:
        row = Row(title)
        self.rows.append(row)
        rng = random.Random(f"{title} {self._seed}")
        began = time.monotonic()
        folder = self.work / "planned"
        for number in range(rounds):
            plan = make_plan(rng, self.own, self._other)
            file = self.work / "plan.json"
            file.write_text(json.dumps([(step.kind, step.names) for step in plan]))
            job = Job(
                folder,
                options={"plan": file, "files": self._files, "other": self._to_merge},
                start=self._start,
            )
            row.rounds += 1
            try:
                if number == 0:
                    job.measure()
                    measured = job
                job.take_over(measured)
                job.reset()
                self._plan_round(row, job, rng, disturb, plan, file)
            except WrongError as error:
                self._failed(row, number, folder, error)
            self._say(f"{title}: {row.rounds} of {rounds}, {len(row.faults)} faults")
        row.seconds = time.monotonic() - began

    def _plan_round(
        self,
        row: Row,
        job: Job,
        rng: random.Random,
        disturb: Callable[[Job, random.Random], tuple[Run, bool]],
        plan: list[Step],
        file: Path,
    ) -> None:
        run, was_disturbed = disturb(job, rng)
        self._check_end(run, killed=disturb == self._killed)
        row.disturbed += was_disturbed
        row.unfinished += is_unfinished(job.folder)
        done = sum(line.startswith("done") for line in run.lines)
        begun = sum(line.startswith("begin") for line in run.lines)
        found = contents(job.folder, self.known)
        row.reported += done
        row.found += len(found)
        step = plan[min(done, len(plan) - 1)]
        fits = found == (step.before if done < len(plan) else step.after)
        # the process may have been killed between a commit and its line
        if not fits and not (done < len(plan) and step.admits(found)):
            raise WrongError(
                f"after {done} steps and in {step.kind} {step.names} ({begun} begun) there is "
                f"{_difference(found, step.before)} against before and "
                f"{_difference(found, step.after)} against after"
            )
        # the next process executes the remaining steps
        rest = plan[done:]
        if found == step.after and found != step.before:
            rest = rest[1:]
        file.write_text(json.dumps([(s.kind, s.names) for s in rest]))
        after = Run(job.with_faults(), fork=True)
        status = after.end()
        if status != 0:
            raise WrongError(f"the next writer ended with {status}: {after.errors[-400:]}")
        now = contents(job.folder, self.known)
        if now != plan[-1].after:
            raise WrongError(f"the next writer left {_difference(now, plan[-1].after)}")

    def _swapped(self, title: str, rounds: int) -> None:
        """Exchange files of a database; nothing may change, and nothing be lost."""
        row = Row(title)
        self.rows.append(row)
        rng = random.Random(f"{title} {self._seed}")
        began = time.monotonic()
        folder = self.work / "swapped"
        for number in range(rounds):
            shutil.rmtree(folder, ignore_errors=True)
            row.rounds += 1
            try:
                self._swap_round(row, folder, rng)
            except WrongError as error:
                self._failed(row, number, folder, error)
            self._say(f"{title}: {row.rounds} of {rounds}, {len(row.faults)} faults")
        row.seconds = time.monotonic() - began

    def _swap_round(self, row: Row, folder: Path, rng: random.Random) -> None:
        """Exchange a file, run commands, put it back."""
        older = self.work / "older"
        shutil.rmtree(older, ignore_errors=True)
        shutil.copytree(self._start, folder)
        plan = make_plan(rng, self.own, self._other)[: rng.randint(1, 6)]
        middle = rng.randint(0, len(plan))
        for steps in (plan[:middle], plan[middle:]):
            if not older.exists():
                shutil.copytree(folder, older)
            file = self.work / "plan.json"
            file.write_text(json.dumps([(step.kind, step.names) for step in steps]))
            with redirect_stdout(io.StringIO()):
                drive(folder, file, self._files, self._to_merge)
            if steps is plan[:middle]:
                shutil.rmtree(older)
                shutil.copytree(folder, older)
        wanted = plan[-1].after
        sound = fingerprint(folder)
        swap = rng.choice(SWAPS)
        is_damage = swap(folder, older, self._to_merge, rng)
        if fingerprint(folder) == sound:
            is_damage = False
        row.disturbed += is_damage
        before = fingerprint(folder)
        new = next(path for path in reversed(self._paths) if path.stem not in wanted)
        for command in (["compact"], ["remove", sorted(wanted)[0]], ["verify"], ["add", str(new)]):
            if not is_damage and command[0] not in ("verify", "compact"):
                continue
            run = Run(("-c", "", "db", command[0], "-d", str(folder), *command[1:]), fork=True)
            self._check_end(run, killed=False)
            if is_damage and run.end() == 0:
                raise WrongError(f"{swap.__name__}: db {command[0]} did not notice it")
            if is_damage and fingerprint(folder) != before:
                raise WrongError(f"{swap.__name__}: db {command[0]} changed the files")
        if not is_damage:
            row.found += len(self._same(folder, wanted, swap.__name__))
            lost = [name for name in before if name not in fingerprint(folder) and name in FOREIGN]
            if lost:
                raise WrongError(f"{swap.__name__}: {lost} were removed")

    def _same(self, folder: Path, wanted: dict[str, str], what: str) -> dict[str, str]:
        found = contents(folder, self.known)
        if found != wanted:
            raise WrongError(f"{what}: {_difference(found, wanted)}")
        return found

    def _check_end(self, run: Run, *, killed: bool) -> None:
        """Raise an error if a process that was not killed ended without a clean message."""
        status = run.end()
        if killed:
            return
        bad = [text for text in ("Traceback", "bug in priorfill") if text in run.errors]
        if status not in (0, 1) or bad:
            raise WrongError(f"ended with {status} and {run.errors[-600:]!r}")

    def _failed(self, row: Row, number: int, folder: Path, error: WrongError) -> None:
        kept = self.work / f"failed-{len(self.rows)}-{number}"
        if folder.exists():
            shutil.copytree(folder, kept)
            shutil.rmtree(folder)
        row.faults.append(f"round {number}: {error} (the database is kept in {kept})")
        self._say(f"{row.title}: {row.faults[-1]}")

    @property
    def failed(self) -> bool:
        """Whether a round failed."""
        return any(row.faults for row in self.rows)


class Job:
    """A process to be disturbed: how it is started, and figures of an undisturbed run.

    Parameters
    ----------
    folder : Path
        The database.
    arguments : tuple of str
        Python's arguments for the command line as users run it.
    options : dict
        Options of `child`, for a plan.
    start : Path, optional
        Database that is copied to the folder at the beginning.
    forks : bool
        Whether it may run in a copy of this process if it is killed at a random time.
    """

    def __init__(
        self,
        folder: Path,
        arguments: tuple[str, ...] = (),
        options: dict[str, Any] | None = None,
        start: Path | None = None,
        *,
        forks: bool = True,
    ) -> None:
        self.forks = forks
        self.folder = folder
        self.arguments = arguments
        self._options = options or {}
        self._start = start
        self.counts = "added" if arguments else "done"  # first word of the counted lines
        self.share = 1.0  # share of the work that remains
        self.seconds = 0.0  # duration, and time until the first line
        self.starting = 0.0
        self.lines = 0
        self.calls = 0
        self.bytes = 0  # bytes of the largest segment, and of the catalogue
        self.catalogue = 0
        self.floor = 0  # bytes of the catalogue at the beginning

    def plain(self) -> list[str]:
        """Return Python's arguments for the process without faults."""
        return list(self.arguments) if self.arguments else self.with_faults()

    def with_faults(self, **more: Any) -> list[str]:
        """Return Python's arguments for the process with options of `child`."""
        options = self._options | {"folder": self.folder} | more
        command = list(self.arguments[2:]) if self.arguments else []
        return [__file__, "--child", json.dumps(options, default=str), *command]

    def reset(self) -> None:
        """Restore the database of the beginning."""
        shutil.rmtree(self.folder, ignore_errors=True)
        if self._start is not None:
            shutil.copytree(self._start, self.folder)

    def measure(self) -> None:
        """Measure the duration and the output of an undisturbed run."""
        self.reset()
        plain = Run(self.plain(), fork=self.forks)
        plain.wait_for_lines(1)
        self.starting = plain.seconds
        if plain.end() != 0:
            raise SystemExit(f"an undisturbed process failed: {plain.errors}")
        self.seconds = plain.seconds
        self.lines = sum(line.startswith(self.counts) for line in plain.lines)
        if self._start is not None:
            self.floor = max(path.stat().st_size for path in self._start.glob("*.sqlite"))
        self.bytes = max(path.stat().st_size for path in self.folder.glob("segments/*"))
        self.catalogue = max(path.stat().st_size for path in self.folder.glob("*.sqlite"))
        self.reset()
        counting = Run(self.with_faults(), fork=True)
        if counting.end() != 0:
            raise SystemExit(f"an undisturbed process failed: {counting.errors}")
        self.calls = int(counting.errors.split("calls ")[-1].split()[0])

    def take_over(self, other: Job) -> None:
        """Copy the figures of another job."""
        self.seconds, self.starting = other.seconds, other.starting
        self.lines, self.calls, self.floor = other.lines, other.calls, other.floor
        self.bytes, self.catalogue = other.bytes, other.catalogue


class Mount:
    """A small tmpfs, if mounting is allowed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.bytes = 1 << 30
        self._mounted = False

    def why_not(self) -> str:
        """Return why it cannot be mounted; empty if it can."""
        self.folder.mkdir(exist_ok=True)
        try:
            with self:
                return ""
        except (OSError, subprocess.CalledProcessError) as error:
            text = getattr(error, "stderr", None) or str(error)
            return f"cannot mount a tmpfs here: {text.strip()}"

    def __enter__(self) -> Mount:
        self._mount(f"size={self.bytes}")
        self._mounted = True
        return self

    def __exit__(self, *_: object) -> None:
        subprocess.run(["umount", self.folder], check=True)
        self._mounted = False

    def grow(self) -> None:
        """Enlarge it."""
        if self._mounted:
            self._mount("remount,size=1g")

    def _mount(self, options: str) -> None:
        subprocess.run(
            ["mount", "-t", "tmpfs", "-o", options, "priorfill-torture", self.folder],
            check=True,
            capture_output=True,
            text=True,
        )


def _difference(found: dict[str, str], wanted: dict[str, str]) -> str:
    """Describe the difference between two contents."""
    parts = [
        f"{name} {found.get(name, 'missing')} instead of {wanted.get(name, 'nothing')}"
        for name in sorted(set(found) | set(wanted))
        if found.get(name) != wanted.get(name)
    ]
    return ", ".join(parts) or "no difference"


def print_table(rows: Sequence[Row]) -> None:
    """Print the results of the rounds."""
    print(
        f"{'what':43s} {'rounds':>6s} {'disturbed':>9s} {'unfinished':>10s} {'reported':>8s} "
        f"{'checked':>8s} {'good':>10s} {'min':>5s}"
    )
    for row in rows:
        if row.skipped:
            print(f"{row.title:43s} skipped: {row.skipped}")
            continue
        good = f"{row.rounds - len(row.faults)} of {row.rounds}"
        print(
            f"{row.title:43s} {row.rounds:6d} {row.disturbed:9d} {row.unfinished:10d} "
            f"{row.reported:8d} {row.found:8d} {good:>10s} {row.seconds / 60:5.1f}"
        )
    print(
        "disturbed: killed while running, or ended with an error; unfinished: a journal or similar "
        "was left;\nreported: clips or steps that the process reported as done; checked: clips "
        "compared bit for bit"
    )
    for row in rows:
        for fault in row.faults:
            print(f"FAULT in {row.title}, {fault}")


def main() -> int:
    """Run the rounds."""
    if sys.argv[1:2] == ["--child"]:
        child(json.loads(sys.argv[2]), sys.argv[3:])
        return 0
    assert __doc__ is not None
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=200, help="number per row of the table")
    parser.add_argument("--kind", choices=(*KINDS, "all"), default="all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--files", type=int, default=FILES, help="number of clips for db add")
    parser.add_argument("--quiet", action="store_true", help="only the table")
    arguments = parser.parse_args()
    work = Path(tempfile.mkdtemp(prefix="priorfill-torture-"))

    def say(line: str) -> None:
        if not arguments.quiet:
            print(line, file=sys.stderr, flush=True)

    torture = Torture(work, arguments.seed, arguments.files, say)
    kinds = KINDS if arguments.kind == "all" else (arguments.kind,)
    try:
        for kind in kinds:
            torture.run(kind, arguments.rounds)
    finally:
        print_table(torture.rows)
        if torture.failed:
            print(f"the databases of failed rounds are kept in {work}")
        else:
            shutil.rmtree(work)
    return int(torture.failed)


if __name__ == "__main__":
    sys.exit(main())
