"""The memory of a child process, as it limits and measures it itself."""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path

import psutil

from priorfill.study.job import JobLimits

__all__ = ["forget_peak", "limit_memory", "peak_memory"]

RESERVED_BYTES = 1 << 29
"""Memory (bytes) that a fill reserves, but does not use: stacks, buffers of libraries. With one
thread it is 135 MB."""

OOM_SCORE = "500"
"""Makes the process likelier to be ended by Linux, where 1000 is the first to go."""


def limit_memory(limits: JobLimits) -> None:
    """Let the system refuse memory beyond the limit, where it can.

    The parent watches the memory as well, on all systems; but a program that asks for all at once
    is faster than that.

    Parameters
    ----------
    limits : JobLimits
        The limits.
    """
    if sys.platform != "linux":  # others do not keep to it
        return
    import resource

    with suppress(OSError):  # a system without memory ends this process, not its parent
        Path("/proc/self/oom_score_adj").write_text(OOM_SCORE, encoding="ascii", newline="\n")

    most = limits.memory + RESERVED_BYTES
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    if hard != resource.RLIM_INFINITY:
        most = min(most, hard)
    with suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_DATA, (most, hard))


def forget_peak() -> None:
    """Let `peak_memory` begin anew, where the system can: on Linux."""
    with suppress(OSError):
        # resets VmHWM
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii", newline="\n")


def peak_memory() -> int:
    """Return the largest memory (bytes) of this process, mapped files not counted where possible.

    Examples
    --------
    >>> peak_memory() > 1_000_000
    True
    """
    status = Path("/proc/self/status")
    if status.exists():  # Linux, where getrusage would count the parent's memory at the start
        return _peak_of_status(status.read_text(encoding="ascii"))
    memory = psutil.Process().memory_info()
    if sys.platform == "win32":
        return int(memory.peak_wset)
    return max(int(memory.rss), _peak_of_usage())


def _peak_of_usage() -> int:
    """Return the peak (bytes) that macOS tells."""
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def _peak_of_status(text: str) -> int:
    """Return the peak (bytes) that Linux's status of a process tells, without mapped files."""
    lines = (line.split() for line in text.splitlines())
    sizes = {words[0]: int(words[1]) for words in lines if words[-1] == "kB"}
    return 1024 * (sizes["VmHWM:"] - sizes["RssFile:"] - sizes["RssShmem:"])
