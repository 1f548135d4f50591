"""``priorfill batch-job``, a hidden command: the child process that fills one file of a study."""

from __future__ import annotations

import click

__all__ = ["batch_job"]


@click.command(hidden=True)
def batch_job() -> None:
    """Fill the file of a job; the job comes from the parent process."""
    from priorfill.study.life_line import ParentConnection

    parent = ParentConnection()  # at once: what is imported below takes a second
    from priorfill.study.child_limits import limit_memory
    from priorfill.study.job import JobLimits, StudyJob

    limits = JobLimits(**parent.request["limits"])
    parent.end_at(limits.seconds)
    limit_memory(limits)
    from priorfill.study.fill_job import fill_job

    parent.answer(fill_job(StudyJob.from_json(parent.request["job"])).to_json())
