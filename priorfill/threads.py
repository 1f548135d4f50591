"""How many threads priorfill may use.

All cores, unless the environment variable `VARIABLE` says less: where many clips are filled at the
same time, a process each, more threads than cores only get into each other's way.
"""

from __future__ import annotations

import os

__all__ = ["VARIABLE", "at_most", "thread_count"]

VARIABLE = "PRIORFILL_THREADS"
"""Environment variable: the threads that a fill may use at most."""


def thread_count() -> int:
    """Return how many threads a fill may use; results do not depend on it."""
    cores = os.cpu_count() or 1
    try:
        asked = int(os.environ.get(VARIABLE, ""))
    except ValueError:
        return cores
    return min(max(asked, 1), cores)


def at_most(count: int) -> None:
    """Let fills of this process use so many threads at most (1 or more)."""
    os.environ[VARIABLE] = str(count)
