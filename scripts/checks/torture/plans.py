"""Plans: random sequences of changes of a database, and their execution."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from priorfill.database import PriorDatabase
from torture.clips import fill_of

STEPS = 40
"""Number of operations in a plan."""

KINDS_OF_STEPS = ("add", "remove", "accept", "compact", "merge")

STEPS_AFTER = 2
"""Number of operations after the one that is to be disturbed."""


@dataclass(frozen=True)
class Step:
    """One operation, and the contents before and after it."""

    kind: str
    names: tuple[str, ...]
    before: dict[str, str] = field(repr=False)
    after: dict[str, str] = field(repr=False)

    def admits(self, found: dict[str, str]) -> bool:
        """Return whether contents are valid after this step was begun but not reported."""
        if self.kind == "merge":  # clip by clip
            return all(self.after.get(name) == version for name, version in found.items()) and (
                set(self.before) <= set(found)
            )
        return found in (self.before, self.after)


def make_plan(rng: random.Random, own: dict[str, str], other: dict[str, str]) -> list[Step]:
    """Return a random sequence of steps that all make sense."""
    steps: list[Step] = []
    state = dict(own)
    pool = own | other
    while len(steps) < STEPS:
        gappy = sorted(name for name, version in state.items() if version == "gappy")
        gone = sorted(set(pool) - set(state))
        kind = rng.choice(("remove", "accept", "accept", "compact", "merge", "add", "add"))
        after = dict(state)
        names: tuple[str, ...] = ()
        if kind == "remove" and len(state) > 5:
            names = tuple(rng.sample(sorted(state), rng.randint(1, 3)))
            for name in names:
                del after[name]
        elif kind == "accept" and gappy:
            names = (rng.choice(gappy),)
            after[names[0]] = "filled"
        elif kind == "add" and gone:
            names = (rng.choice(gone),)
            after[names[0]] = pool[names[0]]
        elif kind == "merge":
            after = other | state
        elif kind != "compact":
            continue
        steps.append(Step(kind, names, state, after))
        state = after
    return steps


def plan_of_all(rng: random.Random, own: dict[str, str], other: dict[str, str]) -> list[Step]:
    """Return a plan with steps of all kinds."""
    while True:
        steps = make_plan(rng, own, other)
        if len({step.kind for step in steps}) == len(KINDS_OF_STEPS):
            return steps


def plan_until(
    rng: random.Random, own: dict[str, str], other: dict[str, str], kind: str
) -> tuple[list[Step], int]:
    """Return a short plan, and the number of a step of a kind in it that has something to do."""
    while True:
        steps = make_plan(rng, own, other)
        has_garbage = False
        for number, step in enumerate(steps):
            if step.kind == kind and (kind != "compact" or has_garbage):
                return steps[: number + 1 + STEPS_AFTER], number
            has_garbage |= step.kind in ("remove", "accept")


def written(steps: list[Step]) -> str:
    """Return a plan as `drive` reads it."""
    return json.dumps([(step.kind, step.names) for step in steps])


def drive(
    folder: Path,
    plan: Path,
    files: Path,
    other: Path,
    begin: Callable[[int], int] = lambda number: 0,
) -> None:
    """Execute a plan; print when each step begins and is done.

    Parameters
    ----------
    folder : Path
        The database.
    plan : Path
        The steps, as `written`.
    files, other : Path
        The folder of the clips, and the database that is merged.
    begin : callable, optional
        Called with the number of each step before it begins; returns the number of calls so far
        that changed the disk.
    """
    from priorfill import formats

    with PriorDatabase.open(folder, write=True) as database:
        for number, (kind, names) in enumerate(json.loads(plan.read_text())):
            print("begin", number, begin(number), flush=True)
            if kind == "remove":
                database.remove([r for r in database.clips() if r.name in names])
            elif kind == "accept":
                filled, mask = fill_of(formats.read(files / f"{names[0]}.c3d"))
                database.accept(filled, mask, filled_by="straight lines")
            elif kind == "add":
                database.add(formats.read(files / f"{names[0]}.c3d"))
            elif kind == "compact":
                database.compact()
            elif kind == "merge":
                with PriorDatabase.open(other) as reader:
                    database.merge(reader)
            print("done", number, flush=True)
