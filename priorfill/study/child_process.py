"""Run a job of a study in a child process, so that a bad file costs itself only."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Sequence
from contextlib import closing, suppress
from dataclasses import asdict, replace
from pathlib import Path

from priorfill.errors import OutputError
from priorfill.runtime.atomic_file import remove_abandoned
from priorfill.study.child_watch import ChildError, ChildProcess, child_command
from priorfill.study.job import JobLimits, JobOutcome, StudyJob
from priorfill.study.records import files_of_job, write_record

__all__ = ["COMMAND", "run_child"]

COMMAND = "batch-job"
"""The hidden command that a child runs."""


def run_child(
    job: StudyJob,
    limits: JobLimits,
    stop: threading.Event | None = None,
    *,
    command: Sequence[str] | None = None,
) -> JobOutcome:
    """Fill the file of a job in a child process, and return what became of it.

    The child writes the outputs and the record. Where it ends without an outcome, the record of
    the failure is written here. A job that was stopped leaves no record.

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

    Returns
    -------
    JobOutcome
        The outcome, of a failure as well.
    """
    begin = time.monotonic()
    request = {"job": job.to_json(), "limits": asdict(limits)}
    try:
        with closing(ChildProcess(command or child_command(COMMAND), request, limits)) as child:
            try:
                outcome = JobOutcome.from_json(child.answer(stop))
            finally:
                peak = child.peak_memory
    except ChildError as error:
        remove_leftovers(job)
        outcome = replace(
            JobOutcome.of_failure(
                job, str(error), try_again=error.try_again, exceeded=error.exceeded
            ),
            seconds=time.monotonic() - begin,
            replaced=files_of_job(job),
            peak_memory=peak,
        )
        if not error.stopped:
            with suppress(OutputError):  # then the job is simply done again
                write_record(job.record, outcome)
        return outcome
    return replace(outcome, peak_memory=max(peak, outcome.peak_memory))


def remove_leftovers(job: StudyJob) -> None:
    """Remove temporary files that a killed child has left.

    Parameters
    ----------
    job : StudyJob
        The job.
    """
    paths = (job.output, job.record, job.report, job.uncertainty)
    # links are followed, as writers do
    for folder in {Path(os.path.realpath(path)).parent for path in paths if path is not None}:
        remove_abandoned(folder)
