"""What a worker of Dask does for a job: start one child process that fills the file."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import psutil
from distributed import Reschedule, Worker, get_worker

import priorfill
from priorfill.runtime.threads import VARIABLE, thread_count
from priorfill.study.child.child_pool import ChildPool
from priorfill.study.child.run_child import run_child
from priorfill.study.job import JobLimits, JobOutcome, StudyJob
from priorfill.study.records import file_states, record_of_job
from priorfill.study.settled_jobs import is_settled

__all__ = ["RunJob", "check_worker", "run_task", "run_with_kept_child"]

RunJob = Callable[[StudyJob, JobLimits, threading.Event], JobOutcome]
"""Fills the file of a job in a child process, until the event is set."""

KEEP_SECONDS = 30.0
"""How long a worker keeps children that have no job: the worker may outlive the study."""

POLL_SECONDS = 0.5
"""Time between two looks whether the scheduler still waits for the job."""

RUNNING = ("executing", "long-running")
"""States of a task whose result the scheduler waits for."""


def check_worker(version: str, path: str) -> str:
    """Return why a worker cannot fill files of a study; else an empty text.

    Parameters
    ----------
    version : str
        Version of priorfill that planned the study.
    path : str
        A file or folder of the study.

    Returns
    -------
    str
        The reason, and the remedy.
    """
    if priorfill.__version__ != version:
        return (
            f"the worker has priorfill {priorfill.__version__}, the study was planned by {version}:"
            " install the same version"
        )
    if not Path(path).exists():
        return f"the worker does not see {path}: all computers of a cluster need the same folders"
    return ""


def run_task(
    job: Mapping[str, Any],
    limits: Mapping[str, Any],
    version: str,
    run: RunJob,
    limits_of_worker: bool = False,
) -> dict[str, Any]:
    """Fill the file of a job in a child process of this worker.

    The worker itself maps no data: its nanny counts mapped files as memory, and would kill it. A
    file that crashes or hangs costs the child only.

    Parameters
    ----------
    job, limits : mapping
        The job and its limits, as JSON values.
    version : str
        Version of priorfill that planned the job.
    run : callable
        Starts the child and waits for it.
    limits_of_worker : bool
        Whether the worker decides how many threads the child has, and its memory where that of
        `limits` is 0.

    Returns
    -------
    dict
        The outcome, as JSON values.

    Raises
    ------
    Reschedule
        Where the child was stopped because the scheduler did not wait for it. If it does after
        all, some worker gets the job again.
    """
    planned = StudyJob.from_json(job)
    problem = check_worker(version, planned.source)
    if problem:
        return JobOutcome.of_failure(planned, problem, try_again=True).to_json()
    worker, allowed = get_worker(), JobLimits(**limits)
    done = _done(planned, allowed)
    if done is not None:  # Dask may run a task twice
        return done.to_json()
    if limits_of_worker:
        allowed = _limits(worker, allowed)
    with _stop_when_released(worker) as stop:
        outcome = run(planned, allowed, stop)
        if stop.is_set():
            raise Reschedule
    return outcome.to_json()


def _done(job: StudyJob, limits: JobLimits) -> JobOutcome | None:
    kept = record_of_job(job)
    if kept is None or not is_settled(kept, job, limits, retry=True):
        return None
    return kept if set(file_states(kept).values()) <= {"written"} else None


def _limits(worker: Worker, given: JobLimits) -> JobLimits:
    """Return what a child of a worker may use.

    Threads are those of the environment variable `VARIABLE`, else one: a worker does not know how
    many others use its computer. The memory is the worker's share of its computer.
    """
    threads = thread_count() if os.environ.get(VARIABLE) else 1
    memory = given.memory or worker.memory_manager.memory_limit or psutil.virtual_memory().total
    return replace(given, threads=threads, memory=int(memory))


class _KeptChildren:
    """Children of this worker that wait for another job, and are ended after a while without."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._pool = ChildPool()
        self._jobs = 0
        self._timer: threading.Timer | None = None

    @contextmanager
    def for_job(self) -> Iterator[ChildPool]:
        """Yield the children for the time of a job."""
        with self._lock:
            self._jobs += 1
            if self._timer is not None:
                self._timer.cancel()
        try:
            yield self._pool
        finally:
            with self._lock:
                self._jobs -= 1
                if not self._jobs:
                    self._timer = threading.Timer(KEEP_SECONDS, self._end)
                    self._timer.daemon = True
                    self._timer.start()

    def _end(self) -> None:
        with self._lock:
            if not self._jobs:
                self._pool.close()


_CHILDREN = _KeptChildren()


def run_with_kept_child(job: StudyJob, limits: JobLimits, stop: threading.Event) -> JobOutcome:
    """Fill the file of a job in a child process of this worker, which may have filled others.

    Parameters
    ----------
    job : StudyJob
        The job.
    limits : JobLimits
        What it may use.
    stop : threading.Event
        Ends the child when it is set.
    """
    with _CHILDREN.for_job() as children:
        return run_child(job, limits, stop, children=children)


@contextmanager
def _stop_when_released(worker: Worker) -> Iterator[threading.Event]:
    """Yield an event that is set once the scheduler no longer waits for the task of this thread.

    Dask cannot stop a task that runs. It releases it when the user interrupts the study, when the
    program that planned it ends, or when the scheduler does.
    """
    key, stop, done = worker.get_current_task(), threading.Event(), threading.Event()

    def watch() -> None:
        while not done.wait(POLL_SECONDS):
            task = worker.state.tasks.get(key)
            if task is None or task.state not in RUNNING:
                stop.set()
                return

    watcher = threading.Thread(target=watch, name="priorfill-released", daemon=True)
    watcher.start()
    try:
        yield stop
    finally:
        done.set()
        watcher.join()
