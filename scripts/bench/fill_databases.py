#!/usr/bin/env python
"""CPU time and memory of a fill by database size.

    python scripts/bench/fill_databases.py [--data DIR] [--poses 1e4,1e5,1e6] [--seconds 2]
                                           [--threads 1] [--folder DIR]

Removes a marker, or an arm, from a 49 s recording of HDM05 and runs ``priorfill fill -m gpr`` with
databases of different numbers of poses at 30 Hz. The databases consist of takes of 20 s, three for
each of hundreds of subjects: stretches of all recordings, scaled, rotated, slower or faster, with
noise (see `database.py`), and mirrored for every other subject. Building them is not included:
10^6 poses take a minute or two and 0.9 GB of disk, 10^7 ten times that. ``--folder`` keeps them
for later runs.

Each fill is a process of its own. Printed are CPU and wall seconds, including start, reading and
writing, and peak resident memory, in which memory-mapped pages of the database count. A first run,
which compiles, is not included.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np
from child import CLI, DONE, run

from priorfill.cli.encoding import replace_what_is_lacking

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
from fill import ARM, START, TAKE
from recordings import add_data_option

import priorfill as pf
from database import minutes, recordings
from priorfill.formats import create_c3d
from priorfill.geometry.mirror import mirrored
from priorfill.markers.definitions import load
from priorfill.markers.left_right import contralateral_markers

RATE = 30.0
"""Rate of the database, Hz."""

SECONDS = 20.0
"""Length of a take, s."""

GONE = {"marker": ("LFRM",), "arm": tuple("L" + name for name in ARM)}
"""Markers removed together."""


def database(folder: Path, data: Path, poses: int) -> Path:
    """Build a database of a number of poses, unless it exists."""
    made = folder / f"database{poses}"
    if made.exists():
        return made
    definition = load("baumann41")
    labels = definition.labels
    mirror = contralateral_markers(labels, definition)
    rng = np.random.default_rng(0)
    source = minutes(recordings(data, RATE), RATE, rng)
    frames = round(SECONDS * RATE)
    unfinished = folder / f"unfinished{poses}"
    shutil.rmtree(unfinished, ignore_errors=True)  # left by an interrupted run
    body = stored = 0
    with pf.PriorDatabase.create(unfinished) as writer:
        while stored < poses:
            minute = next(source)
            minute = mirrored(minute, mirror) if body % 2 else minute
            for at in range(0, len(minute), frames):
                take = minute[at : at + frames]
                clip = pf.Clip(take, labels, RATE, name=f"b{body}_{at}", subject=f"b{body}")
                stored += writer.add(clip).frames[0]
            body += 1
    return unfinished.rename(made)


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_data_option(parser)
    parser.add_argument("--poses", default="1e4,1e5,1e6")
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--repeat", type=int, default=2, help="number of runs; the fastest counts")
    parser.add_argument("--folder", type=Path, help="folder that keeps the databases")
    arguments = parser.parse_args()
    take = arguments.data / TAKE
    if not take.exists():
        print(f"{take}: file not found; name the folder of recordings with --data", file=sys.stderr)
        return 1
    whole = pf.read(take)
    stop = START + round(arguments.seconds * whole.rate)
    with tempfile.TemporaryDirectory() as temporary:
        work = Path(temporary)
        for part, labels in GONE.items():
            positions = whole.positions.copy()
            positions[START:stop, [whole.labels.index(label) for label in labels]] = np.nan
            gappy = pf.Clip(positions, whole.labels, whole.rate, whole.up)
            create_c3d(work / f"{part}.c3d", gappy)
        print(f"{arguments.seconds:g} s missing, {arguments.threads} threads\n")
        print(f"{'missing':8s} {'poses':>9s} {'cpu s':>7s} {'wall s':>7s} {'MB':>6s}")
        for poses in [0, *(int(float(text)) for text in arguments.poses.split(","))]:
            options = ["-m", "gpr", "--threads", str(arguments.threads), "--overwrite"]
            if poses:
                kept = database(arguments.folder or work, arguments.data, poses)
                options += ["--database", str(kept)]
            for part in GONE:
                line = [*CLI, "fill", str(work / f"{part}.c3d"), "-o", str(work / "out.c3d")]
                run([*line, *options], accepted=DONE)  # compile, and warm the file cache
                costs = [run([*line, *options], accepted=DONE) for _ in range(arguments.repeat)]
                best = min(costs, key=lambda cost: cost.cpu)
                print(
                    f"{part:8s} {poses:9d} {best.cpu:7.2f} {best.wall:7.2f} {best.memory:6.0f}",
                    flush=True,
                )
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
