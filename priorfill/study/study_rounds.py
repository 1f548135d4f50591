"""Rounds of jobs: all at once, as the outcome of none depends on another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from priorfill.study.job import JobOutcome, StudyJob

__all__ = ["StudyRounds"]


class StudyRounds:
    """The jobs of a study in rounds; those of a round may run at the same time.

    Parameters
    ----------
    jobs : sequence of StudyJob
        All jobs, without keys.
    """

    def __init__(self, jobs: Sequence[StudyJob]) -> None:
        self._jobs = list(jobs)

    def __iter__(self) -> Iterator[list[StudyJob]]:
        """Yield the jobs of each round."""
        yield self._jobs

    def learn(self, outcomes: Mapping[str, JobOutcome]) -> None:
        """Take the outcomes so far, before the next round begins.

        Parameters
        ----------
        outcomes : mapping of str to JobOutcome
            By name.
        """
