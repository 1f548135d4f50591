"""Jobs: what is disturbed, figures of an undisturbed run, and the moment of a kill."""

from __future__ import annotations

import gc
import json
import random
import shutil
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from torture.children import SCRIPT
from torture.clips import WrongError
from torture.processes import Processes, Run

COMMIT = 0.003
"""Approximate duration of a commit, s."""


def remove_folder(folder: Path) -> None:
    """Remove a folder, if it is there."""
    gc.collect()  # Windows removes no file that a forgotten array still maps
    if folder.exists():
        try:
            shutil.rmtree(folder)
        except PermissionError as error:
            raise WrongError(f"somebody keeps a file open: {error}") from error


class Job:
    """A process to be disturbed: how it is started, and figures of an undisturbed run.

    Parameters
    ----------
    processes : Processes
        Starts it.
    folder : Path
        The database.
    arguments : tuple of str
        `COMMAND_LINE` and arguments of priorfill.
    options : dict
        Options of `child`, for a plan.
    start : Path, optional
        Database that is copied to the folder at the beginning.
    forks : bool
        Whether it may run in a copy of this process if it is killed at a random time.
    """

    def __init__(
        self,
        processes: Processes,
        folder: Path,
        arguments: tuple[str, ...] = (),
        options: dict[str, Any] | None = None,
        start: Path | None = None,
        *,
        forks: bool = True,
    ) -> None:
        self.processes = processes
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
        self.held_calls = 0  # of these, calls that Windows refuses for open files
        self.calls_of: dict[str, list[int]] = {}  # calls, and duration, of each kind of step
        self.seconds_of: dict[str, float] = {}
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
        return [str(SCRIPT), "--child", json.dumps(options, default=str), *command]

    def reset(self) -> None:
        """Restore the database of the beginning."""
        remove_folder(self.folder)
        if self._start is not None:
            shutil.copytree(self._start, self.folder)

    def measure(self) -> None:
        """Measure the duration and the output of an undisturbed run."""
        self.reset()
        start = self.processes.start if self.forks else self.processes.start_fresh
        plain = start(self.plain())
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
        self.calls = self._count()

    def measure_held(self) -> None:
        """Count the calls that Windows refuses for open files."""
        if not self.held_calls:
            self.held_calls = self._count(held=True)

    def _count(self, **fault: Any) -> int:
        """Return the number of calls of an undisturbed run that a fault counts."""
        self.reset()
        run = self.processes.complete(self.with_faults(**fault))
        if run.end() != 0:
            raise SystemExit(f"an undisturbed process failed: {run.errors}")
        return int(run.errors.split("calls ")[-1].split()[0])

    def measure_steps(self, kinds: Sequence[str]) -> None:
        """Count the calls in each kind of step, in an undisturbed plan."""
        self.reset()
        run = self.processes.complete(self.with_faults())
        if run.end() != 0:
            raise SystemExit(f"an undisturbed process failed: {run.errors}")
        begun = [line.split() for line in run.lines if line.startswith("begin")]
        each = run.seconds / len(begun)
        for kind, (_, _, first), (_, _, last) in zip(kinds, begun, begun[1:], strict=False):
            self.calls_of.setdefault(kind, []).append(max(1, int(last) - int(first)))
            self.seconds_of[kind] = 3 * each if kind == "compact" else each / 2

    def take_over(self, other: Job) -> None:
        """Copy the figures of a job of the same kind."""
        self.seconds, self.starting = other.seconds, other.starting
        self.lines, self.calls, self.floor = other.lines, other.calls, other.floor
        self.bytes, self.catalogue = other.bytes, other.catalogue
        self.held_calls = other.held_calls
        self.calls_of, self.seconds_of = other.calls_of, other.seconds_of


def kill_some_time(run: Run, job: Job, rng: random.Random, share: float, number: int) -> bool:
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
