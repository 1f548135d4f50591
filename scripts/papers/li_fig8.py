#!/usr/bin/env python
"""Li, Yu, Kieu, Vuong and Zhang 2020, figure 8: complete frames missing.

    python scripts/papers/li_fig8.py [--data DIR] [--recording FILE] [--full]
        [--training DIR] [--methods NAME,NAME...]

Every marker is missing at once for 1 to 40 of 100 frames. The program ``F1`` has these gaps begin
at frame 51; here they are anywhere (the protocol ``frames``). Methods that need a visible marker
in each frame fill nothing and are not run by default; see ``--methods``.
"""

from __future__ import annotations

import sys

from li import PIECE, RATE, Several, by_part, evaluated, material, parser_of, print_data, refusals

from priorfill.cli.encoding import replace_what_is_lacking
from priorfill.evaluation.protocols import FrameGaps

METHODS = "pca-frames,linear,spline,lds,auto"

MISSING = (1, 2, 5, 10, 20, 30, 40)
MORE_MISSING = tuple(range(1, 41))
"""Frames."""

FEW, MANY = 3, 5
"""Copies of each sample, with the gap elsewhere."""


def main() -> int:
    """Print the figure."""
    parser = parser_of(__doc__, full="all samples, each number of frames", methods=METHODS)
    arguments = parser.parse_args()
    some = material(arguments).first(PIECE)
    print_data(some, "frames 301-400 of Maju Undur (a Malay dance, 30 Hz).")
    protocols = {
        str(frames): FrameGaps(
            copies=MANY if arguments.full else FEW, seconds=(frames / RATE, frames / RATE)
        )
        for frames in (MORE_MISSING if arguments.full else MISSING)
    }
    found = evaluated(some, Several(protocols), arguments.methods)
    by_part(
        found,
        "case",
        f"MAE in mm by the number of frames missing of {PIECE}",
        "frames",
        together=False,
    )
    refusals(found)
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
