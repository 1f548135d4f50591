#!/usr/bin/env python
"""CPU seconds per second of gap, on a recording.

    python scripts/bench/fill.py [--data DIR] [--seconds 0.5,2,8,20] [--takes 0,30,288]

Removes a marker, an arm, or both arms and a leg from a 49 s recording of HDM05, and fills them by
each method with databases of other HDM05 takes (0: from the clip alone). Baumann et al. 2011
(fig. 2) report about 10 s of computing per second of gap. Compiling, reading and building the
databases is not included. The last column is relative to the first method of the same run; the line
below each block is a linear fit over gap lengths, with its largest residual.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from priorfill.cli.encoding import replace_what_is_lacking

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
from method_alone import method_alone
from recordings import add_data_option

import priorfill as pf

TAKE = "hdm05/HDM_bd_05-01_01_120.c3d"
PRIORS = "hdm05_cut_markers"
ARM = ("UPA", "ELB", "FRM", "WRA", "WRB", "FIN")
LEG = ("THI", "KNE", "SHN", "ANK", "HEE", "TOE", "MT5")
PARTS = {
    "marker": ("LFRM",),
    "arm": tuple("L" + name for name in ARM),
    "arms, leg": tuple(side + name for side in "LR" for name in ARM)
    + tuple("R" + name for name in LEG),
}
"""Markers removed together: one marker, one limb, three limbs."""

START = 2400
"""First frame of the gap, near the middle of the recording."""

METHODS = ("baumann2011", "gpr")
PUBLISHED = 10.0
"""Seconds of computing per second of gap in Baumann et al. 2011."""


def best_time(clip: pf.Clip, repeat: int, **options: object) -> tuple[float, float]:
    """Return the minimum wall and CPU seconds of several fills."""
    walls, cpus = [], []
    for _ in range(repeat):
        wall, cpu = time.perf_counter(), time.process_time()
        result = pf.fill(clip, options=method_alone(), **options)
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
        assert result.complete, "the benchmark's gap must be filled"
    return min(walls), min(cpus)


def databases(folder: Path, files: list[Path], sizes: list[int]) -> dict[int, Path | None]:
    """Build a database for each number of takes; None for 0."""
    made: dict[int, Path | None] = {}
    for size in sizes:
        made[size] = None
        if size:
            made[size] = folder / str(size)
            with pf.PriorDatabase.create(made[size]) as writer:
                for file in files[:: max(1, len(files) // size)][:size]:
                    writer.add(pf.read(file))
                poses = sum(record.frames[0] for record in writer.clips())
            print(f"database of {size} takes: {poses} poses at 30 Hz")
    return made


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_data_option(parser)
    parser.add_argument("--seconds", default="0.5,2,8,20")
    parser.add_argument("--takes", default="0,30,288", help="takes of each database")
    parser.add_argument("--methods", default=",".join(METHODS))
    parser.add_argument("--repeat", type=int, default=1)
    arguments = parser.parse_args()
    take = arguments.data / TAKE
    if not take.exists():
        print(f"{take}: file not found; name the folder of recordings with --data", file=sys.stderr)
        return 1
    lengths = [float(s) for s in arguments.seconds.split(",")]
    whole = pf.read(take)
    files = sorted((arguments.data / PRIORS).glob("*.c3d"))
    with tempfile.TemporaryDirectory() as folder:
        print(f"{take.name}: {whole.duration:.0f} s at {whole.rate:.0f} Hz")
        sizes = [int(size) for size in arguments.takes.split(",")]
        priors = databases(Path(folder), files, sizes)
        print(
            f"\n{'missing':10s} {'takes':>5s} {'method':12s} {'gap s':>6s} {'wall s':>7s}", end=""
        )
        print(f" {'cpu s':>7s} {'cpu s/s':>8s} {'of paper':>9s} {'of first':>9s}")
        for part, labels in PARTS.items():
            gone = [whole.labels.index(label) for label in labels]
            for size, prior in priors.items():
                reference: dict[float, float] = {}
                for method in arguments.methods.split(","):
                    cpus = []
                    for seconds in lengths:
                        positions = whole.positions.copy()
                        positions[START : START + round(seconds * whole.rate), gone] = np.nan
                        clip = whole.with_positions(positions)
                        if not cpus:  # compile, fill caches
                            pf.fill(clip, database=prior, method=method, options=method_alone())
                        wall, cpu = best_time(clip, arguments.repeat, database=prior, method=method)
                        cpus.append(cpu)
                        ratio = cpu / reference.setdefault(seconds, cpu)
                        print(
                            f"{part:10s} {size:5d} {method:12s} {seconds:6.1f} {wall:7.2f} "
                            f"{cpu:7.2f} {cpu / seconds:8.3f} {wall / seconds / PUBLISHED:9.3f} "
                            f"{ratio:9.2f}",
                            flush=True,
                        )
                    slope, fixed = np.polyfit(lengths, cpus, 1)
                    off = np.abs(np.polyval([slope, fixed], lengths) - cpus).max()
                    print(
                        f"  {fixed:.2f} s + {slope:.3f} s CPU per second of gap; "
                        f"largest residual {off:.2f} s"
                    )
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
