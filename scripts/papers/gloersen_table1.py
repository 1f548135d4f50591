#!/usr/bin/env python
"""Gløersen and Federolf 2016, table 1: one marker missing in a share of the frames.

    python scripts/papers/gloersen_table1.py [--data DIR] [--recording FILE] [--full]

Interpretation: one marker at a time is missing in one run of frames, placed at random; its error
is the mean distance, over some copies (3, ``--full``: 50). With one marker missing r1 and r2 are
the same. Of the paper's values, only the range of the 90 % column is available.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from gloersen import (
    RECORDING,
    mean_distance,
    one_run,
    print_data,
    quartiles,
    read,
    recording,
    spread,
)
from paper import Cell, in_processes, options, print_table

from priorfill.cli.encoding import replace_what_is_lacking

SHARES = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Shares of the frames. The paper's column of the last one is available."""

PAPER = {0.9: "2-5"}
"""mm."""

UPPER = 5.0
"""mm. The paper's upper end at 90 %."""

FEW, MANY = 3, 50
"""Copies."""


@dataclass(frozen=True)
class Case:
    """A marker that is missing."""

    file: Path
    marker: int
    copies: int


def errors(case: Case) -> list[float]:
    """Return a marker's mean error (mm) for each share; NaN if there is no room for it."""
    clip = read(case.file)
    found = []
    for share in SHARES:
        runs = [one_run(clip, case.marker, share, copy) for copy in range(case.copies)]
        found.append(
            np.mean(
                [mean_distance(clip, gone, "r2") for gone in runs if gone is not None] or [np.nan]
            )
        )
    return [float(value) for value in found]


def main() -> int:
    """Print the table."""
    parser = options(__doc__, recording=RECORDING, full=f"{MANY} copies instead of {FEW}")
    arguments = parser.parse_args()
    file = recording(arguments)
    clip = read(file)
    copies = MANY if arguments.full else FEW
    print_data(file, f"{copies} runs of each marker and share")
    cases = [Case(file, marker, copies) for marker in range(len(clip.labels))]
    found = np.array(in_processes(errors, cases))
    rows: list[list[Cell]] = [[label, *map(float, found[i])] for i, label in enumerate(clip.labels)]
    print_table(
        "Mean error in mm by marker and share of the frames in which it is missing (r2)",
        ["marker", *(f"{share:.0%}" for share in SHARES)],
        rows,
    )
    print_table(
        "All markers (mm)",
        ["missing", "median", "central 90 %", "paper"],
        [
            [f"{share:.0%}", quartiles(found[:, i])[0], spread(found[:, i]), PAPER.get(share)]
            for i, share in enumerate(SHARES)
        ],
    )
    last = found[np.isfinite(found[:, -1]), -1]
    within = int((last <= UPPER).sum())
    print(f"{within} of {len(last)} markers are within {UPPER:g} mm at {SHARES[-1]:.0%}")
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
