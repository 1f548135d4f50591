#!/usr/bin/env python
"""Baumann et al. 2011, figure 5: error by body size, for five actors.

    python scripts/papers/baumann_fig5.py [--data DIR] [--database DIR]

The six markers of the left arm are removed from a walk of each actor, and filled from the takes of
the other actors. The paper has a plot only, and does not state how it measures size: here it is the
sum of the mean lengths of shanks, forearms and upper arms. In a library without the actors of the
paper, five other people stand for them.
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
    PaperTake,
    choose,
    fill_by,
    gappy_of,
    opened,
    parser_of,
    print_data,
)
from paper import error, in_processes, print_table

import priorfill as pf
from priorfill.cli.encoding import replace_what_is_lacking

ACTORS = ("bd", "bk", "dg", "mm", "tr")

LIKE = ("01-01", "jogLeft", "2_walk_")
"""Parts of names of stand-ins."""

TAKES = tuple(PaperTake(f"walk of {a}", f"HDM_{a}_01-01_01_120", 0, 0, LIKE) for a in ACTORS)

LENGTHS = (("KNE", "ANK"), ("ELB", "WRA"), ("SHO", "ELB"))
"""Pairs of markers, on both sides, whose distances add up to a size."""


@dataclass(frozen=True)
class Case:
    """A take of an actor."""

    example: Example
    truth: pf.Clip
    library: Path


def errors(case: Case) -> list[float]:
    """Return the error (mm) of each method."""
    gappy = gappy_of(case.example, case.truth, ARM)
    others = pf.Selection(not_subjects=(escape(case.example.record.subject),))
    filled = fill_by(case.library, gappy, others, METHODS)
    return [error(clip, case.truth, gappy) for clip in filled]


def size(clip: pf.Clip) -> float:
    """Return the sum of mean lengths of limbs (mm)."""
    at = {label: clip.positions[:, i] for i, label in enumerate(clip.labels)}
    lengths = [
        float(np.nanmean(np.linalg.norm(at[side + first] - at[side + last], axis=1)))
        for first, last in LENGTHS
        for side in "LR"
    ]
    return sum(lengths) / 2.0


def main() -> int:
    """Print the figure."""
    with opened(parser_of(__doc__).parse_args()) as library:
        examples = choose(library, TAKES)
        print_data(library, examples)
        cases = [Case(e, library.truth(e.record), library.path) for e in examples]
        found = in_processes(errors, cases)
    sizes = [size(case.truth) for case in cases]
    order = np.argsort(sizes)
    print_table(
        "Mean error in mm of the left arm, by size of the body (paper: plot only)",
        ["take", "size in mm", *METHODS, "paper"],
        [[examples[i].name, f"{sizes[i]:.0f}", *map(float, found[i]), None] for i in order],
    )
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
