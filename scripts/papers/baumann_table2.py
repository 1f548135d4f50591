#!/usr/bin/env python
"""Baumann et al. 2011, table 2: limbs missing in five motions, compared with krueger2010.

    python scripts/papers/baumann_table2.py [--data DIR] [--database DIR] [--methods NAME,NAME...]

An arm, a leg, both arms or both legs are removed from five takes and filled from all other takes of
the library. The paper fits a skeleton to the true and to the filled markers and compares joints,
those of limbs without gaps too. Its fit is not described; here a joint is the mean of the markers
around it. Errors of the missing markers follow.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from baumann import (
    LIKE_A_WALK,
    Example,
    PaperTake,
    choose,
    fill_by,
    gappy_of,
    limb,
    opened,
    parser_of,
    print_data,
    reason,
    without,
)
from paper import Comparison, error, in_processes, print_table

import priorfill as pf
from priorfill.cli.encoding import replace_what_is_lacking
from priorfill.markers.definitions import load
from priorfill.methods import METHODS as KNOWN

DEFAULT = "baumann2011,krueger2010"
"""Methods: the paper's, and the one that it compares with."""

TAKES = (
    PaperTake("bd_01-01_01", "HDM_bd_01-01_01_120", 650, 1100, LIKE_A_WALK),
    PaperTake("bd_01-02_03", "HDM_bd_01-02_03_120", 450, 750, ("01-02_03", "walk-turn", "jogLeft")),
    PaperTake("bk_01-01_03", "HDM_bk_01-01_03_120", 6300, 6600, LIKE_A_WALK),
    PaperTake("mm_02-03_02", "HDM_mm_02-03_02_120", 450, 750, ("02-03", "raise-up-right", "grab")),
    PaperTake("dg_01-06_01", "HDM_dg_01-06_01_120", 1000, 1300, ("01-06", "2_run_", "hopBothLegs")),
)

GAPS = {
    "left arm": limb("arm", "left"),
    "right arm": limb("arm", "right"),
    "both arms": limb("arm", "left", "right"),
    "left leg": limb("leg", "left"),
    "right leg": limb("leg", "right"),
    "both legs": limb("leg", "left", "right"),
}

PAPER = {
    ("bd_01-01_01", "baumann2011"): "6.4 5.9 12.3 8.8 8.2 24.7",
    ("bd_01-01_01", "krueger2010"): "10.0 15.6 22.9 13.5 14.8 45.5",
    ("bd_01-02_03", "baumann2011"): "12.0 11.8 36.3 16.0 22.0 40.0",
    ("bd_01-02_03", "krueger2010"): "18.1 24.3 47.1 16.3 21.9 46.2",
    ("bk_01-01_03", "baumann2011"): "12.9 14.7 48.0 12.7 16.1 42.4",
    ("bk_01-01_03", "krueger2010"): "20.5 24.4 59.1 18.6 26.5 62.6",
    ("mm_02-03_02", "baumann2011"): "10.0 35.0 102.0 9.5 11.1 20.0",
    ("mm_02-03_02", "krueger2010"): "28.9 44.6 120.7 9.7 13.7 18.5",
    ("dg_01-06_01", "baumann2011"): "12.0 9.4 18.1 17.0 15.8 35.6",
    ("dg_01-06_01", "krueger2010"): "16.8 12.6 36.9 14.2 15.9 46.8",
    ("mean", "baumann2011"): "10.7 15.4 43.3 12.8 14.6 32.5",
    ("mean", "krueger2010"): "18.9 24.3 57.3 14.5 18.6 43.9",
}
"""mm (cm in the paper). By motion and method, in the order of the gaps."""

TRUNK = {
    "lower_back": ("LFWT", "RFWT", "LBWT", "RBWT"),
    "neck": ("C7", "CLAV"),
}
"""Joints that the marker set does not define: the markers around them."""


@dataclass(frozen=True)
class Case:
    """A take, its gap, and the methods."""

    example: Example
    truth: pf.Clip
    gap: str
    methods: tuple[str, ...]
    library: Path


def joints(clip: pf.Clip) -> np.ndarray:
    """Return 14 joints of a clip [shape=(frames, joints, 3), mm]: ends of limbs, back and neck."""
    points = [middle for _, middle, _ in load("baumann41").joints.values()]
    columns = [[clip.labels.index(label) for label in point] for point in points]
    columns += [[clip.labels.index(label) for label in point] for point in TRUNK.values()]
    return np.stack([clip.positions[:, point].mean(axis=1) for point in columns], axis=1)


def joint_error(found: pf.Clip, truth: pf.Clip, gappy: pf.Clip) -> float:
    """Return the mean distance (mm) of all joints in the frames of a gap; NaN if any is missing."""
    frames = (gappy.missing & ~truth.missing).any(axis=1)
    true = joints(truth)[frames]
    distance = np.linalg.norm(joints(found)[frames] - true, axis=2)
    return float(distance[np.isfinite(true).all(axis=2)].mean())


def errors(case: Case) -> list[tuple[float, float]]:
    """Return the errors (mm) of joints and of the missing markers, by method."""
    gappy = gappy_of(case.example, case.truth, GAPS[case.gap])
    filled = fill_by(case.library, gappy, without(case.example), case.methods)
    return [
        (joint_error(clip, case.truth, gappy), error(clip, case.truth, gappy)) for clip in filled
    ]


def print_errors(title: str, rows: dict[tuple[str, str], np.ndarray], *, compared: bool) -> None:
    """Print a table by motion and method, with the paper's values if they are of this metric."""
    lines: list[list[str | float | None]] = []
    for (motion, method), values in rows.items():
        lines.append([motion, method, *map(float, values)])
        if compared and (motion, method) in PAPER:
            lines.append(["", "  paper", *PAPER[motion, method].split()])
    print_table(title, ["motion", "method", *GAPS], lines)


def main() -> int:
    """Print the table."""
    parser = parser_of(__doc__)
    parser.add_argument("--methods", metavar="NAMES", help="methods, separated by commas")
    arguments = parser.parse_args()
    methods = tuple((arguments.methods or DEFAULT).split(","))
    if not set(methods) <= set(KNOWN):
        raise SystemExit(f"unknown method; use some of {' '.join(KNOWN)}")
    with opened(arguments) as library:
        examples = choose(library, TAKES)
        print_data(library, examples)
        cases = [
            Case(example, library.truth(example.record), gap, methods, library.path)
            for example in examples
            for gap in GAPS
        ]
        found = np.array(in_processes(errors, cases))
    found = found.reshape(len(examples), len(GAPS), len(methods), 2)
    tables: list[dict[tuple[str, str], np.ndarray]] = [{}, {}]
    for metric, rows in enumerate(tables):
        for i, example in enumerate(examples):
            for j, method in enumerate(methods):
                rows[example.take.motion, method] = found[i, :, j, metric]
        for j, method in enumerate(methods):
            rows["mean", method] = found[:, :, j, metric].mean(axis=0)
    print_errors("Mean error in mm of all joints (metric of the paper)", tables[0], compared=True)
    print_errors("Mean error in mm of the missing markers", tables[1], compared=False)
    why = {example.take.motion: reason(example, library) for example in examples}
    comparison = Comparison()
    for (motion, method), values in tables[0].items():
        papers = PAPER.get((motion, method), "").split()
        for gap, ours, paper in zip(GAPS, values, papers, strict=False):
            cell = f"{motion} {method} {gap}"
            comparison.add(cell, float(ours), paper, why.get(motion, "mean of the above"))
    comparison.print()
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
