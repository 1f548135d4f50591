"""CPU time, wall time and peak memory of a command in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from typing import NamedTuple

__all__ = ["CLI", "Cost", "run"]

CLI = (sys.executable, "-c", "from priorfill.cli import main; main()")
"""Command line of the priorfill that this Python imports."""

DONE = (0, 3)
"""Exit statuses of a complete and of a partial fill."""

KILOBYTE = 1024 if sys.platform != "darwin" else 1
"""Bytes in the unit of ``ru_maxrss``."""


class Cost(NamedTuple):
    """Resources used by a process.

    Attributes
    ----------
    cpu : float
        CPU seconds, threads and child processes included.
    wall : float
        Wall-clock seconds.
    memory : float
        Peak resident memory (MB, 10^6 bytes).
    output : str
        Standard output.
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
    """Run a command and measure it.

    The caller should be small: its resident memory at the fork counts as memory of the process.

    Parameters
    ----------
    command : sequence of str
        The program and its arguments.
    environment : mapping, optional
        Additional environment variables.
    accepted : sequence of int
        Exit statuses that count as success.
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
