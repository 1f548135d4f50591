#!/usr/bin/env python
"""Draw the picture of the README: a gap in a gait recording, its fill and its bands.

    python scripts/studies/readme_picture.py [--data DIR] [-o docs/fill.png]

Removes the four markers of an arm for 0.8 s from a gait trial of the biomechZoo sample study
(Apache-2.0), fills them from the rest of the trial with the default method, and plots a wrist
marker with `Result.plot`: recorded, filled, and the bands that are expected to hold 50 and 90 % of
the errors.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from priorfill.cli.encoding import replace_what_is_lacking

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
from recordings import add_data_option

import priorfill as pf

RECORDING = "gait/HC002D06.c3d"
MARKER, REMOVED = "LWRA", ("LELB", "LWRA", "LWRB", "LFIN")
START, FRAMES = 80, 80
"""First frame without the markers, and number of frames."""

DPI = 110
"""Pixels per inch; the README shows the picture at half its width."""

OUTPUT = Path(__file__).resolve().parents[2] / "docs" / "fill.png"


def main() -> int:
    """Remove, fill and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_data_option(parser)
    parser.add_argument("-o", "--output", type=Path, default=OUTPUT)
    arguments = parser.parse_args()
    file = arguments.data / RECORDING
    if not file.exists():
        print(f"{file}: no such recording; name the folder with --data", file=sys.stderr)
        return 1
    truth = pf.read(file)
    gap = slice(START, START + FRAMES)
    positions = truth.positions.copy()
    positions[gap, [truth.index(label) for label in REMOVED]] = np.nan
    result = pf.fill(truth.with_positions(positions))
    result.plot(MARKER, truth=truth).savefig(arguments.output, dpi=DPI)
    for found in (found for found in result.gaps if found.label in REMOVED):
        away = result.clip[found.label][gap] - truth[found.label][gap]
        print(
            f"{found.label}: mean error {np.linalg.norm(away, axis=1).mean():.1f} mm, expected "
            f"{found.expected_mean_error_mm:.1f} mm, 90 % below {found.error_bound_90_mm:.1f} mm"
        )
    print(f"{arguments.output}: {arguments.output.stat().st_size / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
