"""Limits that a child process sets for itself."""

from __future__ import annotations

import sys
from contextlib import suppress

from priorfill.study.job import JobLimits

__all__ = ["limit_memory"]

RESERVED = 1 << 29
"""Memory (bytes) that a fill reserves, but does not use: stacks, buffers of libraries. With one
thread it is 135 MB."""


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

    most = limits.memory + RESERVED
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    if hard != resource.RLIM_INFINITY:
        most = min(most, hard)
    with suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_DATA, (most, hard))
