#!/usr/bin/env python
"""Baumann et al. 2011, figure 2: computing time by gap length.

    python scripts/papers/baumann_fig2.py [--data DIR] [--database DIR] [--repeat N]

The left arm is removed from the longest take of the library for 1 to 8 s, and filled from all other
takes. Times are CPU seconds, summed over cores, without compiling and building the database. The
paper names neither the recordings of its plot nor their rate; its text has about ten times the
length of the longest gap, on a processor of 2011.
"""

from __future__ import annotations

import sys
import time
from glob import escape

import numpy as np
from baumann import ARM, METHODS, Library, opened, parser_of, print_data
from paper import Comparison, cut, method_alone, print_table

import priorfill as pf
from priorfill.cli.encoding import replace_what_is_lacking
from priorfill.geometry.root_frames import root_group
from priorfill.markers.definitions import load
from priorfill.search.bank import PoseBank
from priorfill.search.takes import takes_from

SECONDS = (1.0, 2.0, 4.0, 8.0)

MAX_SHARE = 0.8
"""Part of the longest take that a gap may be."""

PAPER_RATIO = "10"
"""Computing time per second of the longest gap."""

PAPER_TREE = "a few"
"""Seconds to build the kd-tree."""


def filling_time(gappy: pf.Clip, library: Library, name: str, method: str, repeat: int) -> float:
    """Return the least CPU seconds of several fills."""
    least = np.inf
    options = method_alone(pf.Selection(not_names=(escape(name),)))
    for _ in range(repeat):
        began = time.process_time()
        result = pf.fill(gappy, database=library.path, method=method, options=options)
        least = min(least, time.process_time() - began)
        if not result.complete:
            raise SystemExit(f"{name}: {method} did not fill the gap")
    return float(least)


def search_time(clip: pf.Clip, library: Library) -> tuple[float, int]:
    """Return the CPU seconds to read a library, index it, and search one frame; and its poses."""
    marker_set = load("baumann41")
    wanted = [clip.labels.index(label) for label in ARM]
    viable = [
        i
        for i, x in enumerate(clip.labels)
        if marker_set.reliable.get(x, False) and i not in wanted
    ]
    pelvis = [i for i, x in enumerate(clip.labels) if marker_set.segment.get(x) == "pelvis"]
    root = root_group(clip.positions, pelvis)
    complete = np.flatnonzero(np.isfinite(clip.positions).all(axis=(1, 2)))
    if root is None or not len(complete):
        raise SystemExit(f"{clip.name}: no frame shows all markers")
    frame = clip.positions[complete[:1]]
    began = time.process_time()
    with pf.PriorDatabase.open(library.path) as database:
        takes = takes_from(database, database.clips(), clip.labels)
        bank = PoseBank(takes, root, np.array(viable), np.array(wanted), database.rate)
        bank.search(frame, root.frames(frame), 1)
    return time.process_time() - began, len(bank)


def main() -> int:
    """Print the figure."""
    parser = parser_of(__doc__)
    parser.add_argument("--repeat", type=int, default=1, help="fills of each gap; the least counts")
    arguments = parser.parse_args()
    rows: list[list[str | float | None]] = []
    ratios = {}
    with opened(arguments) as library:
        record = max(library.records, key=lambda r: (r.frames[0], r.name))
        clip = library.truth(record)
        seconds = [s for s in SECONDS if s <= MAX_SHARE * clip.duration]
        if len(seconds) < 2:
            raise SystemExit(f"{clip.name}: is shorter than {SECONDS[1] / MAX_SHARE:g} s")
        print_data(library, [])
        print(f"Filled:  {clip.name}, {ARM[0]} ... in its middle")
        for method in METHODS:
            times = []
            for length in seconds:
                frames = round(length * clip.rate)
                start = (clip.frames - frames) // 2
                gappy = cut(clip, start, start + frames, ARM)
                if not times:  # compile, fill caches
                    filling_time(gappy, library, clip.name, method, 1)
                times.append(filling_time(gappy, library, clip.name, method, arguments.repeat))
            ratio = times[-1] / seconds[-1]
            ratios[method] = ratio
            paper = PAPER_RATIO if method == METHODS[0] else None
            rows.append([method, *times, ratio, paper])
        built, poses = search_time(clip, library)
    print_table(
        "Processor seconds of a fill, by seconds of gap, and those of the longest by its length",
        ["method", *(f"{s:.0f} s" for s in seconds), "per s of gap", "paper"],
        rows,
    )
    print_table(
        "Seconds to read the library, index its poses and search one frame",
        ["poses", "ours", "paper, kd-tree"],
        [[str(poses), built, PAPER_TREE]],
    )
    comparison = Comparison("s")
    comparison.add(
        "time per second of gap",
        ratios[METHODS[0]],
        PAPER_RATIO,
        "a processor of 2011, unoptimised; here blocks of frames are solved exactly",
    )
    comparison.print()
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
