#!/usr/bin/env python
"""Li, Yu, Kieu, Vuong and Zhang 2020, figure 9: gaps of 30 frames by the number of markers.

    python scripts/papers/li_fig9.py [--data DIR] [--recording FILE]
        [--training DIR] [--methods NAME,NAME...]

One to all of 15 markers are missing for 30 frames from frame 101 on. The paper has a plot, of
Eq. (4) for some and of Eq. (16) for all markers.
"""

from __future__ import annotations

import sys

from li import (
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

METHODS = ("pca-pieces", "pca-frames", "pma", "linear", OURS)

LENGTH = 30
"""Frames of a gap."""

NUMBERS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 15)
"""Markers."""


def main() -> int:
    """Print the figure."""
    arguments = parser_of(__doc__, METHODS).parse_args()
    some = material(arguments)
    print_data(some, PAPER)
    markers = len(some.samples[0].labels)
    numbers = tuple(dict.fromkeys(min(number, markers) for number in NUMBERS))
    found = evaluated(some, EvenGaps(numbers, (LENGTH,)), arguments.methods)
    by_case(
        found,
        f"MAE in mm by the number of markers missing for {LENGTH} frames (paper: plot only)",
        "markers",
        {f"{number} x {LENGTH}": str(number) for number in numbers},
    )
    refusals(found)
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
