"""Executors run jobs at the same time; the local one runs each in a child process of this one."""

from __future__ import annotations

import threading
from collections.abc import Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from functools import partial
from itertools import islice
from typing import Protocol, Self

from priorfill.study.child.child_pool import ChildPool
from priorfill.study.child.run_child import run_child
from priorfill.study.job import JobLimits, JobOutcome, StudyJob

__all__ = ["LocalExecutor", "StudyExecutor"]

_INTERRUPTIBLE_SECONDS = 0.5
"""Longest wait without a look at signals (s): on Windows, Ctrl-C does not end a wait."""


class StudyExecutor(Protocol):
    """What runs the jobs of a study; a context manager."""

    def __enter__(self) -> Self:
        """Begin."""
        ...

    def __exit__(self, *error: object) -> None:
        """End."""
        ...

    def run(self, jobs: Sequence[StudyJob]) -> Generator[JobOutcome, None, None]:
        """Yield the outcome of each job, each once, in the order in which they are finished.

        No job is begun after the iterator is closed, and those that run are ended then.

        Parameters
        ----------
        jobs : sequence of StudyJob
            The jobs, in the order in which they are begun.
        """
        ...


class LocalExecutor:
    """Runs jobs in child processes of this one (`StudyExecutor`).

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
        self._children = ChildPool()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._children.close()

    def run(self, jobs: Sequence[StudyJob]) -> Generator[JobOutcome, None, None]:
        """Yield outcomes as jobs are finished; closing the iterator stops those that run."""
        stop = threading.Event()
        waiting = iter(jobs)
        running: dict[Future[JobOutcome], StudyJob] = {}
        pool = ThreadPoolExecutor(self._workers, "priorfill-job")
        run = partial(run_child, limits=self._limits, stop=stop, children=self._children)
        try:
            while True:
                for job in islice(waiting, self._workers - len(running)):
                    running[pool.submit(run, job)] = job
                if not running:
                    return
                finished, _ = wait(running, _INTERRUPTIBLE_SECONDS, FIRST_COMPLETED)
                for future in finished:
                    yield _outcome(future, running.pop(future))
        finally:
            stop.set()
            pool.shutdown(cancel_futures=True)


def _outcome(future: Future[JobOutcome], job: StudyJob) -> JobOutcome:
    """Return the outcome of a job that ended."""
    error = future.exception()
    if error is None:
        return future.result()
    # a bug, which must not cost the other files
    reason = f"bug in priorfill ({type(error).__name__}: {error}); please report it"
    return JobOutcome.of_failure(job, reason, try_again=True)
