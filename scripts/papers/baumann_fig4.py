#!/usr/bin/env python
"""Baumann et al. 2011, figure 4: error by similarity of the database.

    python scripts/papers/baumann_fig4.py [--data DIR] [--recording FILE] [--full]

An arm and the contralateral leg are removed from the middle of recordings and filled with the same
motion by the same actor, the same motion by others, all other recordings, and other motions only.
``--full``: each motion by each actor.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from baumann import (
    METHODS,
    RECORDING,
    Take,
    database_of,
    examples,
    krueger_error,
    library,
    limb,
    middle,
    print_data,
)
from paper import error, in_processes, method_alone, options, print_table

import priorfill as pf
from priorfill.cli.encoding import replace_what_is_lacking
from priorfill.search.takes import takes_from

RELATIONS: dict[str, Callable[[Take, Take], bool]] = {
    "same motion, same actor": lambda a, b: a.motion == b.motion and a.actor == b.actor,
    "same motion, others": lambda a, b: a.motion == b.motion and a.actor != b.actor,
    "anything": lambda a, b: True,
    "other motions only": lambda a, b: a.motion != b.motion,
}
"""Recordings in the database, by their relation to the filled one."""

NEIGHBOURS = (256, 64, 16, 4)
"""k: 256 is too many for a database with some hundred similar poses."""


@dataclass(frozen=True)
class Case:
    """A recording, a relation, and the names of related recordings."""

    take: Take
    relation: str
    names: tuple[str, ...]
    database: Path


def related(take: Take, takes: Sequence[Take], relation: str) -> tuple[str, ...]:
    """Return the names of the other recordings with a relation to one."""
    return tuple(
        other.file.stem
        for other in takes
        if other.file.stem != take.file.stem and RELATIONS[relation](take, other)
    )


def errors(case: Case) -> list[float]:
    """Return the error (mm) of each method, then of each k; NaN without related recordings."""
    if not case.names:
        return [float("nan")] * (len(METHODS) + len(NEIGHBOURS))
    truth = pf.read(case.take.file)
    gappy = middle(truth, [*limb("arm", "right"), *limb("leg", "left")])
    chosen = pf.Selection(names=case.names)
    options = method_alone(chosen)
    found = [
        error(
            pf.fill(gappy, database=case.database, method=method, options=options).clip,
            truth,
            gappy,
        )
        for method in METHODS
    ]
    with pf.PriorDatabase.open(case.database) as database:
        priors = takes_from(database, chosen.choose(database.clips()), gappy.labels)
        found += [krueger_error(k, truth, gappy, priors) for k in NEIGHBOURS]
    return found


def main() -> int:
    """Print the figure."""
    parser = options(__doc__, recording=RECORDING, full="fill each motion by each actor")
    arguments = parser.parse_args()
    takes = library(arguments.data)
    filled = examples(takes, arguments.recording, full=arguments.full)
    print_data(takes, filled, arguments.recording)
    with database_of(takes) as database:
        cases = [
            Case(take, relation, related(take, takes, relation), database)
            for relation in RELATIONS
            for take in filled
        ]
        found = np.array(in_processes(errors, cases))
    found = found.reshape(len(RELATIONS), len(filled), -1)
    known = ~np.isnan(found).any(axis=2)
    counts = [f"{some.sum()}/{len(some)}" for some in known]
    means = [
        list(map(float, some[which].mean(axis=0))) if which.any() else [None] * some.shape[1]
        for some, which in zip(found, known, strict=True)
    ]
    few = len(METHODS)
    print_table(
        "Mean error in mm by database (paper: plot only)",
        ["database", "filled", *METHODS, "paper"],
        [
            [name, count, *m[:few], None]
            for name, count, m in zip(RELATIONS, counts, means, strict=True)
        ],
    )
    print_table(
        "The same of krueger2010 by the number k of neighbours",
        ["database", *(f"k = {k}" for k in NEIGHBOURS)],
        [[name, *m[few:]] for name, m in zip(RELATIONS, means, strict=True)],
    )
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
