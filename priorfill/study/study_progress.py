"""How far a study is, and how long the rest takes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING

from priorfill.study.job import FAILED, JobOutcome
from priorfill.study.study_options import StudyProgress

if TYPE_CHECKING:
    from priorfill.study.survey import Survey

__all__ = ["ProgressOfJobs", "estimated_work"]

MISSING_SAMPLE = 5.0
"""Work of a missing sample, in samples of the recording: what is learnt from takes time, too. So it
is, roughly, in recordings of ten seconds to a minute."""

ONLY_COPIED = 0.05
"""Work of a sample of a recording without gaps: it is read, checked and copied."""


class ProgressOfJobs:
    """Counts finished jobs, and estimates the time left from the work that was done so far.

    Parameters
    ----------
    work : mapping of str to float
        Work of each job, in any unit, by name.
    report : callable or None
        Called with a `StudyProgress` whenever jobs are finished.
    """

    def __init__(
        self, work: Mapping[str, float], report: Callable[[StudyProgress], None] | None
    ) -> None:
        self._work = work
        self._total = sum(work.values())
        self._report = report
        self._done = self._failed = 0
        self._work_done = self._work_filled = 0.0
        self._begun: float | None = None

    def settled(self, outcomes: Iterable[JobOutcome]) -> None:
        """Count jobs that an earlier run did; they take no time.

        Parameters
        ----------
        outcomes : iterable of JobOutcome
            Their outcomes.
        """
        for outcome in outcomes:
            self._count(outcome)
        if self._begun is None:
            self._begun = time.monotonic()
        self._show()

    def filled(self, outcome: JobOutcome) -> None:
        """Count a job that was run.

        Parameters
        ----------
        outcome : JobOutcome
            Its outcome.
        """
        self._count(outcome)
        self._work_filled += self._work[outcome.name]
        self._show()

    def _count(self, outcome: JobOutcome) -> None:
        self._done += 1
        self._failed += outcome.status == FAILED
        self._work_done += self._work[outcome.name]

    def _show(self) -> None:
        if self._report is None:
            return
        left = self._total - self._work_done
        seconds = None
        if self._done == len(self._work):
            seconds = 0.0
        elif self._work_filled and self._begun is not None:
            seconds = (time.monotonic() - self._begun) * left / self._work_filled
        share = self._work_done / self._total if self._total else self._done / len(self._work)
        self._report(StudyProgress(self._done, self._failed, len(self._work), share, seconds))


def estimated_work(survey: Survey) -> float:
    """Return how much work the fill of a file is, in samples.

    Parameters
    ----------
    survey : Survey
        Facts of the file.
    """
    samples = sum(one.samples for one in survey.subjects)
    if not survey.missing:
        return max(ONLY_COPIED * samples, 1.0)
    return samples + MISSING_SAMPLE * survey.missing
