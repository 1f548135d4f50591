#!/usr/bin/env python
"""Gløersen and Federolf 2016, table 2: errors by marker and axis.

    python scripts/papers/gloersen_table2.py [--data DIR] [--recording FILE] [--full]

The root mean square error of a marker along an axis, over all its removed samples, filled by r2.
How many markers are missing at once in the paper's table is not known, so both are printed: each
marker alone in a tenth of the frames, in one run at random (3 runs, ``--full``: 50); and the
patterns published with the paper (every fifth of 50, ``--full``: all), if they fit the recording,
otherwise random gaps in half of the frames. Of the paper's values, only the range is available.
Axes are those of the file.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from gloersen import (
    RECORDING,
    deviations,
    one_run,
    print_data,
    published,
    quartiles,
    read,
    recording,
    runs_in_frames,
    spread,
)
from numpy.typing import NDArray
from paper import in_processes, options, print_table

from priorfill.cli.encoding import replace_what_is_lacking
from priorfill.evaluation.gap_generator import Mask

PAPER = "1-4"
"""mm, by marker and axis."""

UPPER = 4.0
"""mm."""

EVERY = 5
"""Step between the patterns that are filled without ``--full``."""

ALONE = 0.1
"""Share of the frames in which a marker is missing alone."""

FEW, MANY = 3, 50
"""Runs of each marker alone."""

AXES = "xyz"

COPIES = 50
"""Random copies of recordings without published patterns."""

SHARE = 0.5
"""Share of the frames with gaps in these copies."""


@dataclass(frozen=True, eq=False)
class Case:
    """Samples removed from a recording."""

    file: Path
    gone: Mask


def squares(case: Case) -> NDArray[np.float64]:
    """Return samples and squared errors by axis of each marker [shape=(markers, 4)]."""
    found = np.zeros((case.gone.shape[1], 1 + len(AXES)))
    off = deviations(read(case.file), case.gone, "r2")
    if off is not None:
        marker = np.nonzero(case.gone)[1]
        np.add.at(found, marker, np.column_stack([np.ones(len(off)), off**2]))
    return found


def by_axis(cases: Sequence[Case]) -> tuple[NDArray[np.float64], int]:
    """Return root mean squares [shape=(markers, 3), mm], and the number of filled cases.

    NaN for markers that were removed in none of them.
    """
    results = np.array(in_processes(squares, cases))
    total = results.sum(axis=0)
    roots = np.full((len(total), len(AXES)), np.nan)
    some = total[:, 0] > 0
    roots[some] = np.sqrt(total[some, 1:] / total[some, :1])
    return roots, int((results[..., 0].sum(axis=1) > 0).sum())


def main() -> int:
    """Print the table."""
    parser = options(
        __doc__, recording=RECORDING, full=f"{MANY} runs of each marker, {COPIES} patterns"
    )
    arguments = parser.parse_args()
    file = recording(arguments)
    clip = read(file)
    runs = [
        one_run(clip, marker, ALONE, copy)
        for marker in range(len(clip.labels))
        for copy in range(MANY if arguments.full else FEW)
    ]
    patterns = published(file)
    kind = "published patterns" if patterns else f"copies with gaps in {SHARE:.0%} of the frames"
    patterns = patterns or [runs_in_frames(clip, SHARE, copy) for copy in range(COPIES)]
    patterns = patterns if arguments.full else patterns[::EVERY]
    alone, filled_runs = by_axis([Case(file, gone) for gone in runs if gone is not None])
    several, filled = by_axis([Case(file, gone) for gone in patterns])
    print_data(
        file,
        f"filled: {filled_runs} of {len(runs)} markers alone, {filled} of {len(patterns)} {kind}",
    )
    print_table(
        "Root mean square error in mm by marker and axis (r2; paper: not available by marker)",
        ["marker", *(f"{axis} alone" for axis in AXES), *(f"{axis} patterns" for axis in AXES)],
        [[label, *alone[i].tolist(), *several[i].tolist()] for i, label in enumerate(clip.labels)],
    )
    print_table(
        "All markers and axes (mm)",
        ["", "alone", "patterns", "paper"],
        [
            ["central 90 %", spread(alone), spread(several), PAPER],
            ["median", quartiles(alone)[0], quartiles(several)[0], None],
            ["maximum", float(np.nanmax(alone)), float(np.nanmax(several)), None],
            [f"within {UPPER:g} mm", _within(alone), _within(several), None],
        ],
    )
    return 0


def _within(values: NDArray[np.float64]) -> str:
    known = values[np.isfinite(values)]
    return f"{(known <= UPPER).mean():.0%}" if len(known) else "-"


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
