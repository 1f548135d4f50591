"""Rounds of jobs: what each file is filled from, and which may be filled at the same time.

A survey finds the facts of the files; other recordings of its session are sources of each. All jobs
are one round, as the outcome of none depends on another, unless the database grows.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from priorfill.filling.add_result import can_create_database
from priorfill.study.growth import Growth
from priorfill.study.job import JobOutcome, StudyJob
from priorfill.study.same_session import same_session_sources
from priorfill.study.settings import FillSettings
from priorfill.study.study_options import StudyOptions
from priorfill.study.study_progress import estimated_work
from priorfill.study.survey import session_of
from priorfill.study.survey_files import survey_files

if TYPE_CHECKING:
    from priorfill.study.study_plan import StudyPlan
    from priorfill.study.survey import Survey

__all__ = ["StudyRounds"]

LEARN_FROM_NOTHING = frozenset({"linear", "pchip", "spline", "rigid"})
"""Methods that learn from no other recording."""


class StudyRounds:
    """The jobs of a study in rounds; those of a round may run at the same time.

    Parameters
    ----------
    plan : StudyPlan
        The jobs, without keys.
    options : StudyOptions
        Whether sessions are used, and whether the database grows.

    Attributes
    ----------
    work : dict of str to float
        How much work each job is, in any unit, by name: from the survey if there is one.
    """

    def __init__(self, plan: StudyPlan, options: StudyOptions) -> None:
        self._plan = plan
        self._options = options
        self._growth: Growth | None = None
        self.work = dict(plan.work)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know of how the database grew."""
        return () if self._growth is None else self._growth.notes

    def __iter__(self) -> Iterator[list[StudyJob]]:
        """Yield the jobs of each round, with their sources.

        Raises
        ------
        DatabaseError
            If the database that grows cannot be read.
        OutputError
            If the state of the study cannot be written.
        """
        jobs = list(self._plan.jobs)
        if not jobs:  # a task of an array has nothing to do
            return
        settings = FillSettings.from_json(jobs[0].settings)
        session = self._options.same_session and settings.method not in LEARN_FROM_NOTHING
        surveys = self._survey(settings) if session or self._options.grow else []
        self.work |= {one.name: estimated_work(one) for one in surveys if one.name in self.work}
        if session:
            sources = same_session_sources(surveys)
            jobs = [replace(job, same_subject=sources.get(job.name, ())) for job in jobs]
        if not self._options.grow:
            yield jobs
            return
        database = self._plan.database
        assert database is not None  # as the plan has checked
        if self._options.check_only and can_create_database(database):
            return  # nothing can be done yet
        self._growth = Growth(
            database, self._plan.folder, settings, surveys, read_only=self._options.check_only
        )
        for state, names in self._growth.rounds():
            yield [replace(job, database_state=state) for job in jobs if job.name in names]

    def learn(self, outcomes: Mapping[str, JobOutcome]) -> None:
        """Take the outcomes so far, before the next round begins.

        Parameters
        ----------
        outcomes : mapping of str to JobOutcome
            By name.

        Raises
        ------
        DatabaseError
            If the database that grows cannot be written.
        """
        if self._growth is not None and not self._options.check_only:
            self._growth.add(outcomes)

    def _survey(self, settings: FillSettings) -> list[Survey]:
        """Return the facts of the files that decide the sources of the jobs, and the rounds."""
        sessions = Counter(session_of(one.name) for one in self._plan.sources)
        least = 1 if self._options.grow else 2  # a file that is alone in its folder has no sources
        wanted = {
            session
            for session in (session_of(job.name) for job in self._plan.jobs)
            if sessions[session] >= least
        }
        files = [
            (one.name, str(one.path))
            for one in self._plan.sources
            if session_of(one.name) in wanted
        ]
        kept = None if self._options.check_only else self._plan.folder.survey
        return survey_files(
            files,
            settings.files.reading,
            kept,
            self._options.limits,
            workers=self._options.worker_count,
        )
