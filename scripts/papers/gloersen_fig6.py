#!/usr/bin/env python
"""Gløersen and Federolf 2016, figure 6: how errors of r2 depend on the method's constants.

    python scripts/papers/gloersen_fig6.py [--data DIR] [--recording FILE] [--copies N]

One constant at a time takes the paper's range, the others are the paper's. 20 copies of each
recording have random gaps as in figure 4; the error is that of a copy minus its mean over all
values of the constant. The paper shows curves; its text names the best values.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace

import numpy as np
from gloersen import (
    RECORDING,
    Sample,
    mean_distance,
    print_data,
    quartiles,
    random_gaps,
    samples,
)
from numpy.typing import NDArray
from paper import Cell, Comparison, in_processes, options, print_table

from priorfill.cli.encoding import replace_what_is_lacking
from priorfill.methods.gloersen2016 import Gloersen2016Options


@dataclass(frozen=True)
class Constant:
    """A constant of the method.

    Attributes
    ----------
    option : str
        Of ``Gloersen2016Options``.
    name : str
        The paper's.
    values : tuple of float
        The paper's range.
    best : mapping of str to str
        The best value of each recording, from the paper's text.
    """

    option: str
    name: str
    values: tuple[float, ...]
    best: dict[str, str]


ALL = ("WalkL", "WalkRun", "CP-gait")

CONSTANTS = (
    Constant("missing_weight", "w_mm", tuple(np.geomspace(1e-5, 1.0, 15).tolist()), {}),
    Constant("sigma", "sigma", tuple(np.linspace(100.0, 1500.0, 15).tolist()), {"all": "200"}),
    Constant(
        "min_singular_share",
        "Theta_lambda",
        tuple(np.linspace(0.86, 1.0, 15).round(2).tolist()),
        dict.fromkeys(ALL, "0.99"),
    ),
    Constant(
        "distal_threshold",
        "Theta_D",
        tuple(np.linspace(0.0, 2.0, 11).round(1).tolist()),
        {"WalkL": "1", "WalkRun": "0.2", "CP-gait": "1"},
    ),
)

COPIES = 20


@dataclass(frozen=True)
class Case:
    """A copy of a recording."""

    sample: Sample
    copy: int


def errors(case: Case) -> list[list[float]]:
    """Return for each constant the mean error (mm) of r2 for each value."""
    clip = case.sample.clip
    gone = random_gaps(case.sample, case.copy)
    published = Gloersen2016Options()
    return [
        [
            mean_distance(clip, gone, "r2", replace(published, **{constant.option: value}))
            for value in constant.values
        ]
        for constant in CONSTANTS
    ]


def relative(found: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return errors [shape=(copies, values)] minus the mean of each copy."""
    return found - found.mean(axis=1, keepdims=True)


def main() -> int:
    """Print the figure's curves."""
    parser = options(__doc__, recording=RECORDING)
    parser.add_argument("--copies", type=int, default=COPIES, help="copies of each recording")
    arguments = parser.parse_args()
    chosen = samples(arguments)
    print_data(chosen)
    cases = [Case(sample, copy) for sample in chosen for copy in range(arguments.copies)]
    results = in_processes(errors, cases)
    compared = Comparison(unit="")
    for number, constant in enumerate(CONSTANTS):
        found = relative(np.array([result[number] for result in results]))
        curves = found.reshape(len(chosen), arguments.copies, -1)
        _print_curves(constant, chosen, curves)
        _compare_best(compared, constant, chosen, curves)
    compared.print()
    return 0


def _print_curves(constant: Constant, chosen: list[Sample], curves: NDArray[np.float64]) -> None:
    """Print medians and quartiles over the copies."""
    rows: list[list[Cell]] = []
    default = getattr(Gloersen2016Options(), constant.option)
    for j, value in enumerate(constant.values):
        mark = " (paper's choice)" if np.isclose(value, default) else ""
        rows.append([f"{value:.0f}{mark}" if value > 10 else f"{value:.3g}{mark}"])
        for curve in curves:
            middle, between = quartiles(curve[:, j])
            rows[-1] += [f"{middle:.2f}", between]
    heads = [head for sample in chosen for head in (sample.name, "quartiles")]
    print_table(
        f"{constant.name}: error in mm minus the mean of the copy, median (* stand-in)",
        [constant.name, *heads],
        rows,
    )


def _compare_best(
    compared: Comparison, constant: Constant, chosen: list[Sample], curves: NDArray[np.float64]
) -> None:
    """Compare the values with the smallest median error with the paper's text."""
    whys = {sample.motion.name: sample.why for sample in chosen}
    whys["all"] = next((f"partly {why}" for why in whys.values() if why), "")
    parts = {sample.motion.name: curve for sample, curve in zip(chosen, curves, strict=True)}
    parts["all"] = curves.reshape(-1, curves.shape[-1])
    for name, paper in constant.best.items():
        if name not in parts:
            continue
        medians = np.median(parts[name], axis=0)
        best = int(np.argmin(medians))
        published = int(np.argmin(np.abs(np.array(constant.values) - float(paper))))
        why = f"{medians[published] - medians[best]:.2f} mm better than with {paper}"
        why += f"; {whys[name]}" if whys[name] else ""
        compared.add(f"best {constant.name}, {name}", constant.values[best], paper, why)


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
