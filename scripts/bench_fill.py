#!/usr/bin/env python
"""Seconds of computing per second of gap, on a real recording.

    python scripts/bench_fill.py [--data DIR] [--seconds 1,2,4,8] [--repeat 3]

Takes a 49 s recording of the HDM05 library, removes the left arm for 1, 2, 4 and 8 s, and fills
it with each method from a prior database of other HDM05 motions and without one. Baumann et al.
2011 (fig. 2) report about 10 s of computing per second of gap. Compiling, reading and building the
database are not counted: they are done once, before the clock starts. The last column compares with
the first method in the same run; the last line of each block tells how far from linear in the gap's
length it is.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from recordings import add_data_option

import priorfill as pf

TAKE = "hdm05/HDM_bd_05-01_01_120.c3d"
PRIORS = "hdm05_cut_markers"
ARM = ("LUPA", "LELB", "LFRM", "LWRA", "LWRB", "LFIN")
START = 2400
"""First frame of the gap: in the middle of the recording."""

METHODS = ("baumann2011", "prior")
PUBLISHED = 10.0
"""Seconds of computing per second of gap in Baumann et al. 2011."""


def best_time(clip: pf.Clip, repeat: int, **options: object) -> tuple[float, float]:
    """Return the least wall and CPU seconds of some fills."""
    walls, cpus = [], []
    for _ in range(repeat):
        wall, cpu = time.perf_counter(), time.process_time()
        result = pf.fill(clip, **options)
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
        assert result.complete, "the benchmark's gap must be filled"
    return min(walls), min(cpus)


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_data_option(parser)
    parser.add_argument("--seconds", default="1,2,4,8")
    parser.add_argument("--repeat", type=int, default=3)
    arguments = parser.parse_args()
    take = arguments.data / TAKE
    if not take.exists():
        print(f"{take}: no such recording; name the folder with --data", file=sys.stderr)
        return 1
    lengths = [float(s) for s in arguments.seconds.split(",")]
    whole = pf.read(take)
    arm = [whole.labels.index(label) for label in ARM]
    with tempfile.TemporaryDirectory() as folder:
        database = Path(folder) / "priors"
        with pf.PriorDatabase.create(database) as writer:
            for file in sorted((arguments.data / PRIORS).glob("*.c3d")):
                writer.add(pf.read(file))
            poses = sum(record.frames[0] for record in writer.clips())
        print(
            f"{take.name}: {whole.duration:.0f} s at {whole.rate:.0f} Hz; {len(ARM)} markers gone"
        )
        print(f"database: {poses} poses at 30 Hz\n")
        print(f"{'method':12s} {'database':8s} {'gap s':>6s} {'wall s':>7s} {'cpu s':>7s}", end="")
        print(f" {'wall s/s':>9s} {'of paper':>9s} {'of ' + METHODS[0]:>15s}")
        for prior in (database, None):
            reference: dict[float, float] = {}
            for method in METHODS:
                walls = []
                for seconds in lengths:
                    positions = whole.positions.copy()
                    positions[START : START + round(seconds * whole.rate), arm] = np.nan
                    clip = whole.with_positions(positions)
                    if not walls:  # compile, fill caches
                        pf.fill(clip, database=prior, method=method)
                    wall, cpu = best_time(clip, arguments.repeat, database=prior, method=method)
                    walls.append(wall)
                    ratio = wall / reference.setdefault(seconds, wall)
                    print(
                        f"{method:12s} {'yes' if prior else 'no':8s} {seconds:6.1f} {wall:7.2f} "
                        f"{cpu:7.2f} {wall / seconds:9.3f} {wall / seconds / PUBLISHED:9.3f} "
                        f"{ratio:15.2f}",
                        flush=True,
                    )
                slope, fixed = np.polyfit(lengths, walls, 1)
                off = np.abs(np.polyval([slope, fixed], lengths) - walls).max()
                print(
                    f"  {fixed:.2f} s + {slope:.3f} s per second of gap; "
                    f"off that line by at most {off:.2f} s"
                )
    return 0


if __name__ == "__main__":
    sys.exit(main())
