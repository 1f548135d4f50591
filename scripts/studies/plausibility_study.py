"""Fills that the check rejects: how many are wrong, and how many are right.

    python scripts/studies/plausibility_study.py [--data FOLDER] [--seed N] [--count N]
        [--methods NAME,...]

Cuts gaps of every kind in recordings, fills them, and prints for each method: the share of errors
below the 90 % bound; and for each criterion of the check how many samples that fail it were right
(error below the bound) or wrong. ``missed`` counts samples that pass although their error is more
than twice the bound and above 50 mm.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.cli.encoding import replace_what_is_lacking

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
sys.path.append(str(Path(__file__).resolve().parent))
from artificial_gaps import KINDS, cut_gaps
from recordings import add_data_option

import priorfill as pf
from priorfill.errors import MethodError
from priorfill.evaluation.body_parts import parts_of
from priorfill.filling.plausibility import PlausibilityCheck
from priorfill.filling.plausibility_options import UNCHECKED, PlausibilityOptions
from priorfill.geometry.axes import to_upright
from priorfill.markers.clip_geometry import ClipGeometry
from priorfill.markers.definitions import recognise

RECORDINGS = (
    "hdm05/HDM_bd_01-02_01_120.c3d",
    "cmu/135_02.c3d",
    "cmu/141_04.c3d",
    "cmu/85_02.c3d",
    "gait/HC002D06.c3d",
    "gait/HC040A14.c3d",
)
"""Slow and fast motion, kicks and jumps."""

MAX_FRAMES = 1500
"""Frames of a clip that are used, to limit the time."""

WRONG = 50.0
"""mm. A smaller error does not count as missed: skin moves markers by as much."""


def cases(folder: Path, seed: int, count: int) -> Iterator[tuple[pf.Clip, NDArray[np.bool_]]]:
    """Yield clips and the samples to remove."""
    rng = np.random.default_rng(seed)
    for name in RECORDINGS:
        whole = pf.read(folder / name)
        clip = pf.Clip(whole.positions[:MAX_FRAMES], whole.labels, whole.rate, whole.up, whole.name)
        for kind in KINDS:
            for _ in range(count):
                found = cut_gaps(kind, clip, parts_of(clip), rng)
                if found is not None:
                    yield found


def tally(truth: pf.Clip, gone: NDArray[np.bool_], method: str) -> Counter[str]:
    """Fill a case without the check, then check it; return numbers of samples."""
    gappy = truth.with_positions(np.where(gone[..., None], np.nan, truth.positions))
    try:
        result = pf.fill(gappy, method=method, options=pf.FillOptions(plausibility=UNCHECKED))
    except MethodError:
        return Counter()
    geometry = ClipGeometry(
        to_upright(gappy.positions, gappy.up), gappy.labels, recognise(gappy.labels)
    )
    check = PlausibilityCheck(geometry, gappy.rate, PlausibilityOptions())
    failing = check.failures(
        to_upright(result.clip.positions, gappy.up),
        result.expected_rms_mm,
        result.error_bound_90_mm,
    )
    off = np.linalg.norm(result.clip.positions - truth.positions, axis=2)
    scored = gone & result.filled & np.isfinite(off)
    bound = result.error_bound_90_mm
    right = scored & (off <= bound)
    found = Counter(
        filled=int(scored.sum()),
        known=int((scored & np.isfinite(bound)).sum()),
        covered=int(right.sum()),
    )
    passed = scored.copy()
    for name, mask in failing.items():
        found[f"{name} right"] = int((mask & right).sum())
        found[f"{name} wrong"] = int((mask & scored & ~right).sum())
        passed &= ~mask
    found["rejected"] = int((scored & ~passed).sum())
    found["missed"] = int((passed & (off > np.maximum(2.0 * bound, WRONG))).sum())
    return found


def main() -> None:
    """Print a table for each method."""
    parser = argparse.ArgumentParser(description="Check the check of fills.")
    add_data_option(parser)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=1, help="gaps of each kind in each recording")
    parser.add_argument("--methods", default="gpr", help="separated by commas")
    options = parser.parse_args()
    for method in options.methods.split(","):
        total: Counter[str] = Counter()
        for truth, gone in cases(options.data, options.seed, options.count):
            total.update(tally(truth, gone, method))
        known = max(total["known"], 1)
        print(
            f"{method}: {total['filled']} samples filled, errors known of {total['known']}; "
            f"{100 * total['covered'] / known:.1f} % below the bound; "
            f"{total['rejected']} rejected, {total['missed']} missed"
        )
        for name in sorted({key.split()[0] for key in total if " " in key}):
            print(f"  {name:8} right {total[f'{name} right']:6}  wrong {total[f'{name} wrong']:6}")


if __name__ == "__main__":
    replace_what_is_lacking()
    main()
