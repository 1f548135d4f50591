"""Warnings of the page: how often each is given for fills that are right, and that are wrong.

    python scripts/studies/warning_study.py [--data FOLDER] [--seed N] [--count N]
        [--methods NAME,...]

Cuts gaps of every kind in recordings, fills them, and prints for each method and each class of mean
errors the share of the gaps with each warning; and the same for the true positions in the gaps,
where only the warnings on motion count. Gaps of one cut are alike, so shares differ between seeds.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter, defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np

from priorfill.cli.encoding import replace_what_is_lacking

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
sys.path.append(str(Path(__file__).resolve().parent))
from artificial_gaps import KINDS, cut_gaps
from recordings import add_data_option

import priorfill as pf
from priorfill.errors import PriorfillError
from priorfill.evaluation.body_parts import parts_of
from priorfill.report.gap_warnings import gap_warnings

RECORDINGS = (
    *("hdm05/HDM_bd_01-02_01_120.c3d", "hdm05/HDM_dg_06-03_03_120.c3d", "walkl/WalkL.c3d"),
    *("cmu/135_02.c3d", "cmu/141_04.c3d", "cmu/85_02.c3d", "cmu/132_32.c3d"),
    *("gait/HC002D06.c3d", "gait/HC040A14.c3d", "gait/HC034A07.c3d"),
)
"""Slow and fast motion; a known and an unknown marker set."""

MAX_FRAMES = 1500
"""Frames of a clip that are used, to limit the time."""

RIGHT, WRONG = 10.0, 30.0
"""mm. Mean errors below and above which a fill is right or wrong."""

MOTION = {"jump", "speed", "length", "floor"}
"""Warnings that depend on the positions in the gap; the others are the same for the truth."""


class Tally:
    """Numbers of gaps, of those with each warning, by class, and of clips not filled."""

    def __init__(self) -> None:
        self.gaps: Counter[str] = Counter()
        self.refused = 0
        self.given: dict[str, Counter[str]] = defaultdict(Counter)

    def add(self, name: str, kinds: set[str]) -> None:
        """Count one gap and its warnings."""
        self.gaps[name] += 1
        self.given[name].update(kinds)

    def show(self, method: str) -> None:
        """Print a line for each class."""
        for name, count in sorted(self.gaps.items()):
            shares = (f"{kind} {100 * n / count:.1f} %" for kind, n in self.given[name].items())
            print(f"{method}: {name}, {count} gaps: {', '.join(sorted(shares)) or 'no warnings'}")
        if self.refused:
            print(f"{method}: {self.refused} clips could not be filled")


def count_warnings(truth: pf.Clip, gappy: pf.Clip, method: str, tally: Tally) -> None:
    """Fill a clip, and count the warnings about its gaps."""
    try:
        result = pf.fill(gappy, method=method)
    except PriorfillError:  # the method does not apply to the clip
        tally.refused += 1
        return
    filled = result.filled[..., None]
    right = np.where(filled, truth.positions, result.clip.positions)
    true = replace(result, clip=result.clip.with_positions(right))
    off = np.linalg.norm(result.clip.positions - truth.positions, axis=2)
    pairs = zip(gap_warnings(result), gap_warnings(true), strict=True)
    for gap, (found, about_truth) in zip(result.gaps, pairs, strict=True):
        inside = slice(gap.start, gap.stop), gappy.labels.index(gap.label)
        errors = off[inside][result.filled[inside] & ~np.isnan(off[inside])]
        if len(errors):
            mean = float(errors.mean())
            name = "wrong" if mean > WRONG else "right" if mean < RIGHT else "in between"
            tally.add(name, {one.kind for one in found})
            tally.add("true positions", {one.kind for one in about_truth} & MOTION)


def main() -> None:
    """Print the shares for each method."""
    parser = argparse.ArgumentParser(description="Count the warnings of the page.")
    add_data_option(parser)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=1, help="gaps of each kind in each recording")
    parser.add_argument("--methods", default="gpr,linear", help="separated by commas")
    options = parser.parse_args()
    tallies = {method: Tally() for method in options.methods.split(",")}
    rng = np.random.default_rng(options.seed)
    for name in RECORDINGS:
        whole = pf.read(options.data / name)
        clip = pf.Clip(whole.positions[:MAX_FRAMES], whole.labels, whole.rate, whole.up, whole.name)
        for kind in [*KINDS] * options.count:
            cut = cut_gaps(kind, clip, parts_of(clip), rng)
            if cut is not None:
                truth, gone = cut
                gappy = truth.with_positions(np.where(gone[..., None], np.nan, truth.positions))
                for method, tally in tallies.items():
                    count_warnings(truth, gappy, method, tally)
    for method, tally in tallies.items():
        tally.show(method)


if __name__ == "__main__":
    replace_what_is_lacking()
    main()
