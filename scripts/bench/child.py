"""A command in a process of its own: how long it computes, and how much memory it takes."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from typing import NamedTuple

__all__ = ["CLI", "Cost", "run"]

CLI = (sys.executable, "-c", "from priorfill.cli import main; main()")
"""The command line of the priorfill that this Python imports."""

KILOBYTE = 1024 if sys.platform != "darwin" else 1
"""Bytes in the unit in which the system counts the greatest memory."""


class Cost(NamedTuple):
    """What a process took.

    Attributes
    ----------
    cpu : float
        Seconds of computing, those of its own processes and threads included.
    wall : float
        Seconds that passed.
    memory : float
        Greatest resident memory (MB, 10^6 bytes).
    output : str
        What it printed.
    """

    cpu: float
    wall: float
    memory: float
    output: str


def run(
    command: Sequence[str],
    *,
    environment: Mapping[str, str] | None = None,
    accepted: Sequence[int] = (0,),
) -> Cost:
    """Run a command and say what it took.

    The caller should be small: what it has resident when the process is made counts as the
    process's own memory.

    Parameters
    ----------
    command : sequence of str
        The program and its arguments.
    environment : mapping, optional
        Environment variables to set beside those of this process.
    accepted : sequence of int
        Exit statuses that are no failure.
    """
    began = time.perf_counter()
    process = subprocess.Popen(
        list(command),
        stdout=subprocess.PIPE,
        env={**os.environ, **(environment or {})},
        text=True,
    )
    assert process.stdout is not None
    with process.stdout:
        output = process.stdout.read()
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    wall = time.perf_counter() - began
    if process.returncode not in accepted:
        raise SystemExit(f"{' '.join(command)}: exit status {process.returncode}")
    return Cost(used.ru_utime + used.ru_stime, wall, used.ru_maxrss * KILOBYTE / 1e6, output)
