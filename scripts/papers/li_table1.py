#!/usr/bin/env python
"""Li, Yu, Kieu, Vuong and Zhang 2020, table 1: the test samples, one marker missing.

    python scripts/papers/li_table1.py [--data DIR] [--recording FILE] [--full]
        [--training DIR] [--methods NAME,NAME...]

Interpretation (the text of the paper is not available): the program's ``test4data`` compares the
methods with r2 on twenty samples of 130 frames of a dance each, with the mask ``1_100f_100g``,
taken as one marker missing from frame 101 on, drawn for each sample (``--full``: five). Means by
method are printed over distances, as in ``mae.m``, and over coordinates, as in ``priorfill
evaluate``, with the CPU time per sample, since the abstract calls the methods fast.
"""

from __future__ import annotations

import sys

from li import (
    COMPLETE_FRAMES,
    UNKNOWN,
    Onward,
    by_part,
    cell,
    evaluated,
    material,
    parser_of,
    print_data,
    refusals,
    seconds,
)
from paper import Cell, print_table

from priorfill.cli.encoding import replace_what_is_lacking

GAP = 30
"""Frames from frame 101 on."""

COPIES = 5
"""Markers of each sample that are missing in turn."""


def main() -> int:
    """Print the table."""
    parser = parser_of(__doc__, full=f"{COPIES} markers of each sample in turn")
    arguments = parser.parse_args()
    some = material(arguments, few=None).first(COMPLETE_FRAMES + GAP)
    print_data(
        some, "the first 130 frames of twenty Malay dances (test_Les.txt, test_Taksim.txt, ...)."
    )
    protocol = Onward(copies=COPIES if arguments.full else 1)
    found = evaluated(some, protocol, arguments.methods)
    by_part(found, "clip", f"MAE in mm of one marker missing in the last {GAP} frames")
    rows: list[list[Cell]] = [
        [
            method,
            cell(found, method),
            None,
            found.methods[method].errors.mae,
            None,
            seconds(found, method),
            None,
        ]
        for method in found.plan.methods
    ]
    print_table(
        f"The same by method ({UNKNOWN})",
        ["method", "by distances", "paper", "by coordinates", "paper", "CPU s", "paper"],
        rows,
    )
    refusals(found)
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
