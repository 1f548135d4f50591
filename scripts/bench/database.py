#!/usr/bin/env python
"""Scaling of a prior database: size on disk, adding, opening, reading, filling.

    python scripts/bench/database.py [--poses 1e5,1e6,1e7] [--data DIR] [--folder DIR] [--keep]

Fills a database with clips of one minute and 41 markers, made from recordings by cutting, rotating,
scaling, time warping and adding noise, and measures at each number of poses:

bytes/pose   of the whole folder, all levels, compared with 492 (41 markers as float32 at 30 Hz)
add s/h      seconds to add an hour of motion recorded at 120 Hz
add one ms   to add one more minute of 120 Hz to the open database; including opening and closing
open, list   ms to open it, and to list its records, in a new process
gather ms    100,000 random poses through the database, compared with the same bytes from a memory
             map
fill s, MB   ``priorfill fill`` of a clip with a marker missing throughout: wall time and peak
             memory, with and without the database

Making the clips is not included. 10 million poses need 9 GB of disk and some 20 minutes.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median

import numpy as np
from child import CLI, DONE, run
from numpy.typing import NDArray

from priorfill.cli.encoding import replace_what_is_lacking

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
from recordings import add_data_option

import priorfill as pf
from priorfill.formats import create_c3d
from priorfill.geometry.axes import to_upright
from priorfill.markers.definitions import load
from priorfill.signal.resample import resample

SOURCES = ("hdm05", "cmu", "hdm05_cut_markers")
MINUTE = 60.0
RAW_BYTES = 41 * 12
GATHERED = 100_000
ONE_MORE = 5
"""Number of clips of a minute at 120 Hz added at each size, for timing."""

OPENED = 3
"""Number of processes that open the database at each size, for timing."""

DROPPED = "LFIN"


def recordings(data: Path, rate: float) -> list[NDArray[np.float64]]:
    """Return the gap-free recordings of the 41 markers, upright, resampled to a rate (Hz)."""
    labels = load("baumann41").labels
    found = []
    for folder in SOURCES:
        for file in sorted((data / folder).glob("*.c3d")):
            clip = pf.read(file)
            if set(labels) <= set(clip.labels):
                order = [clip.labels.index(label) for label in labels]
                positions = to_upright(clip.positions[:, order], clip.up)
                if not np.isnan(positions).any() and clip.rate >= rate:
                    found.append(resample(positions, clip.rate, rate))
    return found


def minutes(
    pieces: list[NDArray[np.float64]], rate: float, rng: np.random.Generator
) -> Iterator[NDArray[np.float64]]:
    """Yield clips of one minute indefinitely [shape=(frames, 41, 3), mm]."""
    frames = round(MINUTE * rate)
    while True:
        parts: list[NDArray[np.float64]] = []
        length = 0
        scale = rng.uniform(0.9, 1.1)  # one body size per clip
        while length < frames:
            piece = pieces[rng.integers(len(pieces))]
            piece = piece[rng.integers(max(1, len(piece) // 2)) :][: round(20 * rate)]
            at = np.arange(0, len(piece) - 1, rng.uniform(0.8, 1.25))
            before = at.astype(int)
            share = (at - before)[:, None, None]
            warped = piece[before] * (1 - share) + piece[before + 1] * share
            angle = rng.uniform(0, 2 * np.pi)
            turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            warped[..., :2] = warped[..., :2] @ turn
            parts.append(warped * scale)
            length += len(warped)
        clip = np.concatenate(parts)[:frames]
        yield clip + rng.normal(0, 0.3, clip.shape)


def as_clip(positions: NDArray[np.float64], rate: float, number: int) -> pf.Clip:
    """Return positions as a clip of one of 50 subjects."""
    labels = load("baumann41").labels
    return pf.Clip(positions, labels, rate, name=f"clip{number}", subject=f"s{number % 50}")


def in_fresh_process(code: str, *arguments: object) -> list[float]:
    """Run code in a new process and return the numbers that it prints."""
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        check=True,
        capture_output=True,
        encoding="utf-8",
    )
    return [float(word) for word in done.stdout.split()]


OPEN = """
import sys, time
from priorfill.database import PriorDatabase
start = time.perf_counter()
database = PriorDatabase.open(sys.argv[1])
opened = time.perf_counter()
database.clips()
print(opened - start, time.perf_counter() - opened)
"""


def gather(folder: Path, rng: np.random.Generator) -> tuple[float, float]:
    """Return the seconds to read random poses through the database, and from a memory map."""
    with pf.PriorDatabase.open(folder) as database:
        records = database.clips()
        ends = np.cumsum([record.frames[0] for record in records])
        poses = np.sort(rng.integers(0, ends[-1], GATHERED))
        clip_of = np.searchsorted(ends, poses, side="right")
        frame_of = poses - np.concatenate([[0], ends])[clip_of]
        clips, starts = np.unique(clip_of, return_index=True)
        frames = np.split(frame_of, starts[1:])
        maps = {
            number: np.memmap(folder / "segments" / f"{number:06d}.f32", dtype="<f4", mode="r")
            for number in {record.segment for record in records}
        }
        bare, through = [], []
        for _ in range(3):
            start = time.perf_counter()
            for clip, wanted in zip(clips, frames, strict=True):
                record = records[clip]
                values = maps[record.segment]
                first = record.offset // 4
                values[first : first + record.frames[0] * 123].reshape(-1, 41, 3)[wanted]
            bare.append(time.perf_counter() - start)
            start = time.perf_counter()
            for clip, wanted in zip(clips, frames, strict=True):
                database.positions(records[clip])[wanted]
            through.append(time.perf_counter() - start)
    return min(through), min(bare)


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_data_option(parser)
    parser.add_argument("--poses", default="1e5,1e6,1e7")
    parser.add_argument("--folder", type=Path, help="working folder; by default a temporary one")
    parser.add_argument("--keep", action="store_true", help="keep the database in --folder")
    arguments = parser.parse_args()
    rng = np.random.default_rng(0)
    coarse = recordings(arguments.data, 30.0)
    if not coarse:
        print(f"{arguments.data}: no recordings with the 41 markers; use --data", file=sys.stderr)
        return 1
    fine = recordings(arguments.data, 120.0)
    take = pf.read(sorted((arguments.data / "hdm05").glob("*.c3d"))[0])
    with tempfile.TemporaryDirectory(dir=arguments.folder) as temporary:
        work = arguments.folder if arguments.keep and arguments.folder else Path(temporary)
        database, gappy = work / "database", work / "gappy.c3d"
        positions = take.positions[: round(10 * take.rate)].copy()
        positions[:, take.labels.index(DROPPED)] = np.nan
        create_c3d(gappy, pf.Clip(positions, take.labels, take.rate, take.up), overwrite=True)
        output = work / "filled.c3d"
        line = [*CLI, "fill", str(gappy), "-o", str(output), "--overwrite"]
        alone = run(line, accepted=DONE)
        print(f"without a database: fill {alone.wall:.2f} s, {alone.memory:.0f} MB\n")
        print(
            f"{'poses':>9s} {'clips':>6s} {'GB':>6s} {'bytes/pose':>11s} {'of 492':>7s} "
            f"{'add s/h':>8s} {'add one ms':>11s} {'+open ms':>9s} {'open ms':>8s} {'list ms':>8s} "
            f"{'gather ms':>10s} {'of map':>7s} {'fill s':>7s} {'MB':>6s}"
        )
        pf.PriorDatabase.create(database).close()
        source, one_more = minutes(coarse, 30.0, rng), minutes(fine, 120.0, rng)
        number = poses = 0
        first_add: list[float] = []
        for goal in [float(text) for text in arguments.poses.split(",")]:
            with pf.PriorDatabase.open(database, write=True) as writer:
                while poses < goal:
                    record = writer.add(as_clip(next(source), 30.0, number))
                    number, poses = number + 1, poses + record.frames[0]
                added = []
                for _ in range(ONE_MORE):
                    clip = as_clip(next(one_more), 120.0, number)
                    start = time.perf_counter()
                    record = writer.add(clip)
                    added.append(time.perf_counter() - start)
                    number, poses = number + 1, poses + record.frames[0]
            opened = []
            for _ in range(ONE_MORE):
                clip = as_clip(next(one_more), 120.0, number)
                start = time.perf_counter()
                with pf.PriorDatabase.open(database, write=True) as writer:
                    record = writer.add(clip)
                opened.append(time.perf_counter() - start)
                number, poses = number + 1, poses + record.frames[0]
            size = sum(path.stat().st_size for path in database.rglob("*") if path.is_file())
            times = [in_fresh_process(OPEN, database) for _ in range(OPENED)]
            through, bare = gather(database, rng)
            filled = run([*line, "--database", str(database)])
            first_add = first_add or [median(added), median(opened)]
            print(
                f"{poses:9d} {number:6d} {size / 1e9:6.2f} {size / poses:11.0f} "
                f"{size / poses / RAW_BYTES:7.2f} {median(added) * 3600 / MINUTE:8.2f} "
                f"{median(added) * 1e3:11.0f} {median(opened) * 1e3:9.0f} "
                f"{min(t[0] for t in times) * 1e3:8.0f} {min(t[1] for t in times) * 1e3:8.0f} "
                f"{through * 1e3:10.0f} {through / bare:7.2f} "
                f"{filled.wall:7.2f} {filled.memory:6.0f}",
                flush=True,
            )
        print(
            "\ncost of adding one clip, last size relative to the first: "
            f"{median(added) / first_add[0]:.2f} "
            f"(including opening and closing {median(opened) / first_add[1]:.2f})"
        )
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
