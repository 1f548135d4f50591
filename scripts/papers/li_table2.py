#!/usr/bin/env python
"""Li, Yu, Kieu, Vuong and Zhang 2020, table 2: one marker missing, by gap length.

    python scripts/papers/li_table2.py [--data DIR] [--recording FILE] [--full]
        [--training DIR] [--methods NAME,NAME...]

Interpretation (the text of the paper is not available): according to the program's readme,
``test4data`` is run with other data lengths to test longer gaps. One marker, drawn for each
sample, is missing from frame 101 on to the end of the sample, which is cut 10 to 100 frames later.
"""

from __future__ import annotations

import sys

from li import (
    COMPLETE_FRAMES,
    SAMPLE,
    Onward,
    by_experiment,
    evaluated,
    material,
    parser_of,
    print_data,
    refusals,
)

from priorfill.cli.encoding import replace_what_is_lacking

GAPS = (10, 30, 50, 75, SAMPLE - COMPLETE_FRAMES)
"""Frames."""

COPIES = 3
"""Markers of each sample that are missing in turn."""


def main() -> int:
    """Print the table."""
    parser = parser_of(__doc__, full=f"all samples, {COPIES} markers of each in turn")
    arguments = parser.parse_args()
    some = material(arguments)
    print_data(some, "twenty Malay dances (test_Les.txt, test_Taksim.txt, ...) at 30 Hz.")
    protocol = Onward(copies=COPIES if arguments.full else 1)
    found = {
        str(gap): evaluated(some.first(COMPLETE_FRAMES + gap), protocol, arguments.methods)
        for gap in GAPS
    }
    by_experiment(found, "frames", "MAE in mm of one marker by how many frames it is missing")
    for evaluation in found.values():
        refusals(evaluation)
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
