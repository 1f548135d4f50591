#!/usr/bin/env python
"""Li, Yu, Kieu, Vuong and Zhang 2020, figure 8: complete frames missing.

    python scripts/papers/li_fig8.py [--data DIR] [--recording FILE]
        [--training DIR] [--methods NAME,NAME...]

Every marker is missing at once, for 1 to 80 of 200 frames, from frame 101 on. The paper has a plot,
and in the text that Eq. (16) recovers blanks below 20 % of the frames. Methods that need a visible
marker in each frame fill nothing and are not run by default.
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
    material,
    parser_of,
    print_data,
    refusals,
)

from priorfill.cli.encoding import replace_what_is_lacking

METHODS = ("pca-frames", "linear", "spline", "lds", OURS)

MISSING = (1, 2, 5, 10, 20, 30, 40, 60, 80)
"""Frames."""


def main() -> int:
    """Print the figure."""
    arguments = parser_of(__doc__, METHODS).parse_args()
    some = material(arguments)
    print_data(some, PAPER)
    markers = len(some.samples[0].labels)
    found = evaluated(some, EvenGaps((markers,), MISSING), arguments.methods)
    by_case(
        found,
        f"MAE in mm by the number of frames missing of {SAMPLE} (paper: plot only)",
        "frames",
        {f"{markers} x {frames}": f"{frames} ({frames / SAMPLE:.1%})" for frames in MISSING},
    )
    refusals(found)
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
