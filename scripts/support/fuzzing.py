"""Run damaged files through priorfill, each in a process within limits, and count the outcomes."""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from worker import DONE, Worker

__all__ = ["MEMORY", "SECONDS", "TIMEOUT", "Tally", "fuzz_parser", "run_cases"]

SECONDS = 5.0
"""CPU time that a file may take; wall time would depend on the load of the machine."""

TIMEOUT = 60.0
"""Wall time after which a file counts as hung."""

MEMORY = 2**30
"""Memory limit per file in addition to the program itself, bytes."""


@dataclass
class Tally:
    """What happened to the files.

    Attributes
    ----------
    ends : Counter
        Number of files by outcome.
    faults : list of str
        The files that were neither filled nor refused with one line, and why.
    slowest : float
        The longest processor time of a file (s).
    """

    ends: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    slowest: float = 0.0

    def show(self, seconds: float) -> None:
        """Print it, with the time that it took."""
        for end, times in self.ends.most_common():
            print(f"{times:7}  {end}")
        print(
            f"\n{self.ends.total()} damaged files in {seconds:.0f} s, the slowest "
            f"{self.slowest:.2f} s of computing; {len(self.faults)} faults"
        )
        print("\n".join(self.faults[:20]))


def fuzz_parser(docstring: str | None) -> argparse.ArgumentParser:
    """Return a parser of the options that all fuzzers have.

    Parameters
    ----------
    docstring : str or None
        Of the script; its first line is the description.
    """
    parser = argparse.ArgumentParser(description=(docstring or "").partition("\n")[0])
    parser.add_argument("--count", type=int, default=20_000, help="number of damaged files")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=float("inf"), help="stop after this time")
    parser.add_argument("--keep", type=Path, help="folder for files that failed")
    return parser


def run_cases(
    task: Callable[[Any], tuple[str, float]],
    make: Callable[[int, str], Any],
    count: int,
    save: Callable[[Any], None],
    *,
    minutes: float = float("inf"),
    preload: Sequence[str] = (),
) -> Tally:
    """Run cases in a process with limits.

    Parameters
    ----------
    task : callable
        Runs a case and returns how it ended and the processor time (s); a module-level function.
    make : callable
        Makes the case of a number, whose files belong into a folder.
    count : int
        Number of cases.
    save : callable
        Keeps the files of a case that failed.
    minutes : float
        Time after which no case is begun.
    preload : sequence of str
        Modules that a new process finds imported.
    """
    tally = Tally()
    stop = time.monotonic() + 60 * minutes
    with (
        tempfile.TemporaryDirectory() as folder,
        Worker(task, seconds=TIMEOUT, memory=MEMORY, preload=preload) as worker,
    ):
        for number in range(count):
            if time.monotonic() > stop:
                break
            case = make(number, folder)
            outcome = worker.do(case)
            fault = "" if outcome.kind == DONE else f"{outcome.kind}: {outcome.value}"
            if not fault:
                end, seconds = outcome.value
                tally.slowest = max(tally.slowest, seconds)
                fault = f"slow: {seconds:.1f} s" if seconds > SECONDS else ""
            tally.ends[f"FAULT {fault}" if fault else end] += 1
            if fault:
                tally.faults.append(f"seed {case.seed}, number {number}: {fault}")
                for path in Path(folder).iterdir():
                    path.unlink()
                save(case)
    return tally
