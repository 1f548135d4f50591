#!/usr/bin/env python
"""Value of a growing prior database: errors as clips are added one by one.

    python scripts/studies/growth_study.py [--set gait|baumann41] [--orders 10] [--processes 2]
    [-o FOLDER]
    python scripts/studies/growth_study.py --library FOLDER|DATABASE [--sizes 1,10,100,1000]
    [--cases 5] [--seed 0] [--processes 2] [-o FOLDER]

Starts with an empty database and takes recordings in random order. A leg or an arm is removed from
each for one second and filled with the database as it is; then the filled clip is accepted into the
database, with its mask. This is done with measured samples only as training data, and with
``trust_filled``. Mean errors are compared with those of the same gap without a database: a table by
number of clips in the database, a CSV file of all fills, and a plot (with matplotlib).

With ``--library``, gaps of several kinds in takes that are held out are filled with random parts of
a large library of recordings, or of a database: ``growth.json``, ``growth.png`` and a table.
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from priorfill.cli.encoding import replace_what_is_lacking

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
sys.path.append(str(Path(__file__).resolve().parent))
import growth_library
from method_alone import method_alone
from process_pool import process_pool
from recordings import add_data_option, subject_of

import priorfill as pf
from priorfill.evaluation.body_parts import LIMBS
from priorfill.markers.definitions import load

SETS = {"gait": ("gait59", ("gait",)), "baumann41": ("baumann41", ("cmu", "hdm05"))}
"""Marker set and folders of recordings."""

GAP_SECONDS = 1.0
LONGEST = 10.0
"""s. Longer recordings are divided, so that a clip does not contain every pose."""

BINS = (0, 1, 3, 6, 12, 24, 48, 96)
"""Lower limits of the classes of clips in the database."""


@dataclass(frozen=True, eq=False)
class Case:
    """A recording and the mask of samples to remove."""

    clip: pf.Clip
    gone: NDArray[np.bool_]  # (frames, markers)


class Row(NamedTuple):
    """The outcome of one fill."""

    mode: str
    order: int
    clips: int
    name: str
    error: float
    alone: float


def read_cases(data: Path, name: str) -> list[Case]:
    """Return the recordings of a set with a fixed random limb gap each."""
    set_name, folders = SETS[name]
    marker_set = load(set_name)
    cases: list[Case] = []
    for folder in folders:
        for file in sorted((data / folder).glob("*.c3d")):
            whole = pf.read(file)
            length = round(LONGEST * whole.rate)
            count = -(-whole.frames // length)
            for part, positions in enumerate(np.array_split(whole.positions, count)):
                clip = replace(
                    whole,
                    positions=positions,
                    name=f"{whole.name}-{part}" if count > 1 else whole.name,
                    subject=subject_of(file),
                    source=None,
                )
                gone = limb_gap(clip, marker_set, np.random.default_rng(len(cases)))
                if gone is not None:
                    cases.append(Case(clip, gone))
    return cases


def limb_gap(
    clip: pf.Clip, marker_set: pf.MarkerSet, rng: np.random.Generator
) -> NDArray[np.bool_] | None:
    """Return the mask of a random limb for a second in which it is measured completely."""
    segment = marker_set.segment
    known = marker_set.match(clip.labels)
    frames = round(GAP_SECONDS * clip.rate)
    for limb, side in rng.permutation([(a, b) for a in LIMBS for b in ("left", "right")]):
        segments = {f"{side}_{part}" for part in LIMBS[limb]}
        markers = [i for i, x in enumerate(clip.labels) if segment.get(known.get(x)) in segments]
        if len(markers) < 4:
            continue
        whole = ~clip.missing[:, markers].any(axis=1)
        starts = [
            start
            for start in range(frames // 4, clip.frames - frames - frames // 4)
            if whole[start : start + frames].all()
        ]
        if starts:
            start = int(rng.choice(starts))
            gone = np.zeros_like(clip.missing)
            gone[start : start + frames, markers] = True
            return gone
    return None


def refill(case: Case, options: pf.FillOptions, **source: object) -> tuple[pf.Result, float]:
    """Remove and fill; return the result and the mean error (mm)."""
    gappy = case.clip.positions.copy()
    gappy[case.gone] = np.nan
    result = pf.fill(case.clip.with_positions(gappy), options=options, **source)
    off = result.clip.positions[case.gone] - case.clip.positions[case.gone]
    return result, float(np.linalg.norm(off, axis=1).mean())


def alone(case: Case, method: str) -> float:
    """Return the error without a database."""
    return refill(case, method_alone(), method=method)[1]


def grow(
    cases: list[Case], alone: list[float], order: int, mode: str, method: str, temporary: str
) -> list[Row]:
    """Fill and accept the recordings in one random order."""
    rows = []
    folder = Path(temporary) / f"{mode}-{order}"
    pf.PriorDatabase.create(folder).close()
    for clips, i in enumerate(np.random.default_rng(order).permutation(len(cases))):
        case = cases[i]
        options = replace(method_alone(), trust_filled=mode == "trust filled")
        result, error = refill(case, options, database=folder, method=method)
        with pf.PriorDatabase.open(folder, write=True) as database:
            database.accept(result.clip, result.filled, filled_by=result.method)
        rows.append(Row(mode, order, clips, case.clip.name, error, alone[i]))
    return rows


def print_table(rows: list[Row]) -> None:
    """Print errors by number of clips in the database."""
    print(f"\n{'mode':14s} {'clips':>7s} {'fills':>6s} {'mm':>7s} {'ratio':>9s} {'worse':>6s}")
    for mode in dict.fromkeys(row.mode for row in rows):
        for first, after in zip(BINS, (*BINS[1:], 10**9), strict=True):
            some = [row for row in rows if row.mode == mode and first <= row.clips < after]
            if not some:
                continue
            last = max(row.clips for row in some)
            left = sum(bool(np.isnan(row.error)) for row in some)
            some = [row for row in some if not np.isnan(row.error)]
            ratio = np.array([row.error / row.alone for row in some])
            print(
                f"{mode:14s} {f'{first}-{last}' if last > first else first:>7} {len(some):6d} "
                f"{np.mean([row.error for row in some]):7.2f} {np.exp(np.log(ratio).mean()):9.3f} "
                f"{(ratio > 1.02).mean():6.0%}{f'  {left} left missing' if left else ''}"
            )


def plot(rows: list[Row], file: Path, title: str) -> None:
    """Plot error ratios over clips in the database: means over orders, and a moving average."""
    try:
        from matplotlib.figure import Figure  # not of pyplot, which keeps figures open
    except ImportError:
        print("no plot: matplotlib is not installed (pip install matplotlib)", file=sys.stderr)
        return
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    axes = figure.subplots()
    for mode, colour in (("measured only", "C0"), ("trust filled", "C1")):
        most = max(row.clips for row in rows) + 1
        logs = [[np.log(r.error / r.alone) for r in rows if (r.mode, r.clips) == (mode, n)]
                for n in range(most)]  # fmt: skip
        means = np.array([np.nanmean(some) for some in logs if some])
        axes.plot(np.exp(means), ".", color=colour, alpha=0.5)
        width = min(5, most)
        smooth = np.convolve(means, np.ones(width) / width, mode="valid")
        at = np.arange(len(smooth)) + (width - 1) / 2
        axes.plot(at, np.exp(smooth), color=colour, label=mode)
    axes.axhline(1, color="0.6", linewidth=0.8)
    axes.set(
        xlabel="clips in the database",
        ylabel="error / error without a database (geometric mean)",
        title=title,
    )
    axes.legend()
    figure.savefig(file, dpi=120)
    print(f"plot: {file}")


def run(
    cases: list[Case], orders: Iterable[int], method: str, processes: int, temporary: str
) -> list[Row]:
    """Fill all cases without a database, then in all orders and both modes."""
    with process_pool(processes) as pool:
        by_itself = list(pool.map(alone, cases, [method] * len(cases)))
        for case, error in zip(cases, by_itself, strict=True):
            if np.isnan(error):
                print(
                    f"skipped {case.clip.name}: it cannot be filled completely without a database"
                )
        cases = [case for case, error in zip(cases, by_itself, strict=True) if error > 0]
        by_itself = [error for error in by_itself if error > 0]
        print(f"without a database: mean {np.mean(by_itself):.2f} mm", flush=True)
        futures = [
            pool.submit(grow, cases, by_itself, order, mode, method, temporary)
            for order in orders
            for mode in ("measured only", "trust filled")
        ]
        rows = []
        for future in futures:
            rows += future.result()
            print(".", end="", file=sys.stderr, flush=True)
        print(file=sys.stderr)
    return rows


def main() -> int:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_data_option(parser)
    parser.add_argument("--set", choices=SETS, default="gait")
    parser.add_argument("--orders", type=int, default=10)
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--method", default="auto")
    parser.add_argument("--clips", type=int, help="number of recordings")
    parser.add_argument("--library", type=Path, help="folder of C3D files, or a database")
    parser.add_argument("--sizes", default="1,10,100,1000", help="takes of its parts")
    parser.add_argument("--cases", type=int, default=5, help="takes held out for each kind of gap")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--output", type=Path, default=Path())
    arguments = parser.parse_args()
    if arguments.library is not None:
        return growth_library.run(
            arguments.library,
            [int(size) for size in arguments.sizes.split(",")],
            arguments.cases,
            arguments.seed,
            arguments.processes,
            arguments.output,
        )
    cases = read_cases(arguments.data, arguments.set)[: arguments.clips]
    if not cases:
        print(f"{arguments.data}: no recordings of this set; use --data", file=sys.stderr)
        return 1
    people = len({case.clip.subject for case in cases})
    print(f"{arguments.set}: {len(cases)} clips of {people} subjects, {arguments.orders} orders")
    arguments.output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as temporary:
        rows = run(cases, range(arguments.orders), arguments.method, arguments.processes, temporary)
    print_table(rows)
    stem = arguments.output / f"growth_{arguments.set}"
    with stem.with_suffix(".csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(Row._fields)
        writer.writerows(rows)
    plot(
        rows, stem.with_suffix(".png"), f"{arguments.set}: {len(cases)} clips of {people} subjects"
    )
    return 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
