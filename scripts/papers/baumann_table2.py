#!/usr/bin/env python
"""Baumann et al. 2011, table 2: arms, legs, or both missing, by method.

    python scripts/papers/baumann_table2.py [--data DIR] [--recording FILE] [--full]
        [--methods NAME,NAME...]

Both arms, both legs, or all four limbs are removed from the middle of recordings and filled with
all other recordings. The paper compares with krueger2010; ``--methods`` adds any other.
``--full``: each motion by each actor.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from baumann import RECORDING, Take, database_of, examples, library, limb, middle, print_data
from paper import error, in_processes, method_alone, options, print_table

import priorfill as pf
from priorfill.cli.encoding import replace_what_is_lacking
from priorfill.errors import MethodError
from priorfill.methods import METHODS

DEFAULT = "baumann2011,krueger2010,neighbours,gpr,r2,pca-train,linear,spline"
"""Default methods."""

BOTH = ("left", "right")
GAPS = {
    "arms": limb("arm", *BOTH),
    "legs": limb("leg", *BOTH),
    "both": [*limb("arm", *BOTH), *limb("leg", *BOTH)],
}


@dataclass(frozen=True)
class Case:
    """A recording, its gap, and the methods."""

    take: Take
    gap: str
    methods: tuple[str, ...]
    database: Path


def errors(case: Case) -> list[float]:
    """Return the error (mm) of each method; NaN where it cannot fill the gap."""
    truth = pf.read(case.take.file)
    gappy = middle(truth, GAPS[case.gap])
    others = method_alone(pf.Selection(not_names=(case.take.file.stem,)))
    found = []
    for method in case.methods:
        try:
            result = pf.fill(gappy, database=case.database, method=method, options=others)
            found.append(error(result.clip, truth, gappy))
        except MethodError:
            found.append(float("nan"))
    return found


def main() -> int:
    """Print the table."""
    parser = options(__doc__, recording=RECORDING, full="fill each motion by each actor")
    parser.add_argument("--methods", metavar="NAMES", help="methods, separated by commas")
    arguments = parser.parse_args()
    given = (arguments.methods or DEFAULT).split(",")
    methods = tuple(name for name in given if name in METHODS)
    if arguments.methods and len(methods) < len(given):
        raise SystemExit(f"unknown method; use some of {' '.join(METHODS)}")
    takes = library(arguments.data)
    filled = examples(takes, arguments.recording, full=arguments.full)
    print_data(takes, filled, arguments.recording)
    with database_of(takes) as database:
        cases = [Case(take, gap, methods, database) for gap in GAPS for take in filled]
        found = np.array(in_processes(errors, cases))
    found = found.reshape(len(GAPS), len(filled), len(methods))
    rows = []
    for i, method in enumerate(methods):
        row: list[str | float | None] = [method]
        for gap in range(len(GAPS)):
            # a mean over fewer recordings would not be comparable
            row += [float(found[gap, :, i].mean()), None]
        rows.append(row)
    print_table(
        "Mean error in mm (values of the paper are not available)",
        ["method", *(head for gap in GAPS for head in (gap, "paper"))],
        rows,
    )
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
