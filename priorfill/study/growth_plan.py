"""The rounds of a study whose database grows, and the state of the database before each of them.

Files are filled in rounds, those with few gaps first. After a round, what was filled well enough is
added to the database, and the next round learns from it. The rounds, and the state of the database
that each learns from, are kept: a study that is killed and run again gives the same fills.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from priorfill.runtime.atomic_file import replace_file
from priorfill.study.survey import Survey

__all__ = ["GrowthPlan", "Round", "rounds_of"]

ROUNDS = 4
"""Rounds of a study. The last one learns from three quarters of the files; workers wait for each
other at the end of each."""

MIN_FILES = 4
"""Files that a round has at least: few add little, and workers would wait."""


def rounds_of(surveys: Iterable[Survey]) -> tuple[tuple[str, ...], ...]:
    """Return the names of the jobs of each round, those with the smallest share missing first.

    Parameters
    ----------
    surveys : iterable of Survey
        Of files that are filled.

    Returns
    -------
    tuple of tuple of str
        At most `ROUNDS`, of nearly equal sizes, which depend on the number of files only. Files
        that cannot be read are in the last one.
    """
    ordered = sorted(surveys, key=_difficulty)
    count = max(1, min(ROUNDS, len(ordered) // MIN_FILES))
    borders = [len(ordered) * number // count for number in range(count + 1)]
    parts = [ordered[borders[i] : borders[i + 1]] for i in range(count)]
    return tuple(tuple(one.name for one in part) for part in parts if part)


def _difficulty(survey: Survey) -> tuple[bool, float, float, str]:
    longest = max((one.longest_gap for one in survey.subjects), default=0.0)
    return not survey.subjects, survey.missing_share, longest, survey.name


@dataclass
class Round:
    """A round of jobs.

    Attributes
    ----------
    contents : dict of str to str
        SHA-256 of the file of each job, by its name.
    state : str
        State of the database that the jobs learn from; empty until the round begins.
    handled : dict of str to str
        SHA-256 of the filled files that were added, or that are not to be, by name of the job;
        empty for one that is not filled.
    clips : list of str
        Content hashes of the clips that were added.
    """

    contents: dict[str, str]
    state: str = ""
    handled: dict[str, str] = field(default_factory=dict)
    clips: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        texts = [self.state, *self.clips]
        for hashes in (self.contents, self.handled):
            texts += [*hashes.keys(), *hashes.values()]
        if not all(isinstance(one, str) for one in texts):
            raise TypeError("a round has texts only")


class GrowthPlan:
    """The rounds of a study, kept in a file.

    Parameters
    ----------
    path : Path
        The file; it need not exist.
    basis : mapping of str to object
        JSON values that decide all outcomes. Rounds on another basis are forgotten.
    """

    def __init__(self, path: Path, basis: Mapping[str, Any]) -> None:
        self._path = path
        self._basis = json.loads(json.dumps(dict(basis)))
        self.rounds: list[Round] = []
        try:
            values = json.loads(path.read_text(encoding="ascii"))
            if values["basis"] == self._basis:
                self.rounds = [Round(**one) for one in values["rounds"]]
        except (OSError, ValueError, TypeError, AttributeError, LookupError, RecursionError):
            self.rounds = []  # there is no such file, or it is damaged

    def include(self, surveys: Sequence[Survey]) -> None:
        """Put files that are in no round into rounds of their own, which come last.

        Parameters
        ----------
        surveys : sequence of Survey
            Of all files of the study.
        """
        planned: dict[str, str] = {}
        for one in self.rounds:
            planned |= one.contents
        added = [one for one in surveys if planned.get(one.name) != one.content]
        for old in self.rounds:
            for survey in added:
                old.contents.pop(survey.name, None)
        contents = {one.name: one.content for one in added}
        self.rounds += [
            Round({name: contents[name] for name in names}) for names in rounds_of(added)
        ]

    def save(self) -> None:
        """Keep the rounds.

        Raises
        ------
        OutputError
            If they cannot be written.
        """
        values = {"basis": self._basis, "rounds": [asdict(one) for one in self.rounds]}
        with replace_file(self._path, overwrite=True) as temporary:
            temporary.write_text(
                json.dumps(values, indent=1) + "\n", encoding="ascii", newline="\n"
            )
