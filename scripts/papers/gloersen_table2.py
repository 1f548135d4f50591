#!/usr/bin/env python
"""Gløersen and Federolf 2016, table 2: errors of WalkL by direction.

    python scripts/papers/gloersen_table2.py [--data DIR] [--recording FILE]

One marker at a time is missing in all frames but the first 430 (of a stand-in: the first tenth).
The error is the mean absolute difference along an axis: X anterior, Y mediolateral, Z vertical in
WalkL; the axes of the file in a stand-in. ``gpr``, which the paper does not have, learns from the
same frames.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from gloersen import (
    MARKERS,
    RECORDING,
    Sample,
    deviations,
    marker_of,
    print_data,
    recording,
)
from paper import Cell, Comparison, in_processes, options, print_table

from priorfill.cli.encoding import replace_what_is_lacking

PAPER = {"X": "31231221", "Y": "11241331", "Z": "11221121"}
"""mm. Figures of the paper by axis, in the order of the markers; each has one digit."""

FEDEROLF_2013 = 1.3
"""mm. How much larger the mean of all cells is with the method of Federolf 2013."""

SHOWN = 0.1
"""Share of the frames that show the marker."""

OURS = ("r2", "gpr")
"""Methods, that of the paper first."""


@dataclass(frozen=True)
class Case:
    """A marker that is missing."""

    sample: Sample
    marker: str
    method: str


def errors(case: Case) -> list[float]:
    """Return the mean absolute difference (mm) by axis, and the mean distance; or NaN."""
    clip = case.sample.clip
    marker = marker_of(clip, case.marker)
    nothing = [float("nan")] * (len(PAPER) + 1)
    if marker is None:
        return nothing
    gone = np.zeros(clip.missing.shape, dtype=bool)
    first = round(SHOWN * clip.frames)
    gone[first:, marker] = ~clip.missing[first:, marker]
    off = deviations(clip, gone, case.method)
    if off is None:
        return nothing
    return [*np.abs(off).mean(axis=0).tolist(), float(np.linalg.norm(off, axis=1).mean())]


def main() -> int:
    """Print the table."""
    arguments = options(__doc__, recording=RECORDING).parse_args()
    sample = recording(arguments)
    print_data([sample])
    cases = [Case(sample, marker, method) for method in OURS for marker in MARKERS]
    found = np.array(in_processes(errors, cases)).reshape(len(OURS), len(MARKERS), -1)
    compared = Comparison()
    rows: list[list[Cell]] = []
    for j, (axis, figures) in enumerate(PAPER.items()):
        rows.append([f"{axis} r2 (paper)"])
        for i, (marker, paper) in enumerate(zip(MARKERS, figures, strict=True)):
            rows[-1].append(f"{found[0, i, j]:.2f} ({paper})")
            compared.add(f"{axis} {marker}", float(found[0, i, j]), paper, sample.why)
    for j, name in enumerate((*PAPER, "distance")):
        rows.append([f"{name} gpr", *(f"{value:.2f}" for value in found[1, :, j])])
    rows.insert(len(PAPER), ["distance r2", *(f"{value:.2f}" for value in found[0, :, -1])])
    print_table("Mean absolute difference in mm by axis, and mean distance", ["", *MARKERS], rows)
    _print_means(found)
    compared.print()
    return 0


def _print_means(found: np.ndarray) -> None:
    """Print the means of all cells."""
    paper = np.mean([int(figure) for figures in PAPER.values() for figure in figures])
    rows: list[list[Cell]] = [["paper", f"{paper:.2f}"]]
    rows += [
        [method, f"{np.nanmean(found[i, :, : len(PAPER)]):.2f}"] for i, method in enumerate(OURS)
    ]
    rows.append(["Federolf 2013, from the paper's text", f"{paper + FEDEROLF_2013:.2f}"])
    print_table("Mean of the cells by axis (mm)", ["", "mean"], rows)


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
