"""The rule of a summary: are the fills of trials that it calls good right, those of others not.

    python scripts/studies/summary_rule_study.py [--data FOLDER] [--seed N] [--count N]
        [--method NAME]

Cuts gaps in recordings, one trial for each kind, fills them, and prints for each group of the rule
in how many trials the mean error of a gap is above 10 and 30 mm; and the same for gaps, by expected
error and length.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from priorfill.cli.encoding import replace_what_is_lacking

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
sys.path.append(str(Path(__file__).resolve().parent))
from artificial_gaps import cut_gaps
from recordings import add_data_option

import priorfill as pf
from priorfill.errors import PriorfillError
from priorfill.evaluation.body_parts import parts_of
from priorfill.filling.fill_facts import fill_facts
from priorfill.filling.fill_file import FileResult
from priorfill.study.job import JobOutcome
from priorfill.study.summary.limits import SummaryLimits
from priorfill.study.summary.rule import attention
from priorfill.study.summary.trial_figures import trial_figures

FOLDERS = ("gait", "cmu", "hdm05")
"""Real markers of walking, running, sports and acrobatics."""

KINDS = ("single", "segment", "limb", "scatter")
"""One marker, a segment, a limb, many short gaps."""

MAX_FRAMES = 1500
"""Frames of a clip that are used, to limit the time."""

FURTHER_OFF = (10.0, 30.0)
"""mm. Errors that are counted."""


def trials(options: argparse.Namespace) -> Iterator[tuple[pf.Clip, pf.Clip]]:
    """Yield recordings without and with gaps."""
    rng = np.random.default_rng(options.seed)
    files = [file for name in FOLDERS for file in sorted((options.data / name).glob("*.c3d"))]
    for file in files:
        whole = pf.read(file)
        clip = pf.Clip(whole.positions[:MAX_FRAMES], whole.labels, whole.rate, whole.up, whole.name)
        for kind in [*KINDS] * options.count:
            cut = cut_gaps(kind, clip, parts_of(clip), rng)
            if cut is not None:
                truth, gone = cut
                yield (
                    truth,
                    truth.with_positions(np.where(gone[..., None], np.nan, truth.positions)),
                )


def true_errors(done: FileResult, truth: pf.Clip) -> list[float]:
    """Return the mean error of each gap (mm); NaN where nothing is filled or the truth unknown."""
    off = np.linalg.norm(done.result.clip.positions - truth.positions, axis=2)
    errors = []
    for gap in done.result.gaps:
        inside = off[gap.start : gap.stop, truth.labels.index(gap.label)]
        known = inside[np.isfinite(inside)]
        errors.append(float(known.mean()) if len(known) else np.nan)
    return errors


def show(title: str, found: dict[str, list[float]]) -> None:
    """Print how many of each group are further off than each limit."""
    print(title)
    for name, errors in sorted(found.items()):
        above = ", ".join(f"{sum(e > mm for e in errors)} above {mm:g} mm" for mm in FURTHER_OFF)
        print(f"  {name}: {len(errors)}, {above}")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Check the rule of a summary.")
    add_data_option(parser)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=1, help="trials of each kind and recording")
    parser.add_argument("--method", default="gpr")
    options = parser.parse_args()
    limits = SummaryLimits()
    by_group, by_gap = defaultdict(list), defaultdict(list)
    with tempfile.TemporaryDirectory() as folder:
        for truth, gappy in trials(options):
            file = Path(folder) / "trial.c3d"
            pf.write(file, gappy, overwrite=True)
            try:
                done = pf.fill_file(file, method=options.method)
            except PriorfillError:
                by_group["failed"].append(np.nan)
                continue
            outcome = JobOutcome(file.name, str(file), "", "filled", facts=fill_facts(done))
            errors = true_errors(done, truth)
            group = attention(trial_figures(outcome), limits).group
            by_group[group].append(float(np.nanmax([0.0, *errors])))
            for gap, error in zip(done.result.gaps, errors, strict=True):
                expected = "" if gap.expected_mean_error_mm <= limits.error else "above the limit, "
                long = gap.frames / truth.rate > limits.long
                if gap.filled:
                    by_gap[f"{expected}{'long' if long else 'short'}"].append(error)
    show("trials, by the error of their worst gap", by_group)
    show("gaps, by expected error and length", by_gap)


if __name__ == "__main__":
    replace_what_is_lacking()
    main()
