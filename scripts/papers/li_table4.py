#!/usr/bin/env python
"""Li, Yu, Kieu, Vuong and Zhang 2020, table 4: repeated gaps in some markers.

    python scripts/papers/li_table4.py [--data DIR] [--recording FILE] [--full]
        [--training DIR] [--methods NAME,NAME...]

Interpretation (the text of the paper is not available): the programs ``T0`` and ``F0`` fill pieces
of 100 frames under masks called ``interval2``, ``interval10`` and ``interval25``, which are not
published. Here a third of the markers, drawn for each sample, are alternately missing and visible
for equal numbers of frames (the protocol ``periodic``).
"""

from __future__ import annotations

import sys

from li import PIECE, RATE, Several, by_part, evaluated, material, parser_of, print_data, refusals

from priorfill.cli.encoding import replace_what_is_lacking
from priorfill.evaluation.protocols import PeriodicGaps

INTERVALS = (2, 10, 25)
"""Frames."""

SHARE = 3
"""One in this many markers is missing."""

FEW, MANY = 2, 5
"""Copies of each sample, with other markers missing."""


def main() -> int:
    """Print the table."""
    parser = parser_of(__doc__, full=f"all samples, {MANY} copies of each instead of {FEW}")
    arguments = parser.parse_args()
    some = material(arguments).first(PIECE)
    print_data(some, "frames 301-400 of Maju Undur, 451-550 of fastsong7 (Malay dances, 30 Hz).")
    number = max(1, len(some.samples[0].labels) // SHARE)
    protocols = {
        str(frames): PeriodicGaps(
            copies=MANY if arguments.full else FEW,
            number=(number, number),
            seconds=(frames / RATE, frames / RATE),
            period=2 * frames / RATE,
        )
        for frames in INTERVALS
    }
    found = evaluated(some, Several(protocols), arguments.methods)
    by_part(
        found,
        "case",
        f"MAE in mm of {number} markers by the frames of each of their gaps",
        "frames",
        together=False,
    )
    refusals(found)
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
