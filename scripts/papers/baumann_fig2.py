#!/usr/bin/env python
"""Baumann et al. 2011, figure 2: computing time by gap length.

    python scripts/papers/baumann_fig2.py [--data DIR] [--recording FILE] [--full]

An arm is removed from a long recording of HDM05 for 1 to 8 s (``--full``: also 16 s, three
repetitions) and filled with a database of other recordings. Times are CPU seconds, summed over
cores, without compiling and building the database.
"""

from __future__ import annotations

import sys
import time

import numpy as np
from baumann import METHODS, RECORDING, database_of, library, limb
from paper import cut, find, method_alone, options, print_table

import priorfill as pf
from priorfill.cli.encoding import replace_what_is_lacking
from priorfill.geometry.root_frames import root_group
from priorfill.markers.definitions import load
from priorfill.search.bank import PoseBank
from priorfill.search.takes import takes_from

NAMES = ("hdm05/HDM_bd_05-01_01_120.c3d",)
SECONDS = (1.0, 2.0, 4.0, 8.0)
MORE_SECONDS = (16.0,)
EDGE = 5.0
"""s. Minimum length of a recording beyond its longest gap."""

PAPER_SLOPE = 10.0
"""Computing time per second of gap in the paper: about ten seconds, on a machine of 2011."""

PAPER_TREE = "a few"
"""Seconds to build the kd-tree in the paper."""


def filling_time(clip: pf.Clip, database: object, method: str, repeat: int) -> float:
    """Return the minimum CPU seconds of several fills."""
    least = np.inf
    for _ in range(repeat):
        began = time.process_time()
        result = pf.fill(clip, database=database, method=method, options=method_alone())
        least = min(least, time.process_time() - began)
        if not result.complete:
            raise SystemExit(f"{clip.name}: {method} did not fill the gap")
    return float(least)


def tree_time(clip: pf.Clip, database: pf.PriorDatabase, arm: list[str]) -> tuple[float, int]:
    """Return the CPU seconds to read a database and build its index, and its poses."""
    marker_set = load("baumann41")
    wanted = [clip.labels.index(label) for label in arm]
    viable = [i for i, x in enumerate(clip.labels) if marker_set.reliable[x] and i not in wanted]
    pelvis = [i for i, x in enumerate(clip.labels) if marker_set.segment[x] == "pelvis"]
    root = root_group(clip.positions, pelvis)
    if root is None:
        raise SystemExit(f"{clip.name}: no frame shows the whole pelvis")
    began = time.process_time()
    takes = takes_from(database, database.clips(), clip.labels)
    bank = PoseBank(takes, root, np.array(viable), np.array(wanted), database.rate)
    return time.process_time() - began, len(bank)


def main() -> int:
    """Print the figure."""
    parser = options(__doc__, recording=RECORDING, full="longer gaps, each three times")
    arguments = parser.parse_args()
    file = find(NAMES, arguments.data, arguments.recording)
    clip = pf.read(file)
    arm = limb("arm", "left")
    seconds = [
        s
        for s in SECONDS + MORE_SECONDS * arguments.full
        if s + EDGE <= clip.duration and set(arm) <= set(clip.labels)
    ]
    if len(seconds) < 2:
        raise SystemExit(f"{file}: shorter than {SECONDS[1] + EDGE} s, or without {' '.join(arm)}")
    priors = [take for take in library(arguments.data) if take.file.stem != file.stem]
    print(f"Paper: recording not identified. Here: {file.name}, {arm[0]} ...")
    rows: list[list[str | float | None]] = []
    with database_of(priors) as database:
        for method in METHODS:
            times = []
            for length in seconds:
                start = (clip.frames - round(length * clip.rate)) // 2
                gappy = cut(clip, start, start + round(length * clip.rate), arm)
                if not times:  # compile, fill caches
                    pf.fill(gappy, database=database, method=method, options=method_alone())
                repeat = 3 if arguments.full else 1
                times.append(filling_time(gappy, database, method, repeat))
            slope, fixed = np.polyfit(seconds, times, 1)
            paper = PAPER_SLOPE if method == "baumann2011" else None
            rows.append([method, *times, float(fixed), float(slope), paper])
        with pf.PriorDatabase.open(database) as opened:
            built, poses = tree_time(clip, opened, arm)
    print_table(
        "Processor seconds of a fill, by seconds of gap, and the line through them",
        ["method", *(f"{s:.0f} s" for s in seconds), "fixed", "per s of gap", "paper, per s"],
        rows,
    )
    print_table(
        "Seconds to read a database and to build the index",
        ["poses", "ours", "paper"],
        [[str(poses), built, PAPER_TREE]],
    )
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
