"""Disturbances: each starts a process, and returns it and whether it was disturbed."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

from torture.children import SIGNALS
from torture.jobs import Job, kill_some_time
from torture.processes import HAS_FORK, Inline, Run

SMALL_SEGMENT = 20_000
"""Bytes per segment in some rounds, so that the catalogue is the largest file and reaches the limit
of the file size."""

AT_A_CALL = 0.3
"""Share of kills at a random call that writes, flushes, ... instead of at a random time."""

AT_A_CALL_OF_STEP = 0.7
"""The same where only one step is disturbed, which takes milliseconds."""

SWITCHING = {"replace": 3, "unlink": 8, "sqlite update": 4}
"""Calls with which a compaction takes its new catalogue into use and removes the old one, with the
number of each, among hundreds that copy."""

AT_THE_SWITCH = 0.6
"""Share of these among the kills at a call of a compaction."""

Disturbance = Callable[[Job, random.Random], tuple[Run | Inline, bool]]


def undisturbed(job: Job, rng: random.Random) -> tuple[Run | Inline, bool]:
    """Disturb nothing."""
    run = job.processes.complete(job.plain())
    return run, run.end() != 0


def killed(kind: str) -> Disturbance:
    """Send a signal of `SIGNALS` at a random time or call."""
    number = SIGNALS[kind]

    def disturb(job: Job, rng: random.Random) -> tuple[Run | Inline, bool]:
        if rng.random() < AT_A_CALL:
            at = rng.randint(1, max(1, int(job.calls * job.share)))
            late = rng.random() < 0.5
            run = job.processes.start(job.with_faults(at=at, late=late, kill=int(number)))
            return run, run.end() != 0
        start = job.processes.start if job.forks else job.processes.start_fresh
        run = start(job.plain())
        return run, kill_some_time(run, job, rng, job.share, number)

    return disturb


def killed_in_step(kind: str, signal_kind: str) -> Disturbance:
    """Send a signal while the first step of a plan, of this kind, is executed."""
    number = SIGNALS[signal_kind]

    def disturb(job: Job, rng: random.Random) -> tuple[Run | Inline, bool]:
        calls, seconds = rng.choice(job.calls_of[kind]), job.seconds_of[kind]
        if rng.random() < AT_A_CALL_OF_STEP:
            only = ""
            if kind == "compact" and rng.random() < AT_THE_SWITCH:
                only, calls = rng.choice(list(SWITCHING.items()))
            at, late = rng.randint(1, calls), rng.random() < 0.5
            options = {"at": at, "late": late, "only": only, "kill": int(number), "step": 0}
            run = job.processes.start(job.with_faults(**options))
            return run, run.end() != 0
        run = job.processes.start(job.plain())
        run.wait_for_lines(1, "begin 0 ")
        run.sleep(rng.uniform(0, seconds))
        return run, run.end(kill=number) != 0

    return disturb


def limited(job: Job, rng: random.Random) -> tuple[Run | Inline, bool]:
    """Limit the size of files, where the system has such a limit; else let writes fail."""
    if not HAS_FORK:
        return _faulty(job, rng, for_ever=True, full=True)
    small = rng.random() < 0.5
    largest = job.catalogue if small else max(job.bytes, job.catalogue)
    # even an empty catalogue has a size, as has the database that a plan starts with
    least = job.floor or largest // 2
    largest = max(largest, 2 * job.floor)
    size = rng.randint(least, largest) if rng.random() < 0.7 else rng.randint(0, largest)
    arguments = job.with_faults(segment_bytes=SMALL_SEGMENT) if small else job.plain()
    run = job.processes.start(arguments, size)
    return run, run.end() != 0


def tripped(job: Job, rng: random.Random) -> tuple[Run | Inline, bool]:
    """Let calls fail."""
    late, for_ever = rng.choice(((False, False), (True, False), (False, True), (True, True)))
    return _faulty(job, rng, late=late, for_ever=for_ever)


def held(job: Job, rng: random.Random) -> tuple[Run | Inline, bool]:
    """Refuse to remove, rename or shorten files, once or for ever, as if they were open."""
    return _faulty(job, rng, held=True, for_ever=rng.random() < 0.7)


def _faulty(job: Job, rng: random.Random, **fault: Any) -> tuple[Run | Inline, bool]:
    calls = job.held_calls if fault.get("held") else job.calls
    at = rng.randint(1, max(1, int(calls * job.share)))
    run = job.processes.complete(job.with_faults(at=at, **fault))
    return run, run.end() != 0
