"""``priorfill batch-survey``, a hidden command: the child process that surveys files of a study."""

from __future__ import annotations

import click

__all__ = ["batch_survey"]


@click.command(hidden=True)
def batch_survey() -> None:
    """Read files and answer with the facts of each; the request comes from the parent process."""
    from priorfill.study.child.parent_connection import ParentConnection

    parent = ParentConnection()
    from priorfill.study.child.own_memory import limit_memory
    from priorfill.study.job import JobLimits

    limit_memory(JobLimits(**parent.request["limits"]))
    from priorfill.study.survey_files import surveys_of

    for survey in surveys_of(parent.request):
        parent.answer(survey.to_json())
