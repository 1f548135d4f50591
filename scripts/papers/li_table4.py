#!/usr/bin/env python
"""Li, Yu, Kieu, Vuong and Zhang 2020, table 4: running times.

    python scripts/papers/li_table4.py [--data DIR] [--recording FILE]
        [--training DIR] [--methods NAME,NAME...]

CPU time of a fill of one sample with five gaps of 100 frames. Eq. (4) learns from 500 to 2500
training frames, which are read from a database; the other methods learn from the sample alone. The
paper does not state its computer.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from li import (
    METHODS_OF_TABLE_1,
    PAPER,
    SAMPLE,
    EvenGaps,
    Material,
    database_of,
    material,
    parser_of,
    print_data,
)
from paper import Cell, Comparison, method_alone, print_table

import priorfill as pf
from priorfill.cli.encoding import replace_what_is_lacking

EQUATION_4 = {
    500: "146.6",
    800: "151.1",
    1000: "177.7",
    1500: "228.1",
    2000: "257.5",
    2500: "273.2",
}
"""The paper's times (ms) by the frames of the training data."""

WITHOUT_TRAINING = {
    "WPCA": "67.0",
    "GLR": "105.5",
    "LGRNN": "261.8",
    "LI": "82.5",
    "LPR": "53.5",
    "PMA": "452.2",
}

REPEATS = 3
"""Fills; the fastest one counts."""

COMPUTER = "another computer"
"""Why times differ."""


def seconds_of(gappy: pf.Clip, method: str, database: Path | None, **changed: object) -> float:
    """Return the CPU time of a fill (ms)."""
    options = replace(method_alone(), method_options=changed)
    taken = []
    for _ in range(REPEATS):
        begin = time.process_time()
        pf.fill(gappy, method=method, database=database, options=options)
        taken.append(time.process_time() - begin)
    return 1000.0 * min(taken)


def training_of(training: Sequence[pf.Clip], sample: pf.Clip, frames: int) -> list[pf.Clip]:
    """Return stretches with some frames together, without the sample."""
    chosen: list[pf.Clip] = []
    left = frames
    for clip in training:
        if clip.name != sample.name and left > 0:
            chosen.append(clip.with_positions(clip.positions[:left]))
            left -= clip.frames
    return chosen


def times(some: Material, methods: Sequence[str]) -> list[tuple[str, float, str]]:
    """Return rows of what was run, our time, and the paper's (ms)."""
    sample = some.samples[0]
    [(_, gappy)] = EvenGaps((5,), (100,)).copies(sample)
    found = []
    equation_4 = METHODS_OF_TABLE_1["Eq. (4)"]
    for frames, paper in EQUATION_4.items() if equation_4 in methods else ():
        chosen = training_of(some.training, sample, frames)
        if sum(clip.frames for clip in chosen) < frames:
            break
        windows = -(-frames // SAMPLE)
        with database_of(chosen) as path:
            taken = seconds_of(gappy, equation_4, path, max_windows=windows)
        found.append((f"{equation_4}, {frames} frames", taken, paper))
    found += [
        (method, seconds_of(gappy, method, None), paper)
        for name, paper in WITHOUT_TRAINING.items()
        if (method := METHODS_OF_TABLE_1[name]) in methods
    ]
    return found


def main() -> int:
    """Print the table."""
    arguments = parser_of(__doc__, METHODS_OF_TABLE_1.values()).parse_args()
    some = material(arguments)
    print_data(some, PAPER)
    found = times(some, [name.strip() for name in arguments.methods.split(",")])
    rows: list[list[Cell]] = [[name, taken, float(paper)] for name, taken, paper in found]
    print_table("CPU milliseconds of a fill", ["method", "ours", "paper"], rows)
    comparison = Comparison("ms")
    for name, taken, paper in found:
        comparison.add(name, taken, paper, COMPUTER)
    comparison.print()
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
