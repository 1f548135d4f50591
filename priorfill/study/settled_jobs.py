"""Which jobs need not be run: those that are done, and those that may or can write no file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from priorfill.runtime.atomic_file import check_target
from priorfill.runtime.error_line import error_line
from priorfill.study.job import FAILED, JobLimits, JobOutcome, StudyJob
from priorfill.study.records import file_states, record_of_job
from priorfill.study.study_options import StudyOptions

__all__ = ["is_settled", "settled_outcome", "with_earlier_file"]

_EARLIER = "the filled file there is from an earlier run"


def is_settled(outcome: JobOutcome, job: StudyJob, limits: JobLimits, *, retry: bool) -> bool:
    """Return whether a recorded outcome need not be computed again.

    Written files may have been changed since; those that are gone are written again.

    Parameters
    ----------
    outcome : JobOutcome
        Of the record.
    job : StudyJob
        The job with its key.
    limits : JobLimits
        What the job may use.
    retry : bool
        Whether failures are tried again.
    """
    if outcome.key != job.key or not job.key:
        return False
    if outcome.status != FAILED:
        return all(Path(path).exists() for path in outcome.written)
    if retry:
        return False
    if outcome.exceeded == "seconds":
        return outcome.seconds >= limits.seconds
    if outcome.exceeded == "memory":
        return outcome.peak_memory >= limits.memory
    return not outcome.try_again


def settled_outcome(job: StudyJob, options: StudyOptions) -> JobOutcome | None:
    """Return the outcome of a job that need not be run, or cannot be; None where it must be.

    Parameters
    ----------
    job : StudyJob
        The job with its key.
    options : StudyOptions
        Limits, and whether failures are tried again and files replaced.
    """
    try:
        outcome = _settled_outcome(job, options)
        if outcome is None:
            for path in (job.output, job.report, job.uncertainty, job.record):
                if path is not None:
                    check_target(path, overwrite=True, source=Path(job.source))
        return outcome
    except OSError as error:  # such as a name that is too long there
        return JobOutcome.of_failure(job, error_line(error), try_again=True)


def _settled_outcome(job: StudyJob, options: StudyOptions) -> JobOutcome | None:
    """Return the outcome, or None; an OSError where files cannot be looked at."""
    kept = record_of_job(job)
    states = file_states(kept)
    current = {} if kept is None else {one: states[one] for one in kept.written if one in states}
    changed = [Path(path).name for path, state in current.items() if state == "changed"]
    unfinished = "earlier" in current.values()  # killed before the files were renamed
    settled = kept is not None and is_settled(kept, job, options.limits, retry=options.retry)
    if kept is not None and settled and not unfinished:
        if not changed:
            return kept
        if not options.overwrite:
            warning = (
                f"{' and '.join(changed)} was changed after the fill, and is left as it is; remove "
                "it to have it filled again"
            )
            return replace(kept, changed=warning, warnings=(warning, *kept.warnings))
    if options.overwrite:
        return None
    for path in (job.output, job.report, job.uncertainty):
        if path is not None and Path(path).exists() and states.get(path) in (None, "changed"):
            what = (
                "was changed after the fill"
                if path in states
                else "exists already, and this study has no record of it"
            )
            reason = f"{path}: {what}; move it away, or use `overwrite`"
            return JobOutcome.of_failure(job, reason, try_again=True)
    return None


def with_earlier_file(outcome: JobOutcome) -> JobOutcome:
    """Return an outcome whose reason states that the filled file there is from an earlier run.

    Parameters
    ----------
    outcome : JobOutcome
        Of a job.
    """
    output = outcome.output
    if outcome.status != FAILED or output not in outcome.replaced or not Path(output).exists():
        return outcome
    return replace(outcome, reason=f"{outcome.reason}; {_EARLIER}")
