#!/usr/bin/env python
"""Li, Yu, Kieu, Vuong and Zhang 2020, table 2: gaps of 100 frames by their number.

    python scripts/papers/li_table2.py [--data DIR] [--recording FILE]
        [--training DIR] [--methods NAME,NAME...]

One to eight of 15 markers are missing for 100 frames from frame 101 on. The paper has values of
Eq. (4) alone.
"""

from __future__ import annotations

import sys

from li import (
    METHODS_OF_TABLE_1,
    OURS,
    PAPER,
    EvenGaps,
    by_case,
    evaluated,
    material,
    parser_of,
    print_data,
    refusals,
)

from priorfill.cli.encoding import replace_what_is_lacking

LENGTH = 100
"""Frames of a gap."""

PUBLISHED = {1: "1.2831", 2: "2.9079", 3: "3.1031", 5: "3.9479", 8: "5.7161"}
"""The paper's values of Eq. (4) by the number of gaps."""


def main() -> int:
    """Print the table."""
    arguments = parser_of(__doc__, [*METHODS_OF_TABLE_1.values(), OURS]).parse_args()
    some = material(arguments)
    print_data(some, PAPER)
    found = evaluated(some, EvenGaps(tuple(PUBLISHED), (LENGTH,)), arguments.methods)
    method = METHODS_OF_TABLE_1["Eq. (4)"]
    comparison = by_case(
        found,
        f"MAE in mm by the number of gaps of {LENGTH} frames (the paper's value)",
        "gaps",
        {f"{number} x {LENGTH}": str(number) for number in PUBLISHED},
        {(f"{number} x {LENGTH}", method): value for number, value in PUBLISHED.items()},
    )
    comparison.print()
    refusals(found)
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
