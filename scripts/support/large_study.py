"""Outcomes of the jobs of a large study, without fills."""

from __future__ import annotations

import random
from typing import Any

from priorfill.study.job import JobOutcome

FRAMES, MARKERS, RATE = 1000, 40, 100.0
"""Of a trial; Hz."""

IN_FOLDER = 10
"""Trials of a folder."""

MOST_GAPS = 12
"""Gaps of a trial are fewer."""


def large_study(trials: int, seed: int = 1) -> list[JobOutcome]:
    """Return the outcomes of a study: some trials failed, some have long or uncertain gaps.

    Parameters
    ----------
    trials : int
        Their number.
    seed : int
        Of the random numbers.
    """
    draw = random.Random(seed)
    return [_outcome(draw, f"P{n // IN_FOLDER}/walk {n % IN_FOLDER}.c3d") for n in range(trials)]


def _outcome(draw: random.Random, name: str) -> JobOutcome:
    source, output = f"/study/{name}", f"/filled/{name}"
    if draw.random() < 0.01:
        return JobOutcome(name, source, output, "failed", reason=f"{source}: no markers")
    facts = {
        "frames": FRAMES,
        "samples": FRAMES * MARKERS,
        "rate": RATE,
        "gaps": [_gap(draw, n) for n in draw.sample(range(MARKERS), draw.randrange(MOST_GAPS))],
    }
    report = f"{output}.html"
    return JobOutcome(name, source, output, "filled", facts=facts, report=report, seconds=5.0)


def _gap(draw: random.Random, marker: int) -> dict[str, Any]:
    frames = 1 + min(FRAMES, round(RATE * draw.expovariate(4.0)))
    error = round(draw.lognormvariate(1.0, 0.6), 3)
    return {
        "marker": f"M{marker:02d}",
        "first_frame": 1,
        "last_frame": frames,
        "frames": frames,
        "seconds": frames / RATE,
        "filled": frames,
        "expected_mean_error_mm": error,
        "error_bound_90_mm": 2 * error,
    }
