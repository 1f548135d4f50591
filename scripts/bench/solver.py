#!/usr/bin/env python
"""Scheduled descent compared with plain descent and the banded solve, by gap length.

    python scripts/bench/solver.py [--seconds 1,2,5,10,20,40,60] [--repeat 5]

Fills six markers at 120 Hz, coarse to fine as a fill does. The prior is the true motion plus a
smooth random error of centimetres, with weights that decrease towards the middle of the gap. Plain
descent updates each frame by itself, all of them in each step. Times are CPU seconds of the solver
alone. Updates are those of frames, relative to plain descent and to updating all blocks in each
step. The last columns are distances (mm) from the minimum.

A second table shows what levels and schedule are worth: the same with the finest level alone, and
with all blocks in each step. Exit status 1: a bound is exceeded.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable

import numpy as np

from priorfill.cli.encoding import replace_what_is_lacking
from priorfill.energy.multiresolution import levels_for, solve_levels
from priorfill.energy.solver import (
    DescentOptions,
    Solution,
    minimise,
    solve_exactly,
)
from priorfill.energy.targets import Prior
from priorfill.gaps import Gap, GapGroup
from priorfill.signal.resample import Resolution

RATE = 120.0
"""Hz."""

MARKERS = 6

BESIDE = 2.0
"""Measured seconds on either side."""

PLAIN = DescentOptions(min_gain_ratio=0.0, block_frames=1)
"""All frames in each step, one by one."""

UNSCHEDULED = DescentOptions(min_gain_ratio=0.0)
"""All blocks in each step."""

SLOWER, PART = 3.0, 0.5
"""Bounds: time relative to the banded solve, and updates relative to plain descent."""


def wandering(rng: np.random.Generator, frames: int, size: float, hertz: float) -> np.ndarray:
    """Return a smooth random signal [shape=(frames, MARKERS, 3), mm]."""
    knots = np.arange(0.0, frames + RATE / hertz, RATE / hertz)
    values = rng.normal(0.0, size, (len(knots), MARKERS * 3))
    course = [np.interp(np.arange(frames), knots, value) for value in values.T]
    return np.stack(course, axis=1).reshape(frames, MARKERS, 3)


def prior_of(
    predicted: np.ndarray, expected_rms: np.ndarray
) -> Callable[[Resolution, np.ndarray], Prior]:
    """Return the prior of any level, from predictions for all frames [frames, MARKERS, 3]."""

    def at(level: Resolution, window: np.ndarray) -> Prior:
        prior = Prior.empty(len(window), MARKERS)
        frames = window * level.step
        inside = np.flatnonzero((frames >= level.step) & (frames < len(predicted) - level.step))
        here = frames[inside]
        before, now, after = (predicted[here + d] for d in (-level.step, 0, level.step))
        weight = np.repeat(expected_rms[here, None] ** -2.0, MARKERS, axis=1)
        stiff = (0.05 * level.rate) ** 2
        prior.pose[inside], prior.pose_weight[inside] = now, weight
        prior.velocity[inside], prior.velocity_weight[inside] = (
            0.5 * (after - before),
            2 * stiff * weight,
        )
        prior.acceleration[inside] = after - 2.0 * now + before
        prior.acceleration_weight[inside] = stiff**2 * weight
        return prior

    return at


SOLVERS: dict[str, tuple[int | None, Callable[..., Solution]]] = {
    "scheduled": (None, minimise),
    "plain": (None, lambda *given: minimise(*given, PLAIN)),
    "unscheduled": (None, lambda *given: minimise(*given, UNSCHEDULED)),
    "one level": (1, minimise),
    "one level, unscheduled": (1, lambda *given: minimise(*given, UNSCHEDULED)),
    "banded": (None, solve_exactly),
}
"""Number of levels (None: all) and solver."""

COMPARED = ("scheduled", "unscheduled", "one level", "one level, unscheduled")
"""Columns of the second table."""


def solved(
    levels: list[Resolution],
    group: GapGroup,
    prior: Callable[[Resolution, np.ndarray], Prior],
    solver: Callable[..., Solution],
    repeat: int,
) -> tuple[float, int, np.ndarray]:
    """Return the least CPU seconds of the solver, its updates, and the positions."""
    spent = []
    for _ in range(repeat):
        total, count = 0.0, 0

        def timed(*given: np.ndarray) -> Solution:
            nonlocal total, count
            began = time.process_time()
            solution = solver(*given)
            total += time.process_time() - began
            count += solution.updates
            return solution

        found = solve_levels(levels, group, prior, timed)
        spent.append(total)
    return min(spent), count, found


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", default="1,2,5,10,20,40,60")
    parser.add_argument("--repeat", type=int, default=5)
    arguments = parser.parse_args()
    without: list[str] = []
    print(
        f"{'gap s':>6s} {'scheduled':>10s} {'plain':>10s} {'banded':>10s} {'of banded':>10s}",
        end="",
    )
    print(f" {'updates':>10s} {'of plain':>9s} {'of all':>7s} {'mm off':>8s} {'plain':>8s}")
    held = True
    for number, seconds in enumerate([0.2, *map(float, arguments.seconds.split(","))]):
        rng = np.random.default_rng(number)
        frames = round((seconds + 2 * BESIDE) * RATE)
        truth = wandering(rng, frames, 300.0, 2.0)
        predicted = truth + wandering(rng, frames, 30.0, 5.0)
        start, stop = round(BESIDE * RATE), frames - round(BESIDE * RATE)
        inside = np.clip(np.arange(frames), start, stop - 1)
        expected_rms = 1.0 + 20.0 * np.minimum(inside - start, stop - inside) / (stop - start)
        positions = truth.copy()
        positions[start:stop] = np.nan
        levels = [Resolution(positions, RATE, 2**i) for i in range(levels_for(RATE))]
        gaps = tuple(Gap(start, stop, marker) for marker in range(MARKERS))
        group = GapGroup(start, stop, gaps)
        prior = prior_of(predicted, expected_rms)
        times, updates, found = {}, {}, {}
        for name, (used, solver) in SOLVERS.items():
            times[name], updates[name], found[name] = solved(
                levels[:used], group, prior, solver, arguments.repeat
            )
        if number == 0:
            continue  # compiles
        off = {n: np.linalg.norm(x - found["banded"], axis=2).max() for n, x in found.items()}
        # where the clock of processor time is coarse (Windows: 16 ms), a short one can be zero
        slower = times["scheduled"] / max(
            times["banded"], time.get_clock_info("process_time").resolution
        )
        part = updates["scheduled"] / updates["plain"]
        held &= slower <= SLOWER and part <= PART
        print(
            f"{seconds:6.1f} {times['scheduled']:10.4f} {times['plain']:10.4f} "
            f"{times['banded']:10.4f} {slower:10.2f} "
            f"{updates['scheduled']:10d} {part:9.2f} "
            f"{updates['scheduled'] / updates['unscheduled']:7.2f} "
            f"{off['scheduled']:8.3f} {off['plain']:8.3f}",
            flush=True,
        )
        without.append(
            f"{seconds:6.1f}"
            + "".join(f" {updates[n]:10d} {times[n]:8.4f} {off[n]:8.3f}" for n in COMPARED)
        )
    print("\nupdates, seconds and mm off: " + "; ".join(COMPARED))
    print("\n".join(without))
    print(f"bounds {SLOWER}, {PART}: {'kept' if held else 'EXCEEDED'}")
    return 0 if held else 1


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
