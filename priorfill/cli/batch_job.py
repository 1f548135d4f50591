"""``priorfill batch-job``, a hidden command: the child process that fills files of a study."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import click

__all__ = ["batch_job"]


@click.command(hidden=True)
def batch_job() -> None:
    """Fill the files of jobs, one after the other; the jobs come from the parent process."""
    from priorfill.study.child.parent_connection import ParentConnection

    parent = ParentConnection()  # at once: what is imported below takes a second
    from priorfill.study.child.own_memory import forget_peak, limit_memory
    from priorfill.study.child.scratch_folder import scratch_folder
    from priorfill.study.fill_job import fill_job
    from priorfill.study.job import JobLimits, StudyJob

    request: Mapping[str, Any] | None = parent.request
    with scratch_folder():
        while request is not None:
            limits = JobLimits(**request["limits"])
            parent.end_at(limits.seconds)
            limit_memory(limits)
            forget_peak()
            parent.answer(fill_job(StudyJob.from_json(request["job"]), limits).to_json())
            request = parent.next_request()
