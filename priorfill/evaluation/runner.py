"""Do the jobs of a plan: in parallel, in any order, and what is finished is kept."""

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
"""Jobs handed out for each process, so that none waits for its next."""

Progress = Callable[[int, int], None]

_FillOutcomes = Generator[tuple[FillJob, FillOutcome], None, None]


def run_plan(
    plan: EvaluationPlan,
    *,
    jobs: int,
    store: OutcomeStore | None = None,
    progress: Progress | None = None,
) -> dict[FillJob, FillOutcome]:
    """Do what is not done yet.

    Parameters
    ----------
    plan : EvaluationPlan
        What is to be done.
    jobs : int
        Processes; 0: this one.
    store : OutcomeStore, optional
        Where finished jobs are, and are kept at once.
    progress : callable, optional
        Called with the jobs done and all of them.

    Returns
    -------
    dict of FillJob to FillOutcome
        Of all jobs. It does not depend on the number of processes, but for the seconds.

    Raises
    ------
    EvaluationError
        Where a process was ended from outside.
    """
    done = dict(store.kept()) if store is not None else {}
    rest = [job for job in plan.jobs if job not in done]
    report = progress or (lambda done, total: None)
    report(len(done), len(plan.jobs))
    outcomes = _in_processes(plan, rest, jobs) if jobs else _here(plan, rest)
    try:
        with closing(outcomes):  # an interrupt here ends the other processes too
            for job, outcome in outcomes:
                if store is not None:
                    store.keep(job, outcome)
                done[job] = outcome
                report(len(done), len(plan.jobs))
    except BrokenProcessPool as error:
        kept = "" if store is None else f"; what is finished is kept in {store.folder}"
        raise EvaluationError(
            f"a process was killed with {len(done)} of {len(plan.jobs)} fills done, for want of "
            f"memory perhaps{kept}; run it again, with fewer --jobs"
        ) from error
    return {job: done[job] for job in plan.jobs}


def _here(plan: EvaluationPlan, rest: Sequence[FillJob]) -> _FillOutcomes:
    """Do jobs in this process."""
    for job in rest:
        case = plan.cases[job.case]
        yield job, run_case(plan.sources[case.clip], case, job.method)


def _in_processes(plan: EvaluationPlan, rest: Sequence[FillJob], processes: int) -> _FillOutcomes:
    """Do jobs in other processes; give them as they are finished."""
    waiting = iter(rest)
    with _pool(plan.sources, min(processes, max(len(rest), 1))) as pool:
        running: dict[Future[FillOutcome], FillJob] = {}

        def hand_out() -> None:
            for job in waiting:
                case = plan.cases[job.case]
                running[pool.submit(_work, case, job.method)] = job
                if len(running) >= AHEAD * processes:
                    break

        hand_out()
        while running:
            future = next(as_completed(running))
            yield running.pop(future), future.result()
            hand_out()


@contextmanager
def _pool(sources: Sequence[EvaluatedClip], processes: int) -> Iterator[ProcessPoolExecutor]:
    """Hand out a pool whose processes end at once when something goes wrong here."""
    others = set(mp.active_children())
    # spawned, not forked: a fork would copy locks that threads of BLAS and numba hold
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
"""In a process of the pool: the clips, sent once."""


def _begin(sources: tuple[EvaluatedClip, ...]) -> None:
    """Make a process of the pool ready: one thread, no interrupts, no life after its parent."""
    global _sources
    _sources = sources
    limit_threads(1)
    threadpool_limits(1)
    # Ctrl-C reaches every process of the terminal; the parent decides what comes of it
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = mp.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    """End this process when its parent has ended, even if that was killed."""
    wait([sentinel])
    os._exit(1)


def _work(case: GapCase, method: str) -> FillOutcome:
    return run_case(_sources[case.clip], case, method)
