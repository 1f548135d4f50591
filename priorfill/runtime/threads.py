"""The number of threads priorfill may use, and work divided among them.

By default all cores; the environment variable `VARIABLE` sets a lower limit. When several processes
fill clips at the same time, more threads than cores only slow each other down.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from itertools import pairwise
from typing import Any

__all__ = ["VARIABLE", "limit_threads", "run_in_threads", "split_range", "thread_count"]

VARIABLE = "PRIORFILL_THREADS"
"""Environment variable with the maximum number of threads of a fill."""


def thread_count() -> int:
    """Return the number of threads a fill may use; results do not depend on it."""
    cores = os.cpu_count() or 1
    try:
        requested = int(os.environ.get(VARIABLE, ""))
    except ValueError:
        return cores
    return min(max(requested, 1), cores)


def limit_threads(count: int) -> None:
    """Limit fills in this process to `count` threads (1 or more)."""
    os.environ[VARIABLE] = str(count)


def split_range(count: int, max_parts: int) -> list[tuple[int, int]]:
    """Split ``range(count)`` into contiguous parts, one per thread.

    Parameters
    ----------
    count : int
        Length of the range.
    max_parts : int
        Number of threads the work is worth; `thread_count` is a further limit.

    Returns
    -------
    list of (int, int)
        Start and stop of each part.

    Examples
    --------
    >>> split_range(10, 1)
    [(0, 10)]
    """
    threads = max(1, min(max_parts, thread_count(), count))
    return list(pairwise(count * part // threads for part in range(threads + 1)))


def run_in_threads(work: Callable[[int, int], Any], parts: list[tuple[int, int]]) -> list[Any]:
    """Call ``work(start, stop)`` for all parts at the same time; return the results in order.

    No part may write to memory that another one writes to.
    """
    if len(parts) == 1:
        return [work(*parts[0])]
    from concurrent.futures import ThreadPoolExecutor  # slow to import

    with ThreadPoolExecutor(max_workers=len(parts)) as pool:
        return list(pool.map(work, *zip(*parts, strict=True)))
