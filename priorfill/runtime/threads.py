"""How many threads priorfill may use, and work that is shared out among them.

All cores, unless the environment variable `VARIABLE` says less: where many clips are filled at the
same time, a process each, more threads than cores only get into each other's way.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from itertools import pairwise
from typing import Any

__all__ = ["VARIABLE", "at_most", "in_threads", "parts", "thread_count"]

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


def parts(count: int, worth: int) -> list[tuple[int, int]]:
    """Cut a range into parts for so many threads as are worth it and allowed."""
    threads = max(1, min(worth, thread_count(), count))
    return list(pairwise(count * part // threads for part in range(threads + 1)))


def in_threads(work: Callable[[int, int], Any], parts: list[tuple[int, int]]) -> list[Any]:
    """Do the parts of some work at the same time; none writes where another does."""
    if len(parts) == 1:
        return [work(*parts[0])]
    from concurrent.futures import ThreadPoolExecutor  # slow to import

    with ThreadPoolExecutor(max_workers=len(parts)) as pool:
        return list(pool.map(work, *zip(*parts, strict=True)))
