#!/usr/bin/env python
"""How time and memory of a fill grow with frames, markers, gaps and their length.

    python scripts/bench/scale.py [RECORDING] [--method gpr] [--axes frames,markers,...] [--quick]

Along each axis the other sizes are those of `BASE`. Clips are made from a recording, or from
synthetic motion: more frames by playing it forwards and backwards, more markers by further bodies
next to the first one, each at another place and time of the motion. Each clip is inspected and
filled in processes of their own. Each row gives CPU seconds, the ratio to `linear`, peak memory,
and microseconds per unit: without the start of a program, per sample of the clip along the axes
``frames`` and ``markers``, per gap along those of gaps, per missing sample along ``length``. The
last column is the exponent of growth since the row above: 1 is linear.

Patterns of gaps: ``clean``, one marker at a time; ``scattered``, anywhere; ``frayed``, every second
frame of one marker; ``flickering``, six neighbouring markers that come and go.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from child import CLI, DONE, Cost, run
from long_clip import write

import priorfill as pf
from priorfill.cli.encoding import replace_what_is_lacking
from priorfill.gaps import find_gaps
from priorfill.geometry.poses import evenly_spaced, sample_complete_poses
from priorfill.synthetic import synthesise

SECONDS = 30.0
"""s. Length of the synthetic motion that clips are made from."""

RATE = 120.0
"""Hz. Of the synthetic motion."""

BODY_DISTANCE = 1500.0
"""mm between two bodies of a clip with many markers."""

TIME_SHIFT = 337
"""Frames between the motions of two bodies."""

FLICKERING = 6
"""Markers that flicker together."""

MEAN_RUN = 4
"""Frames for which a flickering marker stays visible or missing, on average."""

STRETCH = 200
"""Frames of a stretch in which markers fray or flicker."""

MIN_SECONDS = 0.05
"""s. Less CPU time than this, without the start, is not told from zero."""


@dataclass(frozen=True)
class Size:
    """Size of a clip and of its gaps; `length` in frames."""

    frames: int = 4000
    markers: int = 40
    gaps: int = 10
    length: int = 24
    pattern: str = "clean"


BASE = Size()
AXES: dict[str, list[Size]] = {
    "frames": [replace(BASE, frames=n, markers=20) for n in (1000, 10_000, 100_000, 1_000_000)],
    "markers": [replace(BASE, frames=1000, markers=n) for n in (20, 60, 240, 300, 600, 1200)],
    "length": [replace(BASE, frames=20_000, gaps=4, length=n) for n in (1, 10, 100, 1000, 4000)],
    **{
        pattern: [
            replace(BASE, frames=20_000, gaps=n, length=6, pattern=pattern)
            for n in (1, 10, 100, 1000, 10_000)
        ]
        for pattern in ("clean", "scattered", "frayed", "flickering")
    },
}
QUICK = {
    "frames": [replace(BASE, frames=n, markers=12, gaps=2) for n in (60, 240)],
    "frayed": [replace(BASE, frames=120, markers=12, gaps=n, pattern="frayed") for n in (2, 20)],
}
"""For a test of this script."""


def many(motion: np.ndarray, frames: int, markers: int) -> np.ndarray:
    """Return a motion [shape=(frames, markers, 3), mm] with the numbers of frames and markers."""
    there_and_back = np.concatenate([motion, motion[-2:0:-1]])
    own = motion.shape[1]
    bodies = -(-markers // own)
    columns = math.ceil(math.sqrt(bodies))
    positions = np.empty((frames, markers, 3))
    for body in range(bodies):
        chosen = evenly_spaced(own, min(own, markers - body * own))
        at = (np.arange(frames) + body * TIME_SHIFT) % len(there_and_back)
        place = BODY_DISTANCE * np.array([body % columns, body // columns, 0.0])
        first = body * own
        positions[:, first : first + len(chosen)] = there_and_back[at][:, chosen] + place
    return positions


def missing_samples(size: Size, rng: np.random.Generator) -> np.ndarray:
    """Return which samples are missing [shape=(frames, markers)]."""
    missing = np.zeros((size.frames, size.markers), dtype=bool)
    if size.pattern == "clean":
        for gap in range(size.gaps):
            start = round((gap + 0.5) / size.gaps * size.frames - 0.5 * size.length)
            missing[max(start, 1) : start + size.length, gap * 7 % size.markers] = True
    elif size.pattern == "scattered":
        starts = rng.integers(1, size.frames - 1, size.gaps)
        lengths = rng.integers(1, 2 * size.length, size.gaps)
        markers = rng.integers(0, size.markers, size.gaps)
        for start, length, marker in zip(starts, lengths, markers, strict=True):
            missing[start : start + length, marker] = True
    elif size.pattern == "frayed":
        for marker, start, stop in stretches(size, STRETCH // 2, rng):
            missing[start:stop:2, marker] = True
    else:
        per_stretch = FLICKERING * STRETCH // (2 * MEAN_RUN)
        for marker, start, stop in stretches(size, per_stretch, rng):
            changes = rng.random((stop - start, FLICKERING)) < 1.0 / MEAN_RUN
            gone = changes.cumsum(axis=0) % 2 == 1
            markers = (marker + np.arange(FLICKERING)) % size.markers
            missing[start:stop, markers] |= gone
    missing[[0, -1]] = False
    return missing


def stretches(size: Size, gaps: int, rng: np.random.Generator) -> Iterator[tuple[int, int, int]]:
    """Yield markers and frames of stretches that have a number of gaps each."""
    for first in range(0, size.gaps, gaps):
        frames = min(STRETCH * min(gaps, size.gaps - first) // gaps, size.frames - 2)
        start = int(rng.integers(1, size.frames - frames))
        yield int(rng.integers(size.markers)), start, start + max(frames, 2)


def costs(clip: Path, method: str) -> dict[str, Cost]:
    """Return what it takes to inspect a file, and to fill it by `linear` and by a method."""
    output = clip.with_suffix(".out.c3d")
    fill = [*CLI, "fill", str(clip), "-o", str(output), "--overwrite", "--threads", "1"]
    found = {"inspect": run([*CLI, "inspect", str(clip), "--json"])}
    for name in dict.fromkeys(("linear", method)):
        found[name] = run([*fill, "--method", name, "--json"], accepted=DONE)
    output.unlink()
    return found


def unit_count(axis: str, size: Size, missing: np.ndarray) -> int:
    """Return the number of units by which time is divided along an axis."""
    if axis in ("frames", "markers"):
        return size.frames * size.markers
    return int(missing.sum()) if axis == "length" else len(find_gaps(missing))


def measure_axis(
    axis: str, sizes: list[Size], motion: np.ndarray, rate: float, method: str, limit: float
) -> None:
    """Print a row for each size along an axis."""
    print(f"\n{axis}: frames, markers, gaps, missing samples; CPU s of each command")
    start: dict[str, float] = {}
    above: dict[str, tuple[float, float]] = {}
    for size in (replace(sizes[0], frames=60, markers=12, gaps=1, length=4), *sizes):
        rng = np.random.default_rng(1)
        missing = missing_samples(size, rng)
        positions = many(motion, size.frames, size.markers)
        positions[missing] = np.nan
        labels = tuple(f"M{marker:04d}" for marker in range(size.markers))
        with tempfile.TemporaryDirectory() as folder:
            clip = Path(folder) / "clip.c3d"
            write(clip, positions, labels, rate)
            del positions
            found = costs(clip, method)
        if not start:  # the smallest clip: what a program takes to begin
            start = {name: cost.cpu for name, cost in found.items()}
            continue
        units = unit_count(axis, size, missing)
        gaps = len(find_gaps(missing))
        print(f"{size.frames:8d} {size.markers:5d} {gaps:6d} {int(missing.sum()):7d}", end="")
        for name, cost in found.items():
            own = max(cost.cpu - start[name], 0.0)
            ratio = cost.cpu / found["linear"].cpu
            power = exponent(above.get(name), (units, own))
            print(
                f" | {name} {cost.cpu:7.2f} s {ratio:5.1f} {cost.memory:6.0f} MB"
                f" {1e6 * own / units:9.2f} us {power}",
                end="",
            )
            above[name] = units, own
        print(flush=True)
        if max(cost.cpu for cost in found.values()) > limit:
            print(f"above {limit:g} s: larger ones are left out")
            break


def exponent(one: tuple[float, float] | None, other: tuple[float, float]) -> str:
    """Return the exponent of growth between two (units, s), as text."""
    if one is None or one[1] < MIN_SECONDS or other[1] < MIN_SECONDS or other[0] <= one[0]:
        return "    "
    return f"{math.log(other[1] / one[1]) / math.log(other[0] / one[0]):4.2f}"


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording", nargs="?", type=Path, help="default: synthetic motion")
    parser.add_argument("--method", default="gpr")
    parser.add_argument("--axes", default=",".join(AXES), help=f"of {', '.join(AXES)}")
    parser.add_argument("--limit", type=float, default=200.0, help="CPU s that end an axis")
    parser.add_argument("--quick", action="store_true", help="tiny clips, to try the script")
    arguments = parser.parse_args()
    if arguments.recording:
        clip = pf.read(arguments.recording)
        shown = ~np.isnan(clip.positions[..., 0]).all(axis=0)
        motion = sample_complete_poses(clip.positions[:, shown], clip.frames)
    else:
        clip = synthesise("mixed", seconds=SECONDS if not arguments.quick else 1.0, rate=RATE)
        motion = clip.positions
    if len(motion) < 2:
        raise SystemExit(f"{arguments.recording}: has fewer than two complete frames")
    for axis, sizes in (QUICK if arguments.quick else AXES).items():
        if arguments.quick or axis in arguments.axes.split(","):
            measure_axis(axis, sizes, motion, clip.rate, arguments.method, arguments.limit)
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
