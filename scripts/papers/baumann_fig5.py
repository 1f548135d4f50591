#!/usr/bin/env python
"""Baumann et al. 2011, figure 5: error by body size relative to the database.

    python scripts/papers/baumann_fig5.py [--data DIR] [--recording FILE] [--full]

Recordings are scaled about the origin. An arm and the contralateral leg are removed from their
middle and filled with all other recordings, unscaled. Errors are divided by the scale. ``--full``:
more scales.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from baumann import (
    METHODS,
    RECORDING,
    Take,
    database_of,
    examples,
    library,
    limb,
    middle,
    print_data,
)
from paper import error, in_processes, method_alone, options, print_table

import priorfill as pf
from priorfill.cli.encoding import replace_what_is_lacking

SCALES = (0.8, 0.9, 1.0, 1.1, 1.2)
MORE_SCALES = (0.7, 0.85, 0.95, 1.05, 1.15, 1.3)


@dataclass(frozen=True)
class Case:
    """A recording and the scale of its body."""

    take: Take
    scale: float
    database: Path


def errors(case: Case) -> list[float]:
    """Return the error of each method (mm), divided by the scale."""
    clip = pf.read(case.take.file)
    truth = clip.with_positions(case.scale * clip.positions)
    gappy = middle(truth, [*limb("arm", "right"), *limb("leg", "left")])
    others = method_alone(pf.Selection(not_names=(case.take.file.stem,)))
    return [
        error(
            pf.fill(gappy, database=case.database, method=method, options=others).clip,
            truth,
            gappy,
        )
        / case.scale
        for method in METHODS
    ]


def main() -> int:
    """Print the figure."""
    parser = options(__doc__, recording=RECORDING, full="more scales")
    arguments = parser.parse_args()
    takes = library(arguments.data)
    filled = examples(takes, arguments.recording, full=False)
    print_data(takes, filled, arguments.recording)
    scales = sorted(SCALES + MORE_SCALES * arguments.full)
    with database_of(takes) as database:
        cases = [Case(take, scale, database) for scale in scales for take in filled]
        found = np.array(in_processes(errors, cases))
    by_scale = found.reshape(len(scales), len(filled), len(METHODS)).mean(axis=1)
    print_table(
        "Mean error in mm, divided by the scale (paper: plot only)",
        ["scale", *METHODS, "paper"],
        [[f"{s:.2f}", *map(float, m), None] for s, m in zip(scales, by_scale, strict=True)],
    )
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
