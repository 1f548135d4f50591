#!/usr/bin/env python
"""Gløersen and Federolf 2016, figure 6: how errors depend on the method's constants.

    python scripts/papers/gloersen_fig6.py [--data DIR] [--recording FILE] [--full]

Interpretation: one constant at a time is changed, the others are the paper's: sigma (mm), w_mm,
the distance cut-off of r2, and the share of the singular values that the components kept reach
(MinCumSV). Copies have random gaps in half of the frames, as in ``gloersen_fig4.py`` (8, with
``--full`` 50). The paper shows curves, which are not available; the values it chose are.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from gloersen import (
    METHODS,
    RECORDING,
    mean_distance,
    print_data,
    quartiles,
    read,
    recording,
    runs_in_frames,
)
from paper import Cell, in_processes, options, print_table

from priorfill.cli.encoding import replace_what_is_lacking
from priorfill.methods.gloersen2016 import Gloersen2016Options

SHARE = 0.5
"""Of the frames."""

VALUES: dict[str, tuple[float, ...]] = {
    "sigma": (50.0, 100.0, 150.0, 200.0, 300.0, 500.0, 1000.0),
    "missing_weight": (0.001, 0.005, 0.02, 0.05, 0.1, 0.3, 1.0),
    "distal_threshold": (0.0, 0.25, 0.5, 0.75, 1.0, 2.0),
    "min_singular_share": (0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 0.999),
}
"""Of the options of r1 and r2; the paper's own are among them."""

NAMES = {
    "sigma": "sigma",
    "missing_weight": "w_mm",
    "distal_threshold": "cut-off",
    "min_singular_share": "MinCumSV",
}
"""The paper's names."""

FEW, MANY = 8, 50
"""Copies."""


@dataclass(frozen=True)
class Case:
    """A copy of a recording."""

    file: Path
    copy: int


def errors(case: Case) -> list[list[float]]:
    """Return the mean error (mm) for each constant's values, and each method."""
    clip = read(case.file)
    gone = runs_in_frames(clip, SHARE, case.copy)
    published = Gloersen2016Options()
    return [
        [
            mean_distance(clip, gone, method, replace(published, **{name: value}))
            for method in METHODS
        ]
        for name, values in VALUES.items()
        for value in values
    ]


def main() -> int:
    """Print the figure's curves."""
    parser = options(__doc__, recording=RECORDING, full=f"{MANY} copies instead of {FEW}")
    arguments = parser.parse_args()
    file = recording(arguments)
    copies = MANY if arguments.full else FEW
    print_data(file, f"{copies} copies with random gaps in {SHARE:.0%} of the frames")
    found = np.array(in_processes(errors, [Case(file, copy) for copy in range(copies)]))
    rows: list[list[Cell]] = []
    where = 0
    for name, values in VALUES.items():
        for value in values:
            row: list[Cell] = [NAMES[name], f"{value:g}"]
            for j in range(len(METHODS)):
                row += quartiles(found[:, where, j])
            rows.append([*row, "chosen" if value == getattr(Gloersen2016Options(), name) else None])
            where += 1
    print_table(
        "Medians over copies of the mean error in mm",
        ["constant", "value", *(h for name in METHODS for h in (name, "quartiles")), "paper"],
        rows,
    )
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
