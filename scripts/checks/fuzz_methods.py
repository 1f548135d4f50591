#!/usr/bin/env python
"""Check that every method fills small, odd clips, or gives a reason for what stays missing.

    python scripts/checks/fuzz_methods.py [--count 600] [--seed 1] [--first 0] [--minutes 10]
    [--methods gpr,lds]

Clips of 3 to 40 markers and 1 to 200 frames are made at random: bodies of rigid segments that move,
stand still, jump or collapse onto one line or place; tiny and huge; at 1 to 20,000 Hz; some with
another recording of the same subject. 10 to 70 % of the samples are missing, as scattered samples,
runs, frames, markers, every second frame or ends. Each clip is filled by each method, in a process
limited to 1 GB. Measured samples must keep their bits, filled ones must be finite and have an
expected error that is finite and not negative (or unknown, where the method has none), and every
other one must have a reason. Odd motion is rarely believed, so every second clip is filled without
the check of fills, and at its ends. A method may refuse a clip by a `PriorfillError` of one line.
Everything else, warnings included, is a failure, and so is a fill of more than 10 s of processor
time and 0.05 s for each gap. Exit status 1 if there was one. Equal seeds make equal clips.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from priorfill.cli.encoding import replace_what_is_lacking
from priorfill.clip import Clip
from priorfill.errors import PriorfillError
from priorfill.filling.fill_clip import fill
from priorfill.filling.fill_options import FillOptions
from priorfill.filling.result import Result
from priorfill.methods import METHODS

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
from method_alone import method_alone
from worker import DONE, Worker

SECONDS = 10.0
"""Processor time that a fill may take, if it has few gaps."""

SECONDS_PER_GAP = 0.05
"""Processor time that each gap may add: ``gpr`` fits a regression for each."""

TIMEOUT = 600.0
"""Wall time after which a fill counts as hung."""

MEMORY = 2**30
"""Memory limit per fill in addition to the program itself, bytes."""

MAX_MARKERS, MAX_FRAMES = 40, 200
RATES = (1.0, 7.5, 25.0, 30.0, 50.0, 100.0, 119.88, 120.0, 250.0, 500.0, 1000.0, 5000.0, 20_000.0)
SCALES = (1e-6, 1e-3, 0.1, 10.0, 1e3, 1e6)
"""Factors of the size of a body of 1.8 m, for some clips."""

_Random = np.random.Generator
_Floats = NDArray[np.float64]
_Mask = NDArray[np.bool_]


class Case(NamedTuple):
    """One fill: which seed makes the clip, and the method."""

    seed: int
    number: int
    method: str


def make_clips(seed: int, number: int) -> tuple[Clip, tuple[Clip, ...]]:
    """Return the clip of a seed and a number, and other recordings of the same subject."""
    rng = np.random.default_rng((seed, number))
    markers = int(rng.integers(3, MAX_MARKERS + 1))
    frames = int(rng.integers(1, MAX_FRAMES + 1) if rng.random() < 0.7 else rng.integers(1, 12))
    rate = float(rng.choice(RATES))
    labels = tuple(f"M{i}" for i in range(markers))
    rest = rng.uniform([-400, -200, 0], [400, 200, 1800], (markers, 3))
    scale = float(rng.choice(SCALES)) if rng.random() < 0.2 else 1.0
    others = []
    if rng.random() < 0.3:
        shown = scale * _moving(rest, int(rng.integers(1, MAX_FRAMES)), rate, rng)
        others.append(Clip(shown, labels, rate, name="other"))
    positions = _moving(rest, frames, rate, rng)
    for change in _some(CHANGES, rng, 0.12):
        change(positions, rng)
    positions *= scale
    positions[_missing(frames, markers, rng)] = np.nan
    return Clip(positions, labels, rate, name=f"clip{number}"), tuple(others)


def _moving(rest: _Floats, frames: int, rate: float, rng: _Random) -> _Floats:
    """Return a body of rigid segments that swing [shape=(frames, markers, 3), mm]."""
    time_s = np.arange(frames) / rate
    segment = rng.integers(max(1, len(rest) // 4), size=len(rest))
    count = int(segment.max()) + 1
    frequency, phase = rng.uniform(0.2, 2.0, (count, 3)), rng.uniform(0, 6.3, (count, 3))
    swing = rng.uniform(0, 200, (count, 3)) * np.sin(
        6.3 * frequency * time_s[:, None, None] + phase
    )
    walk = time_s[:, None, None] * rng.normal(0, 500, 3)
    noise = rng.normal(0, rng.choice([0.0, 0.1, 2.0]), (frames, len(rest), 3))
    return np.asarray(rest + swing[:, segment] + walk + noise)


def _some(
    choices: Sequence[Callable[..., None]], rng: _Random, share: float
) -> list[Callable[..., None]]:
    """Return each choice with some probability."""
    return [choice for choice in choices if rng.random() < share]


def _stand_still(positions: _Floats, rng: _Random) -> None:
    positions[:] = positions[0].copy()


def _one_stands_still(positions: _Floats, rng: _Random) -> None:
    marker = int(rng.integers(positions.shape[1]))
    positions[:, marker] = positions[0, marker].copy()


def _two_in_one_place(positions: _Floats, rng: _Random) -> None:
    one, other = rng.integers(positions.shape[1], size=2)
    positions[:, one] = positions[:, other]


def _all_in_one_place(positions: _Floats, rng: _Random) -> None:
    if rng.random() < 0.3:
        positions[:] = positions[:, :1].copy()


def _in_one_line(positions: _Floats, rng: _Random) -> None:
    axis = int(rng.integers(3))
    positions[..., axis] = positions[:, :1, axis].copy()
    if rng.random() < 0.5:
        positions[..., (axis + 1) % 3] = 0.0


def _jump(positions: _Floats, rng: _Random) -> None:
    at = int(rng.integers(len(positions)))
    positions[at:, : int(rng.integers(1, positions.shape[1] + 1))] += rng.normal(0, 2000, 3)


def _swap(positions: _Floats, rng: _Random) -> None:
    at = int(rng.integers(len(positions)))
    one, other = rng.integers(positions.shape[1], size=2)
    positions[at:, [one, other]] = positions[at:, [other, one]]


def _freeze(positions: _Floats, rng: _Random) -> None:
    at = int(rng.integers(len(positions)))
    positions[at:] = positions[at].copy()


def _round(positions: _Floats, rng: _Random) -> None:
    positions[:] = np.round(positions)


CHANGES: tuple[Callable[[_Floats, _Random], None], ...] = (
    *(_stand_still, _one_stands_still, _two_in_one_place, _all_in_one_place, _in_one_line),
    *(_jump, _swap, _freeze, _round),
)
"""What makes a clip odd."""


def _missing(frames: int, markers: int, rng: _Random) -> _Mask:
    """Return which samples are missing: patterns are added up to a random share."""
    missing = np.zeros((frames, markers), dtype=bool)
    wanted = rng.uniform(0.1, 0.7)
    kinds = [PATTERNS[i] for i in rng.choice(len(PATTERNS), int(rng.integers(1, 4)))]
    for _ in range(200):
        if missing.mean() >= wanted:
            break
        kinds[rng.integers(len(kinds))](missing, rng)
    return missing


def _scattered(missing: _Mask, rng: _Random) -> None:
    missing |= rng.random(missing.shape) < rng.uniform(0.01, 0.3)


def _runs(missing: _Mask, rng: _Random) -> None:
    for _ in range(3):
        start, marker = rng.integers(len(missing)), rng.integers(missing.shape[1])
        missing[start : start + rng.integers(1, 40), marker] = True


def _frames(missing: _Mask, rng: _Random) -> None:
    start = rng.integers(len(missing))
    missing[start : start + rng.integers(1, 1 + max(1, len(missing) // 8))] = True


def _nearly_frames(missing: _Mask, rng: _Random) -> None:
    start, kept = rng.integers(len(missing)), rng.integers(missing.shape[1], size=2)
    hidden = np.delete(np.arange(missing.shape[1]), kept)
    missing[start : start + rng.integers(1, 20), hidden] = True


def _marker(missing: _Mask, rng: _Random) -> None:
    missing[:, rng.integers(missing.shape[1])] = True


def _every_second_frame(missing: _Mask, rng: _Random) -> None:
    step = int(rng.integers(2, 4))
    columns = slice(None) if rng.random() < 0.5 else rng.integers(missing.shape[1], size=3)
    missing[int(rng.integers(step)) :: step, columns] = True


def _ends(missing: _Mask, rng: _Random) -> None:
    length = int(rng.integers(1, 1 + max(1, len(missing) // 4)))
    columns = slice(None) if rng.random() < 0.5 else rng.integers(missing.shape[1], size=5)
    if rng.random() < 0.5:
        missing[:length, columns] = True
    else:
        missing[len(missing) - length :, columns] = True


PATTERNS: tuple[Callable[[_Mask, _Random], None], ...] = (
    *(_scattered, _runs, _frames, _nearly_frames, _marker, _every_second_frame, _ends),
)
"""Where samples are missing."""


def run_case(case: Case) -> tuple[str, float]:
    """Fill a clip; return how it ended, and the processor time (s)."""
    clip, others = make_clips(case.seed, case.number)
    start = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            options = method_alone() if case.number % 2 else FillOptions()
            result = fill(clip, method=case.method, same_subject=others, options=options)
    except PriorfillError as error:
        if "\n" in str(error):
            raise AssertionError(f"a message of several lines: {error!r}") from error
        return "refused", time.process_time() - start
    seconds = time.process_time() - start
    check(clip, result)
    allowed = SECONDS + SECONDS_PER_GAP * len(result.gaps)
    if seconds > allowed:
        raise AssertionError(f"took {seconds:.1f} s; {allowed:.1f} s are allowed")
    if not result.filled.any():
        return "nothing filled", seconds
    return "filled" if result.complete else "partly filled", seconds


def check(clip: Clip, result: Result) -> None:
    """Check what holds for every result."""
    measured, filled = ~clip.missing, result.filled
    if result.clip.positions[measured].tobytes() != clip.positions[measured].tobytes():
        raise AssertionError("a measured sample was changed")
    if (filled & measured).any() or not np.isfinite(result.clip.positions[filled]).all():
        raise AssertionError("a filled sample was measured, or is not finite")
    if not np.isnan(result.clip.positions[clip.missing & ~filled]).all():
        raise AssertionError("a sample that was not filled has a position")
    for name in ("expected_rms_mm", "error_bound_90_mm"):
        expected = getattr(result, name)[filled]
        if result.method == "gpr" and not np.isfinite(expected).all():
            raise AssertionError(f"{name} is not finite")
        if (expected < 0).any() or np.isinf(expected).any():
            raise AssertionError(f"{name} is negative or infinite")
    reasons = np.zeros_like(filled)
    for gap in result.gaps:
        for span in gap.unfilled:
            if not span.reason or "no finite position" in span.reason:
                raise AssertionError(f"no reason for what stays missing of {gap.label}")
            reasons[span.start : span.stop, clip.labels.index(gap.label)] = True
    if (reasons != (clip.missing & ~filled)).any():
        raise AssertionError("reasons are not those of the samples that stay missing")


def fuzz(
    methods: Sequence[str],
    count: int,
    seed: int,
    *,
    first: int = 0,
    minutes: float = float("inf"),
) -> tuple[Counter[str], list[str], float]:
    """Run cases; return how they ended, the faults, and the longest processor time (s)."""
    ends: Counter[str] = Counter()
    faults: list[str] = []
    slowest = 0.0
    stop = time.monotonic() + 60 * minutes
    preload = ("priorfill.filling.fill_clip",)
    with Worker(run_case, seconds=TIMEOUT, memory=MEMORY, preload=preload) as worker:
        for number in range(first, first + count):
            for method in methods:
                if time.monotonic() > stop:
                    return ends, faults, slowest
                outcome = worker.do(Case(seed, number, method))
                fault = "" if outcome.kind == DONE else f"{outcome.kind}: {outcome.value}"
                if not fault:
                    end, seconds = outcome.value
                    slowest = max(slowest, seconds)
                ends[f"{method:12} {'FAULT' if fault else end}"] += 1
                if fault:
                    faults.append(f"seed {seed}, number {number}, {method}: {fault}")
                    print(faults[-1], flush=True)
    return ends, faults, slowest


def main(arguments: Sequence[str] | None = None) -> int:
    """Fill odd clips and see."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=600, help="number of clips")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first clip")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="stop after this time")
    parser.add_argument("--methods", default=",".join(METHODS), help="comma-separated; default all")
    options = parser.parse_args(arguments)
    start = time.monotonic()
    ends, faults, slowest = fuzz(
        options.methods.split(","),
        options.count,
        options.seed,
        first=options.first,
        minutes=options.minutes,
    )
    for end, times in sorted(ends.items()):
        print(f"{times:7}  {end}")
    print(
        f"\n{ends.total()} fills in {time.monotonic() - start:.0f} s, the slowest "
        f"{slowest:.2f} s of computing; {len(faults)} faults"
    )
    return int(bool(faults))


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
