"""Processes that share the work of a study."""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor

__all__ = ["process_pool"]

MAX_PROCESSES = 61
"""Windows cannot wait for more, and `ProcessPoolExecutor` refuses to start them."""


def process_pool(processes: int | None = None) -> ProcessPoolExecutor:
    """Return a pool of processes.

    Parameters
    ----------
    processes : int or None
        Number of processes; None: one for each core.
    """
    return ProcessPoolExecutor(min(processes or os.cpu_count() or 1, MAX_PROCESSES))
