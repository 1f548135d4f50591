"""``priorfill batch-job``: a child process of ``priorfill batch``, which fills one file."""

from __future__ import annotations

import json
import sys

import click

from priorfill.cli.output import print_json_line

__all__ = ["batch_job"]


@click.command(hidden=True)
def batch_job() -> None:
    """Fill the file of the job on stdin, and print its outcome; for `priorfill batch` only."""
    from priorfill.study.fill_job import fill_job
    from priorfill.study.job import StudyJob

    job = StudyJob.from_json(json.loads(sys.stdin.readline()))
    print_json_line(fill_job(job).to_json())
