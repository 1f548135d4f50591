"""Work on one item after another in a process that may crash, hang or eat memory."""

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

__all__ = ["CRASH", "DONE", "HANG", "MEMORY", "RAISED", "Outcome", "Worker"]

DONE, RAISED, CRASH, HANG, MEMORY = "done", "raised", "crash", "hang", "memory"
"""Kinds of outcome."""

PATIENCE = 120.0
"""Seconds that a new process may take to import what it needs."""

PAGE = resource.getpagesize()
"""Bytes in which the system counts the memory of a process."""


class Outcome(NamedTuple):
    """What became of an item.

    Attributes
    ----------
    kind : str
        ``done``; ``raised``, an exception; ``crash``, the process ended; ``hang``, it took too
        long and was ended; ``memory``, it asked for more than it may have.
    value : object
        What the task returned; otherwise a line that says what happened.
    """

    kind: str
    value: Any


class Worker:
    """A process that does a task for one item at a time, within limits.

    After a crash or a hang the next item gets a new process. So does each item, if `fresh`.

    Parameters
    ----------
    task : callable
        Takes an item, returns its value; a function of a module, as it is sent by name.
    seconds : float
        Wall time for an item, after which the process is killed.
    memory : int
        Bytes that the process may have beyond those it has before its first item.
    fresh : bool
        Whether each item gets a process of its own.
    preload : sequence of str
        Modules that a new process finds imported: it is then there in hundredths of a second.
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
        # a server without threads, which has imported what takes long, forks the processes
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(list(preload))
        self._process: Any = None
        self._pipe: Connection | None = None

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *error: object) -> None:
        self.stop()

    def do(self, item: Any, *, seconds: float | None = None) -> Outcome:
        """Do the task for an item.

        Parameters
        ----------
        item : object
            What the task takes.
        seconds : float or None
            Wall time for this item, where it differs.
        """
        seconds = self._seconds if seconds is None else seconds
        try:
            pipe = self._pipe or self._start()
            pipe.send(item)
            if not pipe.poll(seconds):
                self.stop()
                return Outcome(HANG, f"took more than {seconds:.3g} s")
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
        """End the process, if there is one."""
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
        if not self._pipe.poll(PATIENCE):
            self.stop()
            raise RuntimeError("a process for the work could not be started")
        self._pipe.recv()
        return self._pipe


def _serve(pipe: Connection, task: Callable[[Any], Any], memory: int) -> None:
    """Answer items until nobody asks any more."""
    # Ctrl-C reaches every process of the terminal; the one that asks decides what comes of it
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _limit(memory)
    pipe.send("ready")
    while True:
        try:
            item = pipe.recv()
        except EOFError:
            return
        try:
            outcome = Outcome(DONE, task(item))
        except MemoryError:
            outcome = Outcome(MEMORY, f"asked for more than {memory / 2**30:g} GB")
        except BaseException as error:  # whatever it is, it is the item's outcome
            place = traceback.extract_tb(sys.exc_info()[2])[-1]
            where = f"{place.filename.rpartition('/')[2]}:{place.lineno}"
            outcome = Outcome(RAISED, f"{type(error).__name__} at {where}: {error}")
        pipe.send(outcome)


def _limit(memory: int) -> None:
    """Let the process have no more than `memory` bytes of address space beyond what it has."""
    try:
        pages = int(Path("/proc/self/statm").read_text("ascii").split()[0])
    except OSError:
        return  # only Linux tells; time is bounded everywhere
    limit = pages * PAGE + memory
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
