"""Processes that share the work of a study."""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor

from priorfill.evaluation.runner import MAX_PROCESSES

__all__ = ["process_pool"]


def process_pool(processes: int | None = None) -> ProcessPoolExecutor:
    """Return a pool of processes.

    Parameters
    ----------
    processes : int or None
        Number of processes; None: one for each core.
    """
    number = processes or os.cpu_count() or 1
    return ProcessPoolExecutor(min(number, MAX_PROCESSES or number))
