#!/usr/bin/env python
"""Li, Yu, Kieu, Vuong and Zhang 2020, figure 8: complete frames missing.

    python scripts/papers/li_fig8.py [--data DIR] [--recording FILE]
        [--training DIR] [--methods NAME,NAME...]

Every marker is missing at once, for 1 to 80 of 200 frames, from frame 101 on. The paper has a plot,
and in the text that Eq. (16) recovers blanks below 20 % of the frames. Methods that need a visible
marker in each frame fill nothing and are not run by default. The paper does not state the weights W
of measured frames; the second table has equal ones, and ones that fall with the time.
"""

from __future__ import annotations

import sys

from li import (
    OURS,
    PAPER,
    SAMPLE,
    EvenGaps,
    by_case,
    evaluated,
    filled_by,
    material,
    parser_of,
    print_data,
    refusals,
)
from paper import Cell, print_table

from priorfill.cli.encoding import replace_what_is_lacking

METHODS = ("pca-frames", "linear", "spline", "lds", OURS)

MISSING = (1, 2, 5, 10, 20, 30, 40, 60, 80)
"""Frames."""

SIGMAS: dict[str, float | None] = {"equal": None, "frame_sigma=0.5": 0.5}
"""Weights of measured frames: σ relative to the number of missing frames."""


def main() -> int:
    """Print the figure."""
    arguments = parser_of(__doc__, METHODS).parse_args()
    some = material(arguments)
    print_data(some, PAPER)
    markers = len(some.samples[0].labels)
    protocol = EvenGaps((markers,), MISSING)
    entries = {f"{markers} x {frames}": f"{frames} ({frames / SAMPLE:.1%})" for frames in MISSING}
    found = evaluated(some, protocol, arguments.methods)
    by_case(
        found,
        f"MAE in mm by the number of frames missing of {SAMPLE} (paper: plot only)",
        "frames",
        entries,
    )
    errors = [
        filled_by(some, protocol, "pca-frames", frame_sigma=sigma) for sigma in SIGMAS.values()
    ]
    rows: list[list[Cell]] = [
        [entry, *(some_errors[case] for some_errors in errors)] for case, entry in entries.items()
    ]
    print_table("MAE in mm of pca-frames by the weights of frames", ["frames", *SIGMAS], rows)
    refusals(found)
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
