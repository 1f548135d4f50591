#!/usr/bin/env python
"""Baumann et al. 2011, figure 3: error by marker, each missing in turn.

    python scripts/papers/baumann_fig3.py [--data DIR] [--database DIR]

Each of the 41 markers is removed by itself from three takes, a walk, a jump and a cartwheel, and
filled from all other takes of the library. The paper's bars are in its plot only; its text has the
mean of each take. ``--database`` names a large library, such as ``priorfill db fetch hdm05`` makes.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from baumann import (
    LIKE_A_WALK,
    Example,
    PaperTake,
    choose,
    fill_by,
    gappy_of,
    opened,
    parser_of,
    print_data,
    reason,
    without,
)
from paper import Comparison, error, in_processes, print_table

import priorfill as pf
from priorfill.cli.encoding import replace_what_is_lacking
from priorfill.markers.definitions import load

METHODS = ("baumann2011",)
"""The method of the paper."""

TAKES = (
    PaperTake("walk", "HDM_bd_01-01_01_120", 650, 1100, LIKE_A_WALK),
    PaperTake("jump", "HDM_tr_01-05_01_120", 1000, 1350, ("01-05", "hopBothLegs", "2_run_")),
    PaperTake(
        "cartwheel", "HDM_tr_05-03_03_120", 2550, 3000, ("05-03", "kickLFront", "raise-up-both")
    ),
)
"""The takes of the paper's figures 3 and 4."""

PAPER = {"walk": "7.7", "jump": "12.7", "cartwheel": "18.1"}
"""mm. Mean over all markers, from the text."""


@dataclass(frozen=True)
class Case:
    """A take and a marker of it."""

    example: Example
    truth: pf.Clip
    marker: str
    library: Path


def errors(case: Case) -> list[float]:
    """Return the error (mm) of each method; NaN where the take lacks the marker."""
    if case.marker not in case.truth.labels:
        return [float("nan")] * len(METHODS)
    gappy = gappy_of(case.example, case.truth, [case.marker])
    filled = fill_by(case.library, gappy, without(case.example), METHODS)
    return [error(clip, case.truth, gappy) for clip in filled]


def main() -> int:
    """Print the figure."""
    markers = load("baumann41").labels
    with opened(parser_of(__doc__).parse_args()) as library:
        examples = choose(library, TAKES)
        print_data(library, examples)
        cases = [
            Case(example, library.truth(example.record), marker, library.path)
            for marker in markers
            for example in examples
        ]
        found = np.array(in_processes(errors, cases))
    found = found.reshape(len(markers), len(examples), len(METHODS))
    means = np.nanmean(found, axis=0)
    print_table(
        "Mean error in mm of a marker missing by itself, over all markers",
        ["take", *METHODS, "paper"],
        [
            [example.name, *map(float, mean), PAPER[example.take.motion]]
            for example, mean in zip(examples, means, strict=True)
        ],
    )
    reliable = load("baumann41").reliable
    print_table(
        f"The same by marker, {METHODS[0]} (paper: plot only)",
        ["marker", "reliable", *(example.take.motion for example in examples)],
        [
            [label, "yes" if reliable[label] else "no", *map(float, found[i, :, 0])]
            for i, label in enumerate(markers)
        ],
    )
    comparison = Comparison()
    for example, mean in zip(examples, means, strict=True):
        motion = example.take.motion
        comparison.add(motion, float(mean[0]), PAPER[motion], reason(example, library))
    comparison.print()
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
