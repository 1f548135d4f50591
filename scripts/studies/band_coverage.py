#!/usr/bin/env python
"""Check that the bands of plots hold as many errors as their names state.

    python scripts/studies/band_coverage.py [--data DIR] [--repeat 3] [--seed 11]

Cuts gaps of five kinds into recordings, fills them with the default method, and prints by kind of
gap the share of filled samples whose error lies within the bands of single coordinates, and within
the 50 and 90 % distances in space: means over the cases. A band in use should hold about what its
name states; docs/report.md quotes the table.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from priorfill.cli.encoding import replace_what_is_lacking

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
from artificial_gaps import cut_gaps
from recordings import add_data_option

import priorfill as pf
from priorfill.evaluation.body_parts import parts_of
from priorfill.report.bands import BAND_50, BAND_90, HALO_50

FILES = (
    *("gait/HC003B08.c3d", "gait/HC034A07.c3d", "gait/HC038A11.c3d", "gait/HC040A14.c3d"),
    *("gait/HC044A15.c3d", "gait/HC055A34.c3d", "cmu/*.c3d", "hdm05/*.c3d"),
)
"""Recordings of healthy gait, sports and everyday motions."""

KINDS = ("single", "segment", "limb", "limbs", "scatter")
MAX_FRAMES = 1000
"""Frames of a recording that are used; a fill takes seconds."""

SHARES = (("x y z 90 %", BAND_90), ("x y z 50 %", BAND_50), ("space 90 %", 1.0),
          ("space 50 %", HALO_50))  # fmt: skip
"""Columns of the table: the name, and the share of the bound."""


def shares_within(truth: pf.Clip, gone: np.ndarray) -> list[float]:
    """Remove samples, fill them, and return the share of the errors within each band."""
    positions = truth.positions.copy()
    positions[gone] = np.nan
    result = pf.fill(truth.with_positions(positions))
    known = gone & result.filled & np.isfinite(result.error_bound_90_mm)
    away = (result.clip.positions - truth.positions)[known]
    bound = result.error_bound_90_mm[known]
    sizes = {"x": np.abs(away), "s": np.linalg.norm(away, axis=1)[:, None]}
    return [float((sizes[name[0]] <= part * bound[:, None]).mean()) for name, part in SHARES]


def main() -> int:
    """Cut, fill and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_data_option(parser)
    parser.add_argument("--repeat", type=int, default=3, help="gaps of a kind in each recording")
    parser.add_argument("--seed", type=int, default=11)
    arguments = parser.parse_args()
    files = [file for name in FILES for file in sorted(arguments.data.glob(name))]
    found: dict[str, list[list[float]]] = {kind: [] for kind in KINDS}
    for number, file in enumerate(files):
        clip = pf.read(file)
        clip = replace(clip, positions=clip.positions[:MAX_FRAMES], source=None)
        parts = parts_of(clip)
        for place, kind in enumerate(KINDS):
            for again in range(arguments.repeat):
                rng = np.random.default_rng([arguments.seed, number, place, again])
                cut = cut_gaps(kind, clip, parts, rng)
                if cut is not None:
                    found[kind].append(shares_within(*cut))
    print(f"{'gaps':<9}{'cases':>6}" + "".join(f"{name:>13}" for name, _ in SHARES))
    every = [row for rows in found.values() for row in rows]
    for kind, rows in {**found, "all": every}.items():
        if rows:
            means = np.mean(rows, axis=0)
            print(f"{kind:<9}{len(rows):>6}" + "".join(f"{100 * mean:>11.0f} %" for mean in means))
    return 0 if every else 1


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
