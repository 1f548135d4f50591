#!/usr/bin/env python
"""Gløersen and Federolf 2016, figure 4: random copies of a recording, filled by several methods.

    python scripts/papers/gloersen_fig4.py [--data DIR] [--recording FILE] [--full]

Interpretation: in each copy (20, ``--full``: 50) random markers are missing at random times until
a share of the frames lacks a marker; the error of a copy is the mean distance over its removed
samples, and a method's is the median over the copies. Lengths of gaps are those of the published
patterns, 0.1 to 2 s. The medians of the paper are known, but not at which share of the frames, so
they are printed for each share. The abstract states at most 3 mm for gaps in up to 70 % of the
frames. ``lds``, which takes seconds, fills four copies of each share unless ``--full``.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from gloersen import (
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

SHARES = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Of the frames."""

PAPER = {"r2": 1.7, "r1": 2.1, "lds": 6.5, "spline": 116.0}
"""mm. Medians of the paper; ``lds`` is the linear dynamical system of DynaMMo."""

SLOW = {"lds": 4}
"""Copies filled by slow methods without ``--full``."""

UPPER, UP_TO = 3.0, 0.7
"""mm, share of the frames: the paper's abstract."""

FEW, MANY = 20, 50
"""Copies."""


@dataclass(frozen=True)
class Case:
    """A copy of a recording."""

    file: Path
    share: float
    copy: int
    methods: tuple[str, ...]


def errors(case: Case) -> list[float]:
    """Return the mean error (mm) of each method; NaN where it leaves samples missing."""
    clip = read(case.file)
    gone = runs_in_frames(clip, case.share, case.copy)
    return [
        mean_distance(clip, gone, method) if method in case.methods else float("nan")
        for method in PAPER
    ]


def _methods(copy: int, *, full: bool) -> tuple[str, ...]:
    """Return the methods that fill a copy."""
    return tuple(name for name in PAPER if full or copy < SLOW.get(name, FEW))


def main() -> int:
    """Print the figure's medians and quartiles."""
    parser = options(__doc__, recording=RECORDING, full=f"{MANY} copies instead of {FEW}")
    arguments = parser.parse_args()
    file = recording(arguments)
    copies = MANY if arguments.full else FEW
    print_data(file, f"{copies} copies for each share of the frames")
    cases = [
        Case(file, share, copy, _methods(copy, full=arguments.full))
        for share in SHARES
        for copy in range(copies)
    ]
    found = np.array(in_processes(errors, cases)).reshape(len(SHARES), copies, len(PAPER))
    rows: list[list[Cell]] = []
    for i, share in enumerate(SHARES):
        for j, (method, paper) in enumerate(PAPER.items()):
            known = int(np.isfinite(found[i, :, j]).sum())
            if known:
                middle, between = quartiles(found[i, :, j])
                rows.append([f"{share:.0%}", method, known, middle, between, paper])
    print_table(
        "Medians over copies of the mean error in mm, by share of the frames with gaps",
        ["share", "method", "copies", "median", "quartiles", "paper"],
        rows,
    )
    medians = [quartiles(found[i, :, 0])[0] for i, share in enumerate(SHARES) if share <= UP_TO]
    print(
        f"r2 in up to {UP_TO:.0%} of the frames: medians up to {max(medians):.1f} mm "
        f"(paper: {UPPER:g} mm at most)"
    )
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
