#!/usr/bin/env python
"""Li, Yu, Kieu, Vuong and Zhang 2020, table 1 (and figure 3): five gaps by their length.

    python scripts/papers/li_table1.py [--data DIR] [--recording FILE]
        [--training DIR] [--methods NAME,NAME...]

Five of 15 markers are missing for 20, 50, 80 and 100 frames from frame 101 on. The second table has
the equations and options of the paper that are not the default, and what Eq. (4) gives where the
missing frames themselves are among the training data; the third has the longest gaps by recording.
"""

from __future__ import annotations

import sys
from typing import Any

from li import (
    METHODS_OF_TABLE_1,
    OURS,
    PAPER,
    EvenGaps,
    by_case,
    by_recording,
    evaluated,
    filled_by,
    material,
    parser_of,
    print_data,
    refusals,
)
from paper import Cell, print_table

from priorfill.cli.encoding import replace_what_is_lacking

MARKERS = 5
LENGTHS = (20, 50, 80, 100)
"""Gaps, and frames of each."""

PUBLISHED: dict[str, tuple[str, ...]] = {
    "WPCA": ("2.6125", "11.3295", "15.3370", "17.7271"),
    "LGRNN": ("3.5361", "12.4654", "14.8164", "15.5710"),
    "GLR": ("3.9057", "9.5267", "11.1776", "11.9146"),
    "LPR": ("21.1284", "25.1179", "28.3632", "29.1967"),
    "LI": ("4.1168", "10.7123", "12.1057", "12.1030"),
    "PMA": ("7.4004", "17.1423", "18.6547", "19.1778"),
    "Eq. (4)": ("2.7312", "3.6110", "3.9816", "4.0601"),
}

VARIANTS: dict[str, dict[str, Any]] = {
    "Eqs. (1)-(4), pca-pieces": {},
    "  mask=entries": {"mask": "entries"},
    "  scale_sources=true": {"scale_sources": True},
    "  truth among the training data": {"truth": True},
    "  truth and nothing else": {"truth": True, "max_windows": 1},
    "one basis, pca-train": {"method": "pca-train"},
    "Eqs. (5)-(8), over=frames": {"over": "frames"},
}
"""Options of `filled_by`."""


def main() -> int:
    """Print the table."""
    arguments = parser_of(__doc__, [*METHODS_OF_TABLE_1.values(), OURS]).parse_args()
    some = material(arguments)
    print_data(some, PAPER)
    protocol = EvenGaps((MARKERS,), LENGTHS)
    found = evaluated(some, protocol, arguments.methods)
    entries = {f"{MARKERS} x {length}": str(length) for length in LENGTHS}
    published = {
        (case, METHODS_OF_TABLE_1[name]): value
        for name, values in PUBLISHED.items()
        for case, value in zip(entries, values, strict=True)
    }
    comparison = by_case(
        found,
        f"MAE in mm of {MARKERS} markers by the frames of their gaps (the paper's value)",
        "frames",
        entries,
        published,
    )
    rows: list[list[Cell]] = []
    for name, changed in VARIANTS.items():
        errors = filled_by(some, protocol, **{"method": "pca-pieces", **changed})
        rows.append([name, *(errors[case] for case in entries)])
    print_table("MAE in mm of the paper's equations and options", ["", *entries.values()], rows)
    by_recording(found, list(entries)[-1])
    comparison.print()
    refusals(found)
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
