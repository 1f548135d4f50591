#!/usr/bin/env python
"""Compare synthetic recordings with stored ones, or store them anew.

    python scripts/golden_motions.py [--write]

Tests, benchmarks and the golden accuracies (``golden.py``) use synthetic recordings, so a change of
the generator changes what they measure. Some coordinates of a recording of each motion, by several
bodies and styles, are stored in ``tests/golden/motions.json``. ``--write`` stores those that differ
and prints by how much.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from priorfill.cli.encoding import replace_what_is_lacking
from priorfill.synthetic import MOTIONS, Body, Noise, Style, synthesise

STORED = Path(__file__).resolve().parent.parent / "tests" / "golden" / "motions.json"

SAMPLES = 240
"""Coordinates stored of each recording, evenly spaced over frames and markers."""

MILLIMETRES = 0.02
"""mm. Greatest difference of a coordinate that counts as reproduced."""

VARIANTS = {
    "plain": (Body(), Style(variability=0.0, drift=0.0), Noise(0.0, 0.0), 0),
    "varied": (Body(seed=7), Style(variability=1.5, asymmetry=0.1, arm_swing=1.3), Noise(), 5),
    "wide": (
        Body(height=1600, seed=3),
        Style(step_width=160.0, toe_out=15.0, lean=5.0, amplitude=0.8, turn_rate=-60.0),
        Noise(2.0, 0.5),
        11,
    ),
}
"""Body, style, noise and seed of each variant."""


def samples(name: str) -> list[float]:
    """Return the sampled coordinates (mm) of a recording, ``MOTION VARIANT``."""
    motion, variant = name.split()
    body, style, noise, seed = VARIANTS[variant]
    clip = synthesise(
        motion, seconds=4.0, rate=30.0, body=body, style=style, noise=noise, seed=seed
    )
    values = clip.positions.ravel()
    chosen = np.linspace(0, len(values) - 1, SAMPLES).round().astype(np.intp)
    return [round(float(value), 3) for value in values[chosen]]


def names() -> list[str]:
    """Return the names of all recordings."""
    return [f"{motion} {variant}" for motion in MOTIONS for variant in VARIANTS]


def stored_samples() -> dict[str, list[float]]:
    """Return the stored coordinates by the name of the recording."""
    return json.loads(STORED.read_text("utf-8")) if STORED.exists() else {}


def difference(found: list[float], stored: list[float] | None) -> float:
    """Return the greatest difference of two recordings (mm); infinite where none is stored."""
    if stored is None or len(found) != len(stored):
        return float("inf")
    return float(np.abs(np.subtract(found, stored)).max())


def main() -> int:
    """Print the difference of each recording; store those that differ if asked to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help=f"store them in {STORED.name}")
    options = parser.parse_args()
    stored = stored_samples()
    kept = {}
    for name in names():
        found = samples(name)
        away = difference(found, stored.get(name))
        reproduced = away <= MILLIMETRES
        print(f"{name:20} {away:10.4f} mm  {'same' if reproduced else 'differs'}")
        kept[name] = stored[name] if reproduced else found
    if options.write:
        lines = ",\n".join(f"{json.dumps(name)}: {json.dumps(kept[name])}" for name in kept)
        STORED.write_text("{\n" + lines + "\n}\n", "utf-8", newline="\n")
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
