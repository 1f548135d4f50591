#!/usr/bin/env python
"""Gløersen and Federolf 2016: WalkL with harder gap patterns, and computing time.

    python scripts/papers/gloersen_walkl.py [--data DIR] [--recording FILE] [--full]

A reimplementation of the method comes with 50 gap patterns for WalkL, which are in
``walkl/missing_masks.npz``: 16 to 61 gaps of 1 to 859 frames. They are not the paper's (5 to 15
gaps of 20 to 480 frames, see ``gloersen_fig4.py``). Their samples are removed and filled by r1 and
r2; so are random patterns of ``priorfill evaluate --protocol random`` (10, ``--full``: 50). The
error of r1 depends on the number of complete frames, the number of markers with gaps, and the
distance of the other markers from these, because r1 learns all markers with gaps at once from the
others in complete frames.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from gloersen import (
    METHODS,
    mean_distance,
    patterns,
    print_data,
    quartiles,
    read,
    recording,
)
from numpy.typing import NDArray
from paper import Cell, in_processes, options, print_table
from scipy.stats import spearmanr

import priorfill as pf
from priorfill.cli.encoding import replace_what_is_lacking
from priorfill.evaluation.body_parts import parts_of
from priorfill.evaluation.gap_generator import Mask
from priorfill.evaluation.protocols import GapMask, RandomGaps, draw_for
from priorfill.methods.gloersen2016.weighted_pca import mean_distances

AUTHORS_SECONDS = 12.0
"""s. The authors' program, r2, with the first pattern, on one core like that of the timing."""

FEW, MANY = 10, 50
"""Patterns of evaluate's protocol."""

EVALUATE_SEED = 0
"""Its default, so that the first patterns are those of ``priorfill evaluate FILE --copies N``."""

FIRST = 3
"""Number of copies listed one by one and evaluated together."""

COMPLETE = (0, 200, 400, 800, 1200)
"""Complete frames: lower limits of the classes."""

TIMES = 3
"""Fills that are timed; the fastest counts."""


@dataclass(frozen=True, eq=False)
class Case:
    """Samples removed from a recording."""

    file: Path
    gone: Mask


def errors(case: Case) -> list[float]:
    """Return the mean error (mm) of each method."""
    return [mean_distance(read(case.file), case.gone, method) for method in METHODS]


def seconds(case: Case) -> float:
    """Return the CPU seconds of r2, minimum of several fills."""
    best = np.inf
    for _ in range(TIMES):
        begin = time.process_time()
        mean_distance(read(case.file), case.gone, "r2")
        best = min(best, time.process_time() - begin)
    return float(best)


def protocol(file: Path, copies: int) -> list[Mask]:
    """Return patterns as ``priorfill evaluate --protocol random`` makes them by default."""
    clip = read(file)
    cases = RandomGaps(copies=copies).cases(
        clip, parts_of(clip), draw_for(EVALUATE_SEED, "random", clip.name)
    )
    return [case.mask for case in cases if isinstance(case, GapMask)]


def nearest_distance(clip: pf.Clip, gone: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the distance (mm) of the nearest marker without gaps for each pattern.

    A mean over the markers with gaps, of mean distances in the recording.
    """
    apart = mean_distances(
        np.nan_to_num(clip.positions), ~clip.missing, np.arange(len(clip.labels))
    )
    lost: NDArray[np.bool_] = np.asarray(gone.any(axis=1))
    means = [
        apart[some][:, ~some].min(axis=1, initial=np.inf).mean() if some.any() else np.nan
        for some in lost
    ]
    return np.array(means)


def main() -> int:
    """Print medians, dependencies of r1, and the time."""
    parser = options(
        __doc__, recording="fill this recording", full=f"{MANY} patterns of evaluate, not {FEW}"
    )
    arguments = parser.parse_args()
    sample = recording(arguments)
    file, clip = sample.file, read(sample.file)
    sources = {
        "file": patterns(file),
        "evaluate": protocol(file, MANY if arguments.full else FEW),
    }
    kinds = [name for name, some in sources.items() for _ in some]
    cases = [Case(file, gone) for some in sources.values() for gone in some]
    print_data([sample])
    print("Patterns:", ", ".join(f"{len(some)} of {name}" for name, some in sources.items()))
    if not cases:
        raise SystemExit(f"{file}: no pattern is of its size, and none finds a place in it")
    found = np.array(in_processes(errors, cases))
    which = {name: np.array([kind == name for kind in kinds]) for name in sources}
    rows: list[list[Cell]] = []
    for name, here in which.items():
        for j, method in enumerate(METHODS):
            values = found[here, j]
            values = values[np.isfinite(values)]
            if len(values):
                ends = f"{values.min():.1f}-{values.max():.1f}"
                rows.append([name, method, len(values), *quartiles(values), ends])
    print_table(
        "Mean error in mm of the patterns (file: of a reimplementation)",
        ["patterns", "method", "filled", "median", "quartiles", "range"],
        rows,
    )
    gone = np.array([case.gone for case in cases])
    apart = nearest_distance(clip, gone)
    _tell_frames(which, gone, apart, found)
    first = np.flatnonzero(which["evaluate"])[:FIRST]
    _print_first(gone[first], apart[first], found[first])
    took = seconds(cases[0])
    authors = AUTHORS_SECONDS if sources["file"] and sample.own else None
    row: list[Cell] = [f"{kinds[0]} pattern 1", took, authors, authors / took if authors else None]
    print_table("CPU seconds of r2", ["", "ours", "the authors' program", "times as fast"], [row])
    print(f"({clip.frames} frames, {len(clip.labels)} markers)")
    return 0


def _tell_frames(
    which: dict[str, NDArray[np.bool_]],
    gone: NDArray[np.bool_],
    apart: NDArray[np.float64],
    found: NDArray[np.float64],
) -> None:
    """Print the dependencies of the errors."""
    complete = (~gone.any(axis=2)).sum(axis=1)
    lost = gone.any(axis=1).sum(axis=1)
    classes = np.searchsorted(COMPLETE, complete, side="right") - 1
    rows: list[list[Cell]] = []
    for name, here in which.items():
        for number, low in enumerate(COMPLETE):
            some = here & (classes == number)
            if not some.any():
                continue
            high = f"{COMPLETE[number + 1] - 1}" if number + 1 < len(COMPLETE) else "more"
            medians = [quartiles(found[some, j])[0] for j in range(len(METHODS))]
            share = f"{gone[some].mean():.1%}"
            markers = float(np.median(lost[some]))
            rows.append([name, f"{low}-{high}", int(some.sum()), share, markers, *medians])
    print_table(
        "By frames that show all markers: samples removed, markers with gaps, median errors in mm",
        ["patterns", "complete", "number", "removed", "markers", *METHODS],
        rows,
    )
    filled = np.isfinite(found).all(axis=1)
    if filled.sum() > len(METHODS):
        ranks: list[list[Cell]] = [
            [text, *(float(spearmanr(values[filled], found[filled, j])[0]) for j in (0, 1))]
            for text, values in (
                ("complete frames", complete),
                ("markers with gaps", lost),
                ("distance of the others", apart),
                ("samples removed", gone.mean(axis=(1, 2))),
            )
        ]
        print_table("Rank correlation of a pattern's error with", ["", *METHODS], ranks)


def _print_first(
    gone: NDArray[np.bool_], apart: NDArray[np.float64], found: NDArray[np.float64]
) -> None:
    """Print some patterns, and the mean over all samples."""
    samples = gone.sum(axis=(1, 2))
    rows: list[list[Cell]] = [
        [
            str(number + 1),
            int(samples[number]),
            int((~one.any(axis=1)).sum()),
            int(one.any(axis=0).sum()),
            float(apart[number]),
            *map(float, found[number]),
        ]
        for number, one in enumerate(gone)
    ]
    together = samples @ found / samples.sum() if len(gone) else np.full(len(METHODS), np.nan)
    print_table(
        f"priorfill evaluate --protocol random --copies {len(gone)}: errors in mm",
        ["copy", "samples", "complete frames", "markers with gaps", "others at mm", *METHODS],
        [*rows, ["all samples", int(samples.sum()), None, None, None, *map(float, together)]],
    )


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
