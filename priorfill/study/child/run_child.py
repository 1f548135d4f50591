"""Run jobs of a study in child processes, so that a bad file costs itself only."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path

from priorfill.errors import OutputError
from priorfill.runtime.atomic_file import remove_abandoned
from priorfill.runtime.error_line import error_line
from priorfill.study.child.child_pool import ChildPool
from priorfill.study.child.child_process import ChildError, ChildProcess, child_command
from priorfill.study.child.scratch_folder import remove_abandoned_scratch
from priorfill.study.job import FAILED, JobLimits, JobOutcome, StudyJob
from priorfill.study.records import files_of_job, write_record

__all__ = ["COMMAND", "remove_leftovers", "run_child"]

COMMAND = "batch-job"
"""The hidden command that a child runs."""


def run_child(
    job: StudyJob,
    limits: JobLimits,
    stop: threading.Event | None = None,
    *,
    command: Sequence[str] | None = None,
    children: ChildPool | None = None,
) -> JobOutcome:
    """Fill the file of a job in a child process, and return what became of it.

    The child writes the outputs and the record. Where it ends without an outcome, the record of
    the failure is written here. A job that was stopped leaves no record. What fails in a child that
    has filled other files is tried in another one, unless the file is bad or takes too long:
    outcomes do not depend on what a child did before.

    Parameters
    ----------
    job : StudyJob
        The job.
    limits : JobLimits
        What it may use.
    stop : threading.Event, optional
        Ends the child when it is set.
    command : sequence of str, optional
        The program that fills; by default the hidden command of this priorfill.
    children : ChildPool, optional
        Children that wait for another job; by default the job has a child of its own.

    Returns
    -------
    JobOutcome
        The outcome, of a failure as well.
    """
    request = {"job": job.to_json(), "limits": asdict(limits)}
    used = None if children is None else children.take()
    if used is not None:
        used.ask(request, limits)
        outcome = _outcome(used, job, limits, stop, children)
        is_final = outcome.status != FAILED or outcome.exceeded == "seconds"
        if is_final or not used.has_ended or (stop is not None and stop.is_set()):
            return outcome
    try:
        child = ChildProcess(command or child_command(COMMAND), request, limits)
    except OSError as error:  # too many processes, too many open files, no Python
        reason = f"no process could be started: {error_line(error)}"
        return JobOutcome.of_failure(job, reason, try_again=True)
    return _outcome(child, job, limits, stop, children)


def _outcome(
    child: ChildProcess,
    job: StudyJob,
    limits: JobLimits,
    stop: threading.Event | None,
    children: ChildPool | None,
) -> JobOutcome:
    """Wait for the outcome of a job, and keep the child for another one if it is sound."""
    begin = time.monotonic()
    is_kept = False
    try:
        outcome = JobOutcome.from_json(child.answer(stop))
        is_kept = children is not None and not outcome.try_again
    except ChildError as error:
        remove_leftovers(job)
        outcome = replace(
            JobOutcome.of_failure(
                job, str(error), try_again=error.try_again, exceeded=error.exceeded
            ),
            seconds=time.monotonic() - begin,
            peak_memory=child.peak_memory,
            replaced=files_of_job(job),
        )
        if not error.stopped:
            with suppress(OutputError):  # then the job is simply done again
                write_record(job.record, outcome)
    finally:
        if not is_kept:
            child.close()
    if is_kept and children is not None:
        children.give(child, limits)
    return outcome


def remove_leftovers(*jobs: StudyJob) -> None:
    """Remove temporary files that killed children have left.

    Parameters
    ----------
    *jobs : StudyJob
        The jobs.
    """
    paths = {
        path
        for job in jobs
        for path in (job.output, job.record, job.report, job.uncertainty)
        if path is not None
    }
    # links are followed, as writers do
    for folder in {Path(os.path.realpath(path)).parent for path in paths}:
        remove_abandoned(folder)
    remove_abandoned_scratch()
