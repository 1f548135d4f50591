"""Run the jobs of a plan, in parallel and in any order; finished outcomes are kept."""

from __future__ import annotations

import multiprocessing as mp
import os
import signal
import sys
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor
from concurrent.futures import wait as wait_for
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from multiprocessing.connection import wait
from pathlib import Path

from threadpoolctl import threadpool_limits

from priorfill.errors import EvaluationError
from priorfill.evaluation.evaluation_plan import EvaluationPlan, FillJob
from priorfill.evaluation.gap_case import (
    EvaluatedClip,
    FillOutcome,
    GapCase,
    run_case,
)
from priorfill.evaluation.outcome_store import OutcomeStore
from priorfill.runtime.threads import limit_threads

__all__ = ["check_processes", "run_plan"]

AHEAD = 2
"""Jobs submitted per process, so that no process is idle."""

MAX_PROCESSES = 61 if sys.platform == "win32" else None
"""Maximum number of worker processes: Windows waits for at most 63 of them, and two pipes."""

INTERRUPTIBLE = 0.5
"""Longest wait without a look at signals (s): on Windows, Ctrl-C does not end a wait."""

EXIT_RAN_AGAIN = 93
"""Exit status of a worker process in which the script of its parent came to an evaluation."""

Progress = Callable[[int, int], None]

_FillOutcomes = Generator[tuple[FillJob, FillOutcome], None, None]


def run_plan(
    plan: EvaluationPlan,
    *,
    jobs: int,
    store: OutcomeStore | None = None,
    progress: Progress | None = None,
) -> dict[FillJob, FillOutcome]:
    """Run the jobs that are not finished yet.

    Parameters
    ----------
    plan : EvaluationPlan
        The plan.
    jobs : int
        Number of worker processes; 0: run in this process.
    store : OutcomeStore, optional
        Keeps finished outcomes; those that it has are not computed again.
    progress : callable, optional
        Called with the number of jobs done and the number of all jobs.

    Returns
    -------
    dict of FillJob to FillOutcome
        The outcome of each job. Only ``seconds`` depends on the number of processes.

    Raises
    ------
    EvaluationError
        Where a worker process was killed.
    """
    done = dict(store.kept()) if store is not None else {}
    rest = [job for job in plan.jobs if job not in done]
    report = progress or (lambda done, total: None)
    report(len(done), len(plan.jobs))
    outcomes = _in_processes(plan, rest, jobs) if jobs else _here(plan, rest)
    try:
        with closing(outcomes):  # an interrupt here ends the worker processes, too
            for job, outcome in outcomes:
                if store is not None:
                    store.keep(job, outcome)
                done[job] = outcome
                report(len(done), len(plan.jobs))
    except BrokenProcessPool as error:
        kept = "" if store is None else f"; finished fills are kept in {store.folder}"
        raise EvaluationError(
            f"a process was killed with {len(done)} of {len(plan.jobs)} fills done, possibly for "
            f"lack of memory{kept}; run it again with fewer `jobs`"
        ) from error
    return {job: done[job] for job in plan.jobs}


def _here(plan: EvaluationPlan, rest: Sequence[FillJob]) -> _FillOutcomes:
    """Run jobs in this process."""
    for job in rest:
        case = plan.cases[job.case]
        yield job, run_case(plan.sources[case.clip], case, job.method)


def _in_processes(plan: EvaluationPlan, rest: Sequence[FillJob], processes: int) -> _FillOutcomes:
    """Run jobs in worker processes; yield outcomes as they are finished."""
    waiting = iter(rest)
    processes = min(processes, max(len(rest), 1), MAX_PROCESSES or processes)
    with _pool(plan.sources, processes) as pool:
        running: dict[Future[FillOutcome], FillJob] = {}

        def submit_some() -> None:
            for job in waiting:
                case = plan.cases[job.case]
                running[pool.submit(_work, case, job.method)] = job
                if len(running) >= AHEAD * processes:
                    break

        submit_some()
        while running:
            finished, _ = wait_for(running, INTERRUPTIBLE, FIRST_COMPLETED)
            for future in finished:
                yield running.pop(future), future.result()
            submit_some()


@contextmanager
def _pool(sources: Sequence[EvaluatedClip], processes: int) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool whose processes are terminated if an exception occurs here."""
    others = set(mp.active_children())
    # spawned, not forked: a fork would copy locks held by threads of BLAS and numba
    pool = ProcessPoolExecutor(
        processes, mp.get_context("spawn"), initializer=_begin, initargs=(tuple(sources),)
    )
    try:
        yield pool
        pool.shutdown()
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        for child in set(mp.active_children()) - others:
            child.terminate()
        raise


def check_processes() -> None:
    """Check that worker processes can be started, and end this one if it is one that starts.

    A spawned process first runs the script of its parent. Without a ``__main__`` guard it comes
    here, and would start processes itself, while its parent waits for ever to send it the clips.

    Raises
    ------
    EvaluationError
        If the script has no guard, or cannot be run again.
    """
    # `multiprocessing` recognises such a process in the same way
    if getattr(mp.current_process(), "_inheriting", False):
        os._exit(EXIT_RAN_AGAIN)
    script = sys.modules["__main__"]
    file = getattr(script, "__file__", None)
    if file is not None and script.__spec__ is None and not Path(file).exists():
        raise EvaluationError(
            f"worker processes cannot run {file} again; run it from a file, or give `jobs` as 0"
        )
    first = mp.get_context("spawn").Process(target=os.getpid)
    first.start()
    while first.exitcode is None:
        first.join(INTERRUPTIBLE)
    if first.exitcode == EXIT_RAN_AGAIN:
        raise EvaluationError(
            "worker processes run the script again up to this point; put its statements below "
            '`if __name__ == "__main__":`, or give `jobs` as 0'
        )
    if first.exitcode:
        raise EvaluationError(
            f"worker processes cannot be started (exit status {first.exitcode}); give `jobs` as 0"
        )


_sources: tuple[EvaluatedClip, ...] = ()
"""In a worker process: the clips, sent once."""


def _begin(sources: tuple[EvaluatedClip, ...]) -> None:
    """Prepare a worker process: one thread, no interrupts, and it ends with its parent."""
    global _sources
    _sources = sources
    limit_threads(1)
    threadpool_limits(1)
    # Ctrl-C, on Windows also Ctrl-Break, reaches all processes of the terminal; the parent ends
    for name in ("SIGINT", "SIGBREAK"):
        number = getattr(signal, name, None)
        if number is not None:
            signal.signal(number, signal.SIG_IGN)
    parent = mp.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    """End this process when its parent ends, even if the parent was killed."""
    wait([sentinel])
    os._exit(1)


def _work(case: GapCase, method: str) -> FillOutcome:
    return run_case(_sources[case.clip], case, method)
