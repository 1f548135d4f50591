#!/usr/bin/env python
"""Draw the picture of the README: a gap in a gait recording, its fill and the 90 % bound.

    python scripts/studies/readme_picture.py [--data DIR] [-o docs/fill.png]

Removes the four markers of an arm for 0.8 s from a gait trial of the biomechZoo sample study
(Apache-2.0), fills them from the rest of the trial with the default method, and plots for a wrist
marker its recorded and filled height, a straight line across the gap, the distance between filled
and recorded positions, and the bound below which priorfill expects 90 % of these distances.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np

from priorfill.cli.encoding import replace_what_is_lacking

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
from recordings import add_data_option

import priorfill as pf

RECORDING = "gait/HC002D06.c3d"
MARKER, REMOVED = "LWRA", ("LELB", "LWRA", "LWRB", "LFIN")
START, FRAMES = 80, 80
"""First frame without the markers, and number of frames."""

MARGIN = 50
"""Frames shown before and after the gap."""

OUTPUT = Path(__file__).resolve().parents[2] / "docs" / "fill.png"


def draw(truth: pf.Clip, result: pf.Result, gap: slice, output: Path) -> None:
    """Plot a filled marker against the recording."""
    mpl.use("Agg")
    from matplotlib import pyplot

    marker = truth.labels.index(MARKER)
    shown = slice(max(0, gap.start - MARGIN), min(truth.frames, gap.stop + MARGIN))
    seconds = np.arange(truth.frames) / truth.rate
    filled, bound = result.clip.positions[:, marker], result.error_bound_90_mm[:, marker]
    height = filled[gap, 2]
    figure, (top, bottom) = pyplot.subplots(
        2, 1, sharex=True, figsize=(7.5, 4.4), height_ratios=(5, 2), layout="constrained"
    )
    band = {"color": "C1", "alpha": 0.2, "linewidth": 0.0}
    top.fill_between(
        seconds[gap], height - bound[gap], height + bound[gap], **band, label="90 % bound"
    )
    edges = [gap.start - 1, gap.stop]
    line = truth.positions[edges, marker, 2]
    top.plot(seconds[edges], line, "0.6", lw=1.2, label="straight line")
    top.plot(seconds[shown], truth.positions[shown, marker, 2], "k", lw=1.6, label="recorded")
    top.plot(seconds[gap], height, "C1--", lw=1.8, label="filled")
    top.set_ylabel("height (mm)")
    figure.legend(loc="outside upper center", frameon=False, ncols=4)
    error = np.linalg.norm(filled - truth.positions[:, marker], axis=1)
    bottom.fill_between(seconds[gap], 0.0, bound[gap], **band)
    bottom.plot(seconds[gap], error[gap], "C1", lw=1.5)
    bottom.set(ylabel="distance from\nrecorded (mm)", xlabel="time (s)", ylim=(0.0, None))
    figure.savefig(output, dpi=110)


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
    positions[gap, [truth.labels.index(label) for label in REMOVED]] = np.nan
    result = pf.fill(truth.with_positions(positions))
    draw(truth, result, gap, arguments.output)
    for found in (found for found in result.gaps if found.label in REMOVED):
        column = truth.labels.index(found.label)
        away = result.clip.positions[gap, column] - truth.positions[gap, column]
        print(
            f"{found.label}: mean error {np.linalg.norm(away, axis=1).mean():.1f} mm, expected "
            f"{found.expected_mean_error_mm:.1f} mm, 90 % below {found.error_bound_90_mm:.1f} mm"
        )
    print(f"{arguments.output}: {arguments.output.stat().st_size / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
