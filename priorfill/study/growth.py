"""Let the database of a study grow, round by round, so that an interruption changes nothing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from priorfill.database import PriorDatabase
from priorfill.database.manifest import read_manifest
from priorfill.errors import DatabaseStateError, OptionError
from priorfill.filling.provenance import package_versions
from priorfill.study.add_outcomes import add_outcome, reason_not_to_add
from priorfill.study.growth_plan import GrowthPlan, Round
from priorfill.study.survey import session_of

if TYPE_CHECKING:
    from priorfill.study.job import JobOutcome
    from priorfill.study.settings import FillSettings
    from priorfill.study.study_plan import StudyPlan
    from priorfill.study.survey import Survey

__all__ = ["Growth"]


class Growth:
    """The rounds of a study whose database grows.

    Parameters
    ----------
    plan : StudyPlan
        Its folder and its database.
    settings : FillSettings
        Options of the fills.
    surveys : sequence of Survey
        Facts of all files.

    Attributes
    ----------
    notes : list of str
        What was not added, and why.
    """

    def __init__(self, plan: StudyPlan, settings: FillSettings, surveys: Sequence[Survey]) -> None:
        if plan.database is None:
            raise OptionError("`grow` needs a database; give the folder of one (`database`)")
        self.notes: list[str] = []
        self._database = plan.database
        self._reading = settings.files.reading
        self._trust_filled = settings.options.trust_filled
        self._round: Round | None = None
        with PriorDatabase.open_or_create(plan.database):
            pass  # a database that a killed writer left is put in order
        basis = {
            "settings": settings.to_json(),
            "versions": dict(package_versions()),
            "database": read_manifest(plan.database).identity,
        }
        self._kept = GrowthPlan(plan.folder.growth, basis)
        self._forget_lost_states()
        self._kept.include(surveys)

    def rounds(self) -> Iterator[tuple[str, frozenset[str]]]:
        """Yield the state of the database and the names of the jobs of each round."""
        for one in self._kept.rounds:
            if not one.state:
                one.state = self._state_after(self._round)
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
        with PriorDatabase.open(self._database, write=True) as database:
            for outcome in new:
                reason = reason_not_to_add(outcome, trust_filled=self._trust_filled)
                if not reason:
                    session = session_of(outcome.name)
                    reason, clips = add_outcome(database, outcome, self._reading, session)
                    self._round.clips += clips
                if reason:
                    self.notes.append(f"{outcome.name}: not added to the database: {reason}")
                handled[outcome.name] = _version(outcome)
        self._kept.save()

    def _forget_lost_states(self) -> None:
        """Begin anew where the database does not have the states that were learnt from."""
        try:
            for state in {one.state for one in self._kept.rounds} - {""}:
                PriorDatabase.open(self._database, state=state).close()
        except DatabaseStateError:
            self._kept.rounds = []
            self.notes.append(
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
                    self.notes.append(
                        f"{self._database}: {others} clips were added by others meanwhile, and are "
                        "learnt from as well"
                    )
            return database.state


def _version(outcome: JobOutcome) -> str:
    """Return the SHA-256 of the filled file; empty where there is none."""
    return outcome.written.get(outcome.output, "")
