#!/usr/bin/env python
"""Li, Yu, Kieu, Vuong and Zhang 2020, figure 9: each marker missing throughout.

    python scripts/papers/li_fig9.py [--data DIR] [--recording FILE] [--full]
        [--training DIR] [--methods NAME,NAME...]

Interpretation (the text of the paper is not available): the program's other "extreme case", ``T``,
in which one joint at a time is missing in all of 100 frames, and can be predicted from training
data only. Methods that learn from the clip alone are not run by default; see ``--methods``.
"""

from __future__ import annotations

import sys

from li import PIECE, Throughout, by_part, evaluated, material, parser_of, print_data, refusals

from priorfill.cli.encoding import replace_what_is_lacking

METHODS = "pca-train,pca-pieces,auto"


def main() -> int:
    """Print the figure."""
    parser = parser_of(__doc__, full="all samples", methods=METHODS)
    arguments = parser.parse_args()
    some = material(arguments).first(PIECE)
    print_data(some, "frames 301-400 of Maju Undur (a Malay dance, 30 Hz).")
    found = evaluated(some, Throughout(), arguments.methods)
    by_part(found, "marker", f"MAE in mm of a marker missing in all of {PIECE} frames")
    refusals(found)
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
