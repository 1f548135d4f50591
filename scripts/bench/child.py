"""CPU time, wall time and peak memory of a command in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

__all__ = ["CLI", "Cost", "run"]

CLI = (sys.executable, "-c", "from priorfill.__main__ import start; start()")
"""Command line of the priorfill that this Python imports."""

DONE = (0, 3)
"""Exit statuses of a complete and of a partial fill."""

MEASURE = """
import subprocess, sys, time
try:
    import resource
except ImportError:  # Windows
    import psutil
    resource = None
began = time.perf_counter()
process = subprocess.Popen(sys.argv[2:])
if resource is None:
    cpu = peak = 0
    while process.poll() is None:
        try:
            seen = psutil.Process(process.pid)
            used = seen.cpu_times()
            cpu, peak = used.user + used.system, seen.memory_info().peak_wset
        except psutil.Error:  # it has ended
            pass
        time.sleep(0.02)
    status = process.wait()
else:
    status = process.wait()
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = used.ru_utime + used.ru_stime
    peak = used.ru_maxrss * (1 if sys.platform == "darwin" else 1024)
with open(sys.argv[1], "w", encoding="utf-8") as file:
    print(cpu, time.perf_counter() - began, peak / 1e6, status, file=file)
"""
"""Measures a command from a small process: memory of the process that starts another one counts
as peak memory of the new one on Linux."""


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
    quiet: bool = False,
) -> Cost:
    """Run a command and measure it.

    Parameters
    ----------
    command : sequence of str
        The program and its arguments.
    environment : mapping, optional
        Additional environment variables.
    accepted : sequence of int
        Exit statuses that count as success.
    quiet : bool
        Whether what the command writes to standard error is shown only if it fails.
    """
    with tempfile.TemporaryDirectory() as folder:
        cost = Path(folder) / "cost"
        done = subprocess.run(
            [sys.executable, "-c", MEASURE, str(cost), *command],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE if quiet else None,
            env={**os.environ, "PYTHONIOENCODING": "utf-8", **(environment or {})},
            encoding="utf-8",
            errors="replace",
            check=True,
        )
        cpu, wall, memory, status = cost.read_text(encoding="utf-8").split()
    if int(status) not in accepted:
        sys.stderr.write(done.stderr or "")
        raise SystemExit(f"{' '.join(command)}: exit status {status}")
    return Cost(float(cpu), float(wall), float(memory), done.stdout)
