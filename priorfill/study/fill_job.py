"""Do a job in this process, which is a child that a study started for it."""

from __future__ import annotations

import time
from dataclasses import replace

from priorfill.errors import PriorfillError
from priorfill.filling.fill_file import fill_file
from priorfill.study.job import FILLED, INCOMPLETE, NO_GAPS, JobOutcome, StudyJob
from priorfill.study.records import file_hash, write_record
from priorfill.study.settings import FillSettings

__all__ = ["fill_job"]


def fill_job(job: StudyJob) -> JobOutcome:
    """Fill a file, write its record, and return the outcome.

    Parameters
    ----------
    job : StudyJob
        The job.
    """
    begun = time.monotonic()
    settings = FillSettings.from_json(job.settings)
    files = replace(settings.files, report=job.report, uncertainty=job.uncertainty, overwrite=True)
    try:
        done = fill_file(
            job.source,
            job.output,
            database=job.database,
            same_subject=job.same_subject,
            files=files,
            **settings.fill_arguments(),
        )
    except (PriorfillError, OSError) as error:
        return JobOutcome.of_failure(job, str(error))
    result = done.result
    status = NO_GAPS if not result.gaps else FILLED if result.complete else INCOMPLETE
    written = [path for path in (job.output, job.report, job.uncertainty) if path is not None]
    outcome = JobOutcome(
        job.name,
        job.source,
        job.output,
        status,
        seconds=time.monotonic() - begun,
        report=job.report,
        uncertainty=job.uncertainty,
        written={path: file_hash(path) for path in written},
        key=job.key,
    )
    write_record(job.record, outcome)
    return outcome
