#!/usr/bin/env python
"""Fill arrays as of markerless motion capture, and compare with the recordings they were made of.

    python scripts/studies/confidence_study.py [--data DIR] [--repeat 3]

Each recording is thinned to 25 or 30 Hz and gets errors as of a triangulation: correlated over
time, and in stretches of up to 0.6 s, with a low confidence, of decimetres. Printed are mean errors
of measured samples, of dropped ones as they were, of filled ones, what was expected, the share
within the 90 % bound, and the error of a straight line. docs/arrays.md quotes the table.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.cli.encoding import replace_what_is_lacking

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
from recordings import add_data_option

import priorfill as pf

CASES = (
    *(("cmu/02_01.c3d", 3.0, 41), ("cmu/02_01.c3d", 15.0, 41), ("gait/HC002D06.c3d", 3.0, 59)),
    *(("gait/HC002D06.c3d", 15.0, 59), ("cmu/85_02.c3d", 3.0, 41), ("cmu/02_01.c3d", 3.0, 10)),
    *(("cmu/85_02.c3d", 3.0, 10), ("cmu/135_02.c3d", 3.0, 10)),
    ("hdm05/HDM_dg_06-03_03_120.c3d", 3.0, 10),
)
"""Recordings, errors of each coordinate (mm), and numbers of markers."""

FEW = ("LFHD", "C7", "CLAV", "T10", "LSHO", "LELB", "RELB", "LKNE", "RKNE", "LANK")
"""Markers of cases with ten, which get other names."""

STEP = 4
MAX_FRAMES = 600
"""Every fourth frame is used, and so many of them."""

MEMORY = 0.7
"""Correlation of an error with that in the frame before."""

LOW_SHARE, LOW_SECONDS, LOW_ERROR = 0.02, 0.3, 150.0
"""Stretches of low confidence: share of the frames for which one is begun, mean length (s), and
additional error of a coordinate (mm)."""

MISSING = 0.01
"""Share of samples that are missing."""

THRESHOLD = 0.6


@dataclass(frozen=True)
class Markerless:
    """Positions (m) with and without errors, confidences, labels and rate."""

    truth: NDArray[np.float64]
    positions: NDArray[np.float32]
    confidence: NDArray[np.float64]
    labels: tuple[str, ...]
    rate: float


def markerless(path: Path, error: float, markers: int, seed: int) -> Markerless:
    """Make an array of a recording."""
    clip, rng = pf.read(path), np.random.default_rng(seed)
    truth, labels, rate = clip.positions[::STEP], clip.labels, clip.rate / STEP
    if markers == len(FEW):
        truth = truth[:, [clip.index(label) for label in FEW]]
        labels = tuple(f"k{number}" for number in range(len(FEW)))
    noise = rng.normal(size=truth.shape)
    for frame in range(1, len(noise)):
        noise[frame] = MEMORY * noise[frame - 1] + np.sqrt(1 - MEMORY**2) * noise[frame]
    positions = truth + error * noise
    confidence = np.clip(0.9 + 0.05 * rng.normal(size=truth.shape[:2]), 0.65, 1.0)
    low = np.zeros(truth.shape[:2], dtype=bool)
    for marker in range(truth.shape[1]):
        for _ in range(max(1, int(len(truth) * LOW_SHARE / (LOW_SECONDS * rate)))):
            length = int(rng.integers(2, max(3, int(2 * LOW_SECONDS * rate))))
            start = int(rng.integers(0, max(1, len(truth) - length)))
            low[start : start + length, marker] = True
    positions[low] += LOW_ERROR * rng.normal(size=(int(low.sum()), 3))
    confidence[low] = rng.uniform(0.05, 0.5, int(low.sum()))
    positions[rng.random(truth.shape[:2]) < MISSING] = np.nan
    cut = slice(0, MAX_FRAMES)
    metres = (positions[cut] / 1000).astype(np.float32)
    return Markerless(truth[cut] / 1000, metres, confidence[cut], labels, rate)


def row(path: Path, error: float, markers: int, seed: int) -> list[float]:
    """Fill an array; return the figures of its row (errors in mm)."""
    made = markerless(path, error, markers, seed)
    keywords = {"confidence": made.confidence, "min_confidence": THRESHOLD, "unit": "m"}
    done = pf.fill_array(made.positions, made.labels, made.rate, **keywords)
    line = pf.fill_array(made.positions, made.labels, made.rate, method="linear", **keywords)
    off, given, straight = (
        1000 * np.linalg.norm(one - made.truth, axis=2)
        for one in (done.positions, made.positions, line.positions)
    )
    filled = done.filled
    inside = off[filled] <= 1000 * done.error_bound_90[filled]
    return [
        float(np.nanmean(off[~filled])),
        float(np.nanmean(given[done.dropped])),
        float(np.nanmean(off[filled])),
        float(1000 * np.nanmean(done.expected_mean_error[filled])),
        float(100 * inside.mean()),
        float(np.nanmean(straight[filled & line.filled])),
    ]


def main() -> int:
    """Make, fill and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_data_option(parser)
    parser.add_argument("--repeat", type=int, default=3, help="draws of each case")
    arguments = parser.parse_args()
    heads = ("measured", "dropped", "filled", "expected", "within %", "straight")
    print(f"{'recording':32s}{'markers':>8s}" + "".join(f"{head:>10s}" for head in heads))
    cases = [(arguments.data / name, *rest) for name, *rest in CASES]
    cases = [case for case in cases if case[0].is_file()]
    for path, error, markers in cases:
        rows = [row(path, error, markers, seed) for seed in range(arguments.repeat)]
        figures = "".join(f"{value:10.1f}" for value in np.mean(rows, axis=0))
        print(f"{path.stem:32s}{markers:8d}{figures}", flush=True)
    return 0 if cases else 1


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
