#!/usr/bin/env python
"""Gløersen and Federolf 2016, table 1: one marker missing in one long gap.

    python scripts/papers/gloersen_table1.py [--data DIR] [--recording FILE]

One marker at a time is missing in one gap: at the transition from walking to running or in the
middle of the recording, in its last half, or in all frames but the first 430 of WalkL. Frames of
stand-ins are the same shares of their length. The error is the mean distance. With one marker
missing r1 and r2 are the same. ``gpr``, which the paper does not have, learns from the same frames.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from gloersen import (
    CP_GAIT,
    RECORDING,
    WALKL,
    WALKRUN,
    Motion,
    Sample,
    marker_of,
    mean_distance,
    print_data,
    samples,
)
from paper import Cell, Comparison, in_processes, options, print_table

from priorfill.cli.encoding import replace_what_is_lacking


@dataclass(frozen=True)
class Gap:
    """A gap of the paper, and its errors.

    Attributes
    ----------
    motion : Motion
        The motion.
    name : str
        The paper's name of the gap.
    frames : (int, int)
        First and last frame, counted from 1.
    of : int
        Frames of the recording.
    errors : mapping of str to str
        The paper's, in mm, by marker.
    """

    motion: Motion
    name: str
    frames: tuple[int, int]
    of: int
    errors: dict[str, str]


GAPS = (
    Gap(CP_GAIT, "middle", (250, 349), 600, {"LKNE": "6", "LSHO": "8", "LWRA": "18"}),
    Gap(CP_GAIT, "last half", (301, 600), 600, {"LKNE": "14", "LSHO": "13", "LWRA": "28"}),
    Gap(WALKRUN, "transition", (150, 249), 400, {"LKNE": "10", "LSHO": "4", "LWRA": "20"}),
    Gap(WALKRUN, "last half", (201, 400), 400, {"LKNE": "25", "LSHO": "15", "LWRA": "36"}),
    Gap(WALKL, "last 90 %", (431, 4300), 4300, {"LKNE": "4", "LSHO": "2", "LWRA": "5"}),
)

OURS = ("r2", "gpr")
"""Methods, that of the paper first."""


@dataclass(frozen=True)
class Case:
    """A marker that is missing in a gap."""

    sample: Sample
    gap: Gap
    marker: str


def errors(case: Case) -> list[float]:
    """Return the mean error (mm) of each method; NaN where there is no such marker."""
    clip = case.sample.clip
    marker = marker_of(clip, case.marker)
    if marker is None:
        return [float("nan")] * len(OURS)
    first, last = (round(frame / case.gap.of * clip.frames) for frame in case.gap.frames)
    gone = np.zeros(clip.missing.shape, dtype=bool)
    gone[first - 1 : last, marker] = ~clip.missing[first - 1 : last, marker]
    return [mean_distance(clip, gone, method) for method in OURS]


def main() -> int:
    """Print the table."""
    arguments = options(__doc__, recording=RECORDING).parse_args()
    chosen = samples(arguments)
    print_data(chosen)
    cases = [
        Case(sample, gap, marker)
        for gap in GAPS
        for sample in chosen
        if sample.motion == gap.motion
        for marker in gap.errors
    ]
    compared = Comparison()
    rows: list[list[Cell]] = []
    for case, found in zip(cases, in_processes(errors, cases), strict=True):
        paper = case.gap.errors[case.marker]
        rows.append([case.sample.name, case.gap.name, case.marker, paper, *found])
        cell = f"{case.sample.name} {case.gap.name} {case.marker}"
        compared.add(cell, found[0], paper, case.sample.why)
    print_table(
        "Mean error in mm of one missing marker (* stand-in)",
        ["data", "gap", "marker", "paper", *OURS],
        rows,
    )
    compared.print()
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
