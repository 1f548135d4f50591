"""Run a task for one item after another in a process with limits on time and memory.

For scripts that run code of other libraries, or priorfill itself, on damaged files.
"""

from __future__ import annotations

import multiprocessing
import resource
import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

DONE, RAISED, CRASH, TIMEOUT, MEMORY = "done", "raised", "crash", "timeout", "memory"
"""Kinds of outcome."""

START_SECONDS = 120.0
"""Maximum time a new process takes to import what it needs."""

PAGE_BYTES = resource.getpagesize()


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
        Maximum bytes of address space beyond those in use before the first item.
    fresh : bool
        Whether each item gets a new process.
    preload : sequence of str
        Modules that new processes inherit imported, which makes them start within hundredths of a
        second.
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
        # processes are forked by a server without threads that has done the slow imports
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(list(preload))
        self._process: Any = None
        self._pipe: Connection | None = None

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *error: object) -> None:
        self.stop()

    def do(self, item: Any) -> Outcome:
        """Run the task for an item."""
        try:
            pipe = self._pipe or self._start()
            pipe.send(item)
            if not pipe.poll(self._seconds):
                self.stop()
                return Outcome(TIMEOUT, f"took more than {self._seconds:.3g} s")
            outcome: Outcome = pipe.recv()
        except (EOFError, OSError):
            self._process.join()
            code = self._process.exitcode
            self.stop()
            return Outcome(CRASH, f"signal {-code}" if code < 0 else f"exit status {code}")
        if self._fresh:
            self.stop()
        return outcome

    def stop(self) -> None:
        """Kill the process, if there is one."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._process.close()
        if self._pipe is not None:
            self._pipe.close()
        self._process = self._pipe = None

    def _start(self) -> Connection:
        self._pipe, theirs = self._context.Pipe()
        self._process = self._context.Process(
            target=_serve, args=(theirs, self._task, self._memory), daemon=True
        )
        self._process.start()
        theirs.close()
        if not self._pipe.poll(START_SECONDS):
            self.stop()
            raise RuntimeError("a worker process could not be started")
        self._pipe.recv()
        return self._pipe


def _serve(pipe: Connection, task: Callable[[Any], Any], memory: int) -> None:
    """Process items until the pipe is closed."""
    # Ctrl-C reaches all processes of a terminal; the parent handles it
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _limit_memory(memory)
    pipe.send("ready")
    while True:
        try:
            item = pipe.recv()
        except EOFError:
            return
        try:
            outcome = Outcome(DONE, task(item))
        except MemoryError:
            outcome = Outcome(MEMORY, f"needed more than {memory / 2**30:g} GB")
        except BaseException as error:  # any exception is the item's outcome
            place = traceback.extract_tb(sys.exc_info()[2])[-1]
            where = f"{place.filename.rpartition('/')[2]}:{place.lineno}"
            outcome = Outcome(RAISED, f"{type(error).__name__} at {where}: {error}")
        pipe.send(outcome)


def _limit_memory(memory: int) -> None:
    """Limit the address space to `memory` bytes beyond the present size (Linux only)."""
    try:
        pages = int(Path("/proc/self/statm").read_text("ascii").split()[0])
    except OSError:
        return
    limit = pages * PAGE_BYTES + memory
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
