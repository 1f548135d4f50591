#!/usr/bin/env python
"""Check that no output is lost when ``fill``, ``review`` or ``evaluate`` is killed.

    python scripts/checks/torture_outputs.py [--rounds 50] [--kind fill] [--seed 0]

In each round a process is killed (SIGKILL; on Windows TerminateProcess) at a random time, or
before, after or during a random call that writes, flushes, renames or removes.

fill        ``priorfill fill -o`` replaces an existing output: it must be the old or the new file,
            byte for byte
review      ``priorfill review`` replaces a filled file and its decisions: both are old or both
            new, once the next process has finished what the killed one began
evaluate    ``priorfill evaluate -o`` keeps each finished case: those that are there must be used,
            not computed again, and the results be those of an undisturbed run

Then the same command must succeed, and remove the temporary files that were left. Exit status 1 if
something was lost or left.
"""

from __future__ import annotations

import argparse
import json
import random
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from torture.children import COMMAND_LINE, SCRIPT, SIGNALS
from torture.clips import WrongError
from torture.jobs import remove_folder
from torture.processes import HAS_FORK, Processes

import priorfill as pf
from priorfill.cli.encoding import replace_what_is_lacking
from priorfill.runtime.file_pair import finish_pairs
from priorfill.synthetic import synthesise

AT_A_CALL = 0.6
"""Share of kills at a random call instead of at a random time."""

AROUND_REPLACEMENT = 0.5
"""Share of these at one of the `LAST_CALLS`."""

LAST_CALLS = 4
"""Number of calls with which an output is flushed, replaces the old one, and is finished."""

KINDS = ("fill", "review", "evaluate")

DECISIONS = {"linear": "leave", "spline": "pchip"}
"""What a review decides on the first marker, by its method."""

TEMPORARY = ".priorfill-*"
"""Files that are not finished."""


@dataclass
class Row:
    """A row of the table: numbers of rounds, kills, and rounds that left temporary files."""

    title: str
    rounds: int = 0
    killed: int = 0
    unfinished: int = 0
    new: int = 0
    faults: list[str] = field(default_factory=list)
    seconds: float = 0.0


class Outputs:
    """All rounds; a context manager that ends its processes.

    Parameters
    ----------
    work : Path
        An empty folder.
    seed : int
        Seed of the disturbances.
    workers : bool
        Whether processes are started without forking, as on Windows.
    """

    def __init__(self, work: Path, seed: int = 0, *, workers: bool = not HAS_FORK) -> None:
        self.work = work
        self._seed = seed
        self.rows: list[Row] = []
        clip = synthesise("walking", seconds=1.0, rate=30.0)
        positions = clip.positions.copy()
        positions[12:15, 0] = np.nan
        self._clip = work / "clip.c3d"
        pf.write(self._clip, clip.with_positions(positions))
        self._processes = Processes(forks=not workers)

    def __enter__(self) -> Outputs:
        return self

    def __exit__(self, *error: object) -> None:
        self._processes.__exit__(*error)

    def run(self, kind: str, rounds: int, say: Callable[[str], None] = lambda _: None) -> None:
        """Run the rounds of one of `KINDS`."""
        row = Row(f"kills during {kind}")
        self.rows.append(row)
        rng = random.Random(f"{kind} {self._seed}")
        began = time.monotonic()
        folder = self.work / kind
        if kind != "review":  # which would wait for its page
            self._processes.rehearse(self._command(kind, Path("rehearsal")))
        job = self._measured(kind, folder)
        wanted = contents(folder)
        for _ in range(rounds):
            row.rounds += 1
            try:
                self._round(row, job, rng, wanted)
            except WrongError as error:
                row.faults.append(f"round {row.rounds}: {error}")
            say(f"{row.title}: {row.rounds} of {rounds}, {len(row.faults)} faults")
        row.seconds = time.monotonic() - began

    def _command(self, kind: str, folder: Path, method: str = "spline") -> list[str]:
        if kind != "evaluate":
            target = str(folder / "out.c3d")
            more = ["--no-browser"] if kind == "review" else []
            return [kind, str(self._clip), "-o", target, "-m", method, "--overwrite", *more]
        options = "-m linear,spline -p markers --markers LF*,RF* --copies 1 --length 0.2 -j 0 -o"
        return ["evaluate", str(self._clip), *options.split(), str(folder)]

    def _complete(self, job: _Job) -> None:
        command = job.with_faults() if job.kind == "review" else (*COMMAND_LINE, *job.command)
        run = self._processes.complete(command)
        if run.end() not in (0, 3):
            raise WrongError(f"{job.kind} ended with {run.end()}: {run.errors[-400:]}")

    def _job(self, kind: str, folder: Path, method: str = "spline") -> _Job:
        """Return a job; with method linear that which writes the old output."""
        job = _Job(kind, folder, self._command(kind, folder, method))
        if kind == "review":
            job.more["save"] = [{"marker": pf.read(self._clip).labels[0], "do": DECISIONS[method]}]
        return job

    def _measured(self, kind: str, folder: Path) -> _Job:
        """Return a job with the number of calls and the duration of an undisturbed process."""
        job = self._job(kind, folder)
        if kind != "evaluate":  # to replace an output, Windows needs more calls
            self._complete(self._job(kind, folder, "linear"))
        run = self._processes.start(job.with_faults())
        if run.end() not in (0, 3):
            raise SystemExit(f"an undisturbed process failed: {run.errors}")
        job.seconds = run.seconds
        job.calls = int(run.errors.split("calls ")[-1].split()[0])
        return job

    def _round(self, row: Row, job: _Job, rng: random.Random, wanted: dict[str, bytes]) -> None:
        remove_folder(job.folder)
        before: dict[str, bytes] = {}
        if job.kind != "evaluate":
            self._complete(self._job(job.kind, job.folder, "linear"))
            before = contents(job.folder)
        number = int(SIGNALS["kill"])
        if rng.random() < AT_A_CALL:
            first = job.calls - LAST_CALLS if rng.random() < AROUND_REPLACEMENT else 0
            at, late = rng.randint(max(0, first) + 1, job.calls), rng.random() < 0.5
            run = self._processes.start(job.with_faults(at=at, late=late, kill=number))
            row.killed += run.end() not in (0, 3)
        else:
            run = self._processes.start(job.with_faults())
            run.sleep(rng.uniform(0, job.seconds))
            row.killed += run.end(kill=number) not in (0, 3)
        row.unfinished += bool(list(job.folder.rglob(TEMPORARY)))
        if job.kind == "review":
            finish_pairs(job.folder)
        there = contents(job.folder)
        if job.kind == "review" and there not in (before, wanted):
            raise WrongError("the filled file and its decisions are not of the same time")
        for name, data in there.items():
            if data not in (before.get(name), wanted[name]):
                raise WrongError(f"{name} is neither the old nor the new one")
        if lost := set(before) - set(there):
            raise WrongError(f"lost {', '.join(sorted(lost))}")
        row.new += sum(data != before.get(name) for name, data in there.items())
        times = {name: (job.folder / name).stat().st_mtime_ns for name in there}
        self._complete(job)
        now = contents(job.folder)
        if now != wanted:
            raise WrongError(f"the next process left {sorted(now)} instead of {sorted(wanted)}")
        if left := list(job.folder.rglob(TEMPORARY)):
            raise WrongError(f"the next process left {left}")
        again = [name for name in times if times[name] != (job.folder / name).stat().st_mtime_ns]
        if job.kind == "evaluate" and again:
            raise WrongError(f"finished cases were computed again: {again}")


@dataclass
class _Job:
    """A command, and figures of an undisturbed process."""

    kind: str
    folder: Path
    command: list[str]
    calls: int = 0
    seconds: float = 0.0
    more: dict[str, object] = field(default_factory=dict)

    def with_faults(self, **fault: object) -> list[str]:
        """Return Python's arguments for the command with options of `child`."""
        options = json.dumps({"folder": str(self.folder), **self.more, **fault})
        return [str(SCRIPT), "--child", options, *self.command]


def contents(folder: Path) -> dict[str, bytes]:
    """Return what the finished outputs below a folder hold, by their names."""
    found = {path.name: path.read_bytes() for path in folder.glob("out.*")}
    for path in folder.glob("cases/[0-9]*.npz"):
        with np.load(path, allow_pickle=False) as arrays:  # also the seconds, which vary
            found[f"cases/{path.name}"] = arrays["samples"].tobytes()
    return found


def main() -> int:
    """Run the rounds, and print the table."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=50, help="number per row of the table")
    parser.add_argument("--kind", choices=(*KINDS, "all"), default="all")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()

    def say(line: str) -> None:
        print(line, file=sys.stderr, flush=True)

    work = Path(tempfile.mkdtemp(prefix="priorfill-torture-"))
    with Outputs(work, arguments.seed) as outputs:
        for kind in KINDS if arguments.kind == "all" else (arguments.kind,):
            outputs.run(kind, arguments.rounds, say)
    shutil.rmtree(work)
    print(f"{'what':24s} {'rounds':>6s} {'killed':>6s} {'unfinished':>10s} {'new':>4s} {'min':>5s}")
    for row in outputs.rows:
        print(
            f"{row.title:24s} {row.rounds:6d} {row.killed:6d} {row.unfinished:10d} {row.new:4d} "
            f"{row.seconds / 60:5.1f}"
        )
    print("unfinished: a temporary file was left; new: finished outputs that the killed left")
    faults = [f"FAULT in {row.title}, {fault}" for row in outputs.rows for fault in row.faults]
    print("\n".join(faults) or "nothing was lost")
    return int(bool(faults))


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
