#!/usr/bin/env python
"""Baumann et al. 2011, figure 3: error by marker, each missing in turn.

    python scripts/papers/baumann_fig3.py [--data DIR] [--recording FILE] [--full]

Each of the 41 markers is removed from the middle of a recording and filled with a database of all
other recordings. Means over a few recordings (``--full``: over one of each motion).
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from baumann import METHODS, RECORDING, Take, database_of, examples, library, middle, print_data
from paper import error, in_processes, method_alone, options, print_table

import priorfill as pf
from priorfill.cli.encoding import replace_what_is_lacking
from priorfill.markers.definitions import load

FEW = ("sneak2StepsLStart", "throwBasketball")
"""Motions filled without ``--full``: one of legs, one of arms."""


@dataclass(frozen=True)
class Case:
    """A recording and a marker of it."""

    take: Take
    marker: str
    database: Path


def errors(case: Case) -> list[float]:
    """Return the error (mm) of each method; NaN where the recording lacks the marker."""
    truth = pf.read(case.take.file)
    if case.marker not in truth.labels:
        return [float("nan")] * len(METHODS)
    gappy = middle(truth, [case.marker])
    others = method_alone(pf.Selection(not_names=(case.take.file.stem,)))
    return [
        error(
            pf.fill(gappy, database=case.database, method=method, options=others).clip,
            truth,
            gappy,
        )
        for method in METHODS
    ]


def main() -> int:
    """Print the figure."""
    parser = options(__doc__, recording=RECORDING, full="fill a recording of each motion")
    arguments = parser.parse_args()
    takes = library(arguments.data)
    filled = examples(takes, arguments.recording, full=False)
    if not arguments.full and arguments.recording is None:
        filled = [take for take in filled if take.motion in FEW] or filled[:2]
    print_data(takes, filled, arguments.recording)
    marker_set = load("baumann41")
    with database_of(takes) as database:
        cases = [Case(take, marker, database) for marker in marker_set.labels for take in filled]
        found = np.array(in_processes(errors, cases))
    found = found.reshape(len(marker_set.labels), len(filled), len(METHODS))
    by_marker = np.nanmean(found, axis=1)
    reliable = np.array([marker_set.reliable[label] for label in marker_set.labels])
    rows = [
        [label, "yes" if reliable[i] else "no", *map(float, by_marker[i]), None]
        for i, label in enumerate(marker_set.labels)
    ]
    rows += [
        ["mean", text, *map(float, by_marker[which].mean(axis=0)), None]
        for text, which in (("yes", reliable), ("no", ~reliable))
    ]
    print_table(
        "Mean error in mm of a marker missing by itself (paper: plot only)",
        ["marker", "reliable", *METHODS, "paper"],
        rows,
    )
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
