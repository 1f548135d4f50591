"""Run a task for one item after another in a process with limits on time and memory.

For scripts that run code of other libraries, or priorfill itself, on damaged files.
"""

from __future__ import annotations

import importlib
import multiprocessing
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import psutil

DONE, RAISED, CRASH, TIMEOUT, MEMORY = "done", "raised", "crash", "timeout", "memory"
"""Kinds of outcome."""

START_SECONDS = 120.0
"""Maximum time a new process takes to import what it needs."""

FORKED = "forkserver" in multiprocessing.get_all_start_methods()
"""Whether new processes are forked by a server that has done the slow imports, which takes
hundredths of a second. Windows has no fork: each process imports for itself, in a second or two."""

HAS_ADDRESS_LIMIT = hasattr(psutil.Process, "rlimit")
"""Whether the system limits the address space of a process: Linux. Elsewhere the parent looks how
much memory the process has, and kills it."""

LOOK_SECONDS = 0.02
"""Time between two looks at the memory of a process."""

MAX_EXIT_STATUS = 255
"""Larger ones are exceptions of Windows, whose numbers are hexadecimal: 0xc0000005."""


class Outcome(NamedTuple):
    """The outcome for one item.

    Attributes
    ----------
    kind : str
        ``done``; ``raised``, an exception; ``crash``, the process ended; ``timeout``, it took too
        long and was killed; ``memory``, it exceeded its memory limit.
    value : object
        The task's return value if done, else a one-line description.
    """

    kind: str
    value: Any


class Worker:
    """A process that runs a task for one item at a time, within limits.

    After a crash or a timeout the next item gets a new process.

    Parameters
    ----------
    task : callable
        Takes an item and returns a value; a module-level function, as it is pickled by name.
    seconds : float
        Maximum wall time for an item.
    memory : int
        Maximum bytes beyond those in use before the first item: of address space on Linux, of
        committed memory on Windows, of resident memory elsewhere.
    fresh : bool
        Whether each item gets a new process.
    preload : sequence of str
        Modules that new processes have imported before the first item.
    """

    def __init__(
        self,
        task: Callable[[Any], Any],
        *,
        seconds: float,
        memory: int,
        fresh: bool = False,
        preload: Sequence[str] = (),
    ) -> None:
        self._task, self._seconds, self._memory, self._fresh = task, seconds, memory, fresh
        self._preload = tuple(preload)
        self._context: Any = multiprocessing.get_context("forkserver" if FORKED else "spawn")
        if FORKED:
            self._context.set_forkserver_preload(list(preload))
        self._process: Any = None
        self._pipe: Any = None
        self._seen: psutil.Process | None = None
        self._allowed = 0

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *error: object) -> None:
        self.stop()

    def do(self, item: Any) -> Outcome:
        """Run the task for an item."""
        try:
            if self._pipe is None:
                self._start()
            self._pipe.send(item)
            outcome = self._outcome()
        except (EOFError, OSError, psutil.NoSuchProcess):
            self._process.join()
            code = self._process.exitcode
            self.stop()
            return Outcome(CRASH, _end_of(code))
        if self._fresh or outcome.kind in (TIMEOUT, MEMORY):
            self.stop()
        return outcome

    def _outcome(self) -> Outcome:
        """Wait for an outcome as long as time and memory allow."""
        end = time.monotonic() + self._seconds
        while not self._pipe.poll(LOOK_SECONDS):
            if self._needs_too_much():
                return self._exceeded()
            if time.monotonic() > end:
                return Outcome(TIMEOUT, f"took more than {self._seconds:.3g} s")
        outcome: Outcome = self._pipe.recv()
        # it may have had much for a moment; Windows knows the most that it had
        return self._exceeded() if self._needs_too_much() else outcome

    def _needs_too_much(self) -> bool:
        if self._seen is None:
            return False
        try:
            return _bytes_of(self._seen) > self._allowed
        except psutil.Error:  # it has ended
            return False

    def _exceeded(self) -> Outcome:
        return Outcome(MEMORY, _too_much(self._memory))

    def stop(self) -> None:
        """Kill the process, if there is one."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._process.close()
        if self._pipe is not None:
            self._pipe.close()
        self._process = self._pipe = self._seen = None

    def _start(self) -> None:
        self._pipe, theirs = self._context.Pipe()
        self._process = self._context.Process(
            target=_serve,
            args=(theirs, self._task, self._memory, HAS_ADDRESS_LIMIT, self._preload),
            daemon=True,
        )
        self._process.start()
        theirs.close()
        if not self._pipe.poll(START_SECONDS):
            self.stop()
            raise RuntimeError("a worker process could not be started")
        self._pipe.recv()
        if not HAS_ADDRESS_LIMIT:
            self._seen = psutil.Process(self._process.pid)
            self._allowed = _bytes_of(self._seen) + self._memory


def _serve(
    pipe: Any,
    task: Callable[[Any], Any],
    memory: int,
    limits_itself: bool,
    preload: Sequence[str],
) -> None:
    """Process items until the pipe is closed."""
    # Ctrl-C reaches all processes of a terminal; the parent handles it
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for module in preload:
        importlib.import_module(module)
    if limits_itself:
        process = psutil.Process()
        limit = process.memory_info().vms + memory
        process.rlimit(psutil.RLIMIT_AS, (limit, limit))
    pipe.send("ready")
    while True:
        try:
            item = pipe.recv()
        except EOFError:
            return
        try:
            outcome = Outcome(DONE, task(item))
        except MemoryError:
            outcome = Outcome(MEMORY, _too_much(memory))
        except BaseException as error:  # any exception is the item's outcome
            place = traceback.extract_tb(sys.exc_info()[2])[-1]
            where = f"{Path(place.filename).name}:{place.lineno}"
            outcome = Outcome(RAISED, f"{type(error).__name__} at {where}: {error}")
        pipe.send(outcome)


def _bytes_of(process: psutil.Process) -> int:
    """Return the most memory that a process has had, or where that is unknown, what it has."""
    used = process.memory_info()
    return int(getattr(used, "peak_pagefile", used.rss))


def _too_much(memory: int) -> str:
    return f"needed more than {memory / 2**30:g} GB"


def _end_of(code: int) -> str:
    """Return how a process ended, by its exit code."""
    if code < 0:
        return f"signal {-code}"
    return f"exit status {code if code <= MAX_EXIT_STATUS else hex(code)}"
