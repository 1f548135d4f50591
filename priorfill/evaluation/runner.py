"""Run the jobs of a plan, in parallel and in any order; finished outcomes are kept."""

from __future__ import annotations

import multiprocessing as mp
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from multiprocessing.connection import wait

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

__all__ = ["run_plan"]

AHEAD = 2
"""Jobs submitted per process, so that no process is idle."""

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
    with _pool(plan.sources, min(processes, max(len(rest), 1))) as pool:
        running: dict[Future[FillOutcome], FillJob] = {}

        def submit_some() -> None:
            for job in waiting:
                case = plan.cases[job.case]
                running[pool.submit(_work, case, job.method)] = job
                if len(running) >= AHEAD * processes:
                    break

        submit_some()
        while running:
            future = next(as_completed(running))
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


_sources: tuple[EvaluatedClip, ...] = ()
"""In a worker process: the clips, sent once."""


def _begin(sources: tuple[EvaluatedClip, ...]) -> None:
    """Prepare a worker process: one thread, no interrupts, and it ends with its parent."""
    global _sources
    _sources = sources
    limit_threads(1)
    threadpool_limits(1)
    # Ctrl-C reaches all processes of the terminal; the parent handles it
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = mp.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    """End this process when its parent ends, even if the parent was killed."""
    wait([sentinel])
    os._exit(1)


def _work(case: GapCase, method: str) -> FillOutcome:
    return run_case(_sources[case.clip], case, method)
