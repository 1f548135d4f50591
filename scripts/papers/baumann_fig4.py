#!/usr/bin/env python
"""Baumann et al. 2011, figure 4: error by the actors of the database.

    python scripts/papers/baumann_fig4.py [--data DIR] [--database DIR]

The six markers of the left arm are removed from the takes of figure 3 and filled from all other
takes, from the takes of other actors, and from other takes of the same actor. The paper has plots;
its text has 25 mm (walk) to 50 mm (cartwheel) without the actor, more than twice the error of the
other two databases.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from glob import escape
from pathlib import Path

import numpy as np
from baumann import (
    ARM,
    METHODS,
    Example,
    choose,
    fill_by,
    gappy_of,
    opened,
    parser_of,
    print_data,
    reason,
    without,
)
from baumann_fig3 import TAKES
from paper import Comparison, error, in_processes, print_table

import priorfill as pf
from priorfill.cli.encoding import replace_what_is_lacking

PAPER = {("walk", "without the actor"): "25", ("cartwheel", "without the actor"): "50"}
"""mm. From the text."""

PAPER_RATIO = 2.0
"""Ratio of the errors without and with the actor in the paper, at least."""


def selections(example: Example) -> dict[str, pf.Selection]:
    """Return the takes of each database of the paper."""
    name, subject = escape(example.record.name), escape(example.record.subject)
    return {
        "all but the take": without(example),
        "without the actor": pf.Selection(not_subjects=(subject,)),
        "only the actor": pf.Selection(subjects=(subject,), not_names=(name,)),
    }


@dataclass(frozen=True)
class Case:
    """A take and what it is filled from."""

    example: Example
    truth: pf.Clip
    selection: pf.Selection
    library: Path


def errors(case: Case) -> list[float]:
    """Return the error (mm) of each method."""
    gappy = gappy_of(case.example, case.truth, ARM)
    filled = fill_by(case.library, gappy, case.selection, METHODS)
    return [error(clip, case.truth, gappy) for clip in filled]


def main() -> int:
    """Print the figure."""
    with opened(parser_of(__doc__).parse_args()) as library:
        examples = choose(library, TAKES)
        print_data(library, examples)
        cases = [
            Case(example, library.truth(example.record), selection, library.path)
            for example in examples
            for selection in selections(example).values()
        ]
        found = np.array(in_processes(errors, cases))
    databases = list(selections(examples[0]))
    found = found.reshape(len(examples), len(databases), len(METHODS))
    comparison = Comparison()
    rows: list[list[str | float | None]] = []
    for example, errors_of_take in zip(examples, found, strict=True):
        for database, some in zip(databases, errors_of_take, strict=True):
            paper = PAPER.get((example.take.motion, database))
            rows.append([example.name, database, *map(float, some), paper])
            if paper is not None:
                cell = f"{example.take.motion}, {database}"
                comparison.add(cell, float(some[0]), paper, reason(example, library))
    print_table("Mean error in mm of the left arm", ["take", "database", *METHODS, "paper"], rows)
    print_table(
        "Error without the actor, relative to that of the other two databases",
        ["take", "all but the take", "only the actor", "paper"],
        [
            [example.name, *map(float, some[1, 0] / some[[0, 2], 0]), f"> {PAPER_RATIO:g}"]
            for example, some in zip(examples, found, strict=True)
        ],
    )
    comparison.print()
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
