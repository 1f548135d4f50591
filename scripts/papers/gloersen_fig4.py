#!/usr/bin/env python
"""Gløersen and Federolf 2016, figure 4: random copies of three recordings, by several methods.

    python scripts/papers/gloersen_fig4.py [--data DIR] [--recording FILE] [--copies N] [--full]

Each of 50 copies of WalkL has 5 to 15 gaps of 20 to 480 frames, of random markers at random times;
those of WalkRun and CP-gait have 2 to 6 gaps of 20 to 120 frames (stand-ins: gaps of the same
durations). The error of a copy is the mean distance over its removed samples; a method's is the
median over the copies. The paper's copies are not published; the interval of a median is that of
95 % of the medians of as many copies drawn again from ours. The paper's DynaMMo is the linear
dynamical system that ``lds`` is. ``gpr``, which the paper does not have, learns from the same
frames. Both take seconds for a copy of WalkL, and fill 10 copies unless ``--full``.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from gloersen import (
    RECORDING,
    SEED,
    Sample,
    mean_distance,
    print_data,
    quartiles,
    random_gaps,
    samples,
)
from numpy.typing import NDArray
from paper import Cell, Comparison, in_processes, options, print_table

from priorfill.cli.encoding import replace_what_is_lacking

PAPER = {
    "WalkL": {"r1": "2.1", "r2": "1.7", "lds": "6.5", "spline": "116"},
    "WalkRun": {"r1": "10.0", "r2": "5.1", "lds": "32", "spline": "46"},
    "CP-gait": {"r1": "10.5", "r2": "5.1", "lds": "24", "spline": "12.5"},
}
"""mm. Medians."""

WORST = {"WalkL": "3", "WalkRun": "29", "CP-gait": "21"}
"""mm. Largest error of r2."""

METHODS = ("r1", "r2", "lds", "spline", "gpr")

SLOW = ("lds", "gpr")
"""Methods that fill fewer copies."""

COPIES, FEW = 50, 10
"""Copies of each recording, and those of slow methods."""

DRAWN = 2000
"""Times that as many copies are drawn again."""

INTERVAL = (2.5, 97.5)
"""Percentiles that enclose 95 % of the medians."""


@dataclass(frozen=True)
class Case:
    """A copy of a recording."""

    sample: Sample
    copy: int
    methods: tuple[str, ...]


def errors(case: Case) -> list[float]:
    """Return the share of the frames with gaps, and the mean error (mm) of each method.

    NaN for methods that do not fill this copy, or leave samples missing.
    """
    clip = case.sample.clip
    gone = random_gaps(case.sample, case.copy)
    share = float(gone.any(axis=1).mean())
    return [
        share,
        *(
            mean_distance(clip, gone, method) if method in case.methods else float("nan")
            for method in METHODS
        ),
    ]


def interval(values: NDArray[np.float64]) -> str:
    """Return 95 % of the medians of as many values drawn again, as text."""
    again = np.random.default_rng(SEED).choice(values, (DRAWN, len(values)))
    low, high = np.percentile(np.median(again, axis=1), INTERVAL)
    return f"{low:.1f}-{high:.1f}"


def main() -> int:
    """Print the figure's medians and quartiles."""
    parser = options(__doc__, recording=RECORDING, full="all copies by all methods")
    parser.add_argument("--copies", type=int, default=COPIES, help="copies of each recording")
    arguments = parser.parse_args()
    chosen = samples(arguments)
    print_data(chosen)
    quick = tuple(method for method in METHODS if method not in SLOW)
    cases = [
        Case(sample, copy, METHODS if arguments.full or copy < FEW else quick)
        for sample in chosen
        for copy in range(arguments.copies)
    ]
    found = np.array(in_processes(errors, cases)).reshape(len(chosen), arguments.copies, -1)
    compared = Comparison()
    rows: list[list[Cell]] = []
    for sample, values in zip(chosen, found, strict=True):
        for method, column in zip(METHODS, values[:, 1:].T, strict=True):
            known = column[np.isfinite(column)]
            paper = PAPER[sample.motion.name].get(method)
            if len(known):
                middle, between = quartiles(known)
                ends, around = f"{known.min():.1f}-{known.max():.1f}", interval(known)
                rows.append([sample.name, method, len(known), middle, around, between, ends, paper])
                if paper:
                    reason = sample.why or f"other copies; 95 % interval of the median {around}"
                    compared.add(f"{sample.name} {method}", middle, paper, reason)
    print_table(
        "Mean error in mm of copies with random gaps (* stand-in)",
        ["data", "method", "copies", "median", "95 %", "quartiles", "range", "paper"],
        rows,
    )
    _print_worst(chosen, found)
    compared.print()
    return 0


def _print_worst(chosen: list[Sample], found: NDArray[np.float64]) -> None:
    """Print the largest errors of r2, and how many frames have gaps."""
    rows: list[list[Cell]] = []
    column = 1 + METHODS.index("r2")
    for sample, values in zip(chosen, found, strict=True):
        low, middle, high = np.nanpercentile(values[:, 0], (0, 50, 100))
        largest, paper = float(np.nanmax(values[:, column])), WORST[sample.motion.name]
        below = int((values[:, column] <= float(paper)).sum())
        frames = f"{low:.0%} to {high:.0%}, median {middle:.0%}"
        rows.append([sample.name, frames, largest, paper, f"{below} of {len(values)}"])
    print_table(
        "Frames with gaps; largest error of r2 in mm; copies up to the paper's largest",
        ["data", "frames with gaps", "largest", "paper", "copies"],
        rows,
    )


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
