"""Let the database of a study grow, round by round, so that an interruption changes nothing."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from priorfill.database import PriorDatabase
from priorfill.database.manifest import read_manifest
from priorfill.errors import DatabaseError, DatabaseLockedError, DatabaseStateError
from priorfill.filling.provenance import package_versions
from priorfill.study.add_outcomes import add_outcome, reason_not_to_add
from priorfill.study.growth_plan import GrowthPlan, Round
from priorfill.study.job import FAILED
from priorfill.study.survey import session_of

if TYPE_CHECKING:
    from pathlib import Path

    from priorfill.study.job import JobOutcome
    from priorfill.study.settings import FillSettings
    from priorfill.study.study_folder import StudyFolder
    from priorfill.study.survey import Survey

__all__ = ["Growth"]

MAX_NOTES = 10
"""Files whose reason for not being added is stated."""

RETRY_SECONDS, MAX_WAIT_SECONDS = 1.0, 120.0
"""Time between two attempts to write to a database, and after which they are given up. Others add a
file in less than a second."""


class Growth:
    """The rounds of a study whose database grows.

    Parameters
    ----------
    database : Path
        The database; created if there is none.
    folder : StudyFolder
        Where the rounds are kept.
    settings : FillSettings
        Options of the fills.
    surveys : sequence of Survey
        Facts of all files.
    read_only : bool
        Whether nothing is to be written.
    """

    def __init__(
        self,
        database: Path,
        folder: StudyFolder,
        settings: FillSettings,
        surveys: Sequence[Survey],
        *,
        read_only: bool = False,
    ) -> None:
        self._database = database
        self._settings = settings
        self._read_only = read_only
        self._notes: list[str] = []
        self._not_added: list[str] = []
        self._round: Round | None = None
        if not read_only:
            PriorDatabase.open_or_create(database).close()
        basis = {
            "settings": settings.to_json(),
            "versions": dict(package_versions()),
            "database": read_manifest(database).identity,
        }
        self._kept = GrowthPlan(folder.growth, basis)
        self._forget_lost_states()
        self._kept.include(surveys)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know of what was learnt from, and what was not added."""
        shown, more = self._not_added[:MAX_NOTES], len(self._not_added) - MAX_NOTES
        if more > 0:
            shown.append(f"{more} more files were not added to the database")
        return (*self._notes, *shown)

    def rounds(self) -> Iterator[tuple[str, frozenset[str]]]:
        """Yield the state of the database and the names of the jobs of each round."""
        for one in self._kept.rounds:
            if not one.state:
                one.state = self._state_after(self._round)
                if not self._read_only:
                    self._kept.save()
            self._round = one
            yield one.state, frozenset(one.contents)

    def add(self, outcomes: Mapping[str, JobOutcome]) -> None:
        """Add what was filled well enough in the round.

        Parameters
        ----------
        outcomes : mapping of str to JobOutcome
            By name.
        """
        assert self._round is not None
        handled = self._round.handled
        done = [outcomes[name] for name in self._round.contents if name in outcomes]
        new = [one for one in done if handled.get(one.name) != _version(one)]
        if not new:
            return
        trusted, reading = self._settings.options.trust_filled, self._settings.files.reading
        try:
            with _opened_for_writing(self._database) as database:
                for outcome in new:
                    reason = reason_not_to_add(outcome, trust_filled=trusted)
                    if not reason:
                        session = session_of(outcome.name)
                        reason, clips = add_outcome(database, outcome, reading, session)
                        self._round.clips += clips
                    if reason and outcome.status != FAILED:  # a failure is reported as such
                        self._not_added.append(
                            f"{outcome.name}: not added to the database: {reason}"
                        )
                    handled[outcome.name] = _version(outcome)
        except DatabaseError as error:
            raise DatabaseError(
                f"{error}; the files that are filled are kept, and the same command continues"
            ) from error
        self._kept.save()

    def _forget_lost_states(self) -> None:
        """Begin anew where the database does not have the states that were learnt from."""
        try:
            for state in {one.state for one in self._kept.rounds} - {""}:
                PriorDatabase.open(self._database, state=state).close()
        except DatabaseStateError:
            self._kept.rounds = []
            self._notes.append(
                f"{self._database}: was compacted or replaced after the study began, which "
                "therefore begins anew and learns from all that it holds"
            )

    def _state_after(self, last: Round | None) -> str:
        """Return the state of the database; note clips that somebody else has added."""
        with PriorDatabase.open(self._database) as database:
            if last is not None:
                with PriorDatabase.open(self._database, state=last.state) as past:
                    known = {record.content for record in past.clips()}
                known |= {clip for one in self._kept.rounds for clip in one.clips}
                others = sum(record.content not in known for record in database.clips())
                if others:
                    self._notes.append(
                        f"{self._database}: {others} clips were added by others meanwhile, and are "
                        "learnt from as well"
                    )
            return database.state


def _opened_for_writing(path: Path) -> PriorDatabase:
    """Open a database; another writer is waited for."""
    until = time.monotonic() + MAX_WAIT_SECONDS
    while True:
        try:
            return PriorDatabase.open(path, write=True)
        except DatabaseLockedError:
            if time.monotonic() > until:
                raise
        time.sleep(RETRY_SECONDS)


def _version(outcome: JobOutcome) -> str:
    """Return the SHA-256 of the filled file; empty where there is none."""
    return outcome.written.get(outcome.output, "")
