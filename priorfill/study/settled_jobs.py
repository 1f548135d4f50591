"""Which jobs need not be run: those that are done, and those that must not replace a file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from priorfill.study.job import JobOutcome, StudyJob
from priorfill.study.records import is_settled, read_record, unchanged_files
from priorfill.study.study_options import StudyOptions

__all__ = ["settled_outcome"]


def settled_outcome(job: StudyJob, options: StudyOptions) -> JobOutcome | None:
    """Return the outcome of a job that need not be run; None where it must be.

    Parameters
    ----------
    job : StudyJob
        The job with its key.
    options : StudyOptions
        Limits, and whether failures are tried again and files replaced.
    """
    kept = read_record(job.record)
    if kept is not None:
        kept = _where_files_are(kept, job)
    ours = {} if kept is None else unchanged_files(kept.written)
    changed = [Path(path).name for path, same in ours.items() if not same]
    if kept is not None and is_settled(kept, job, options.limits, retry=options.retry):
        if not changed:
            return kept
        if not options.overwrite:
            warning = (
                f"{' and '.join(changed)} was changed after the fill, and is left as it is; "
                "`overwrite` fills it again"
            )
            return replace(kept, warnings=(warning, *kept.warnings))
    if options.overwrite:
        return None
    for path in (job.output, job.report, job.uncertainty):
        if path is not None and Path(path).exists() and not ours.get(path, False):
            what = (
                "was changed after the fill"
                if path in ours
                else "exists already, and is not of this study"
            )
            reason = f"{path}: {what}; move it away, or use `overwrite`"
            return JobOutcome.of_failure(job, reason, try_again=True)
    return None


def _where_files_are(kept: JobOutcome, job: StudyJob) -> JobOutcome:
    """Return a recorded outcome with the paths of the job: a study can be moved."""
    places = {
        kept.output: job.output,
        kept.report: job.report,
        kept.uncertainty: job.uncertainty,
    }
    return replace(
        kept,
        source=job.source,
        output=job.output,
        report=kept.report and places[kept.report],
        uncertainty=kept.uncertainty and places[kept.uncertainty],
        written={places.get(path) or path: digest for path, digest in kept.written.items()},
    )
