"""Executors run jobs; the local one runs each in a child process that a thread waits for."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from typing import Protocol

from priorfill.study.child_process import run_child
from priorfill.study.job import JobLimits, JobOutcome, StudyJob

__all__ = ["LocalExecutor", "StudyExecutor"]

_INTERRUPTIBLE = 0.5
"""Longest wait without a look at signals (s): on Windows, Ctrl-C does not end a wait."""


class StudyExecutor(Protocol):
    """What runs the jobs of a study."""

    def run(self, jobs: Sequence[StudyJob]) -> Iterator[JobOutcome]:
        """Yield the outcome of each job, each once, in the order in which they are finished.

        No job is begun after the iterator is closed, and those that run are ended then.
        """
        ...


class LocalExecutor:
    """Runs jobs in child processes of this one.

    Parameters
    ----------
    workers : int
        Number of jobs at the same time.
    limits : JobLimits
        Of each job.
    """

    def __init__(self, workers: int, limits: JobLimits) -> None:
        self._workers = workers
        self._limits = limits

    def run(self, jobs: Sequence[StudyJob]) -> Iterator[JobOutcome]:
        """Yield outcomes as jobs are finished (`StudyExecutor`)."""
        stop = threading.Event()
        waiting = iter(jobs)
        running: set[Future[JobOutcome]] = set()
        pool = ThreadPoolExecutor(self._workers)
        try:
            while True:
                for job in waiting:
                    running.add(pool.submit(run_child, job, self._limits, stop))
                    if len(running) >= self._workers:
                        break
                if not running:
                    return
                finished, running = wait(running, _INTERRUPTIBLE, FIRST_COMPLETED)
                for future in finished:
                    yield future.result()
        finally:
            stop.set()
            pool.shutdown(cancel_futures=True)
