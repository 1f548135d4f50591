#!/usr/bin/env python
"""Li, Yu, Kieu, Vuong and Zhang 2020, table 3: by number of missing markers.

    python scripts/papers/li_table3.py [--data DIR] [--recording FILE] [--full]
        [--training DIR] [--methods NAME,NAME...]

Interpretation (the text of the paper is not available): the program's ``test_marker_num`` fills
samples of 200 frames in which 1 to 14 of 15 markers are missing, by masks that are not published.
Here they are missing from frame 101 on; they are drawn for each sample, and those of a row are
missing in the next row too.
"""

from __future__ import annotations

import sys

from li import Onward, by_part, evaluated, material, parser_of, print_data, refusals

from priorfill.cli.encoding import replace_what_is_lacking

NUMBERS = (1, 2, 4, 6, 8, 10, 12, 14)
ALL_NUMBERS = tuple(range(1, 15))
"""Markers missing."""


def main() -> int:
    """Print the table."""
    parser = parser_of(__doc__, full="all samples, each number of markers")
    arguments = parser.parse_args()
    some = material(arguments)
    print_data(some, "the first 200 frames of twenty Malay dances, 1 to 14 of 15 markers missing.")
    protocol = Onward(numbers=ALL_NUMBERS if arguments.full else NUMBERS)
    found = evaluated(some, protocol, arguments.methods)
    by_part(
        found,
        "case",
        "MAE in mm by the number of markers missing in the last 100 frames",
        "markers",
        together=False,
    )
    refusals(found)
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
