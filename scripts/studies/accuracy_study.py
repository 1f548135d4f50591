#!/usr/bin/env python
"""Accuracy of fills of recordings, by kind of gap and by database.

    python scripts/studies/accuracy_study.py -o FOLDER [--count 20] [--kinds limb,long]
    [--processes 2]

Cuts random gaps of every kind (`artificial_gaps.py`) into recordings, fills them, and compares the
result with the removed samples: from the clip alone (``none``), with a database of all other
recordings of the same marker set (``full``), and without those of the same subject
(``no-subject``). Prints errors, their ratio with and without a database, the coverage of the
90 % bounds, the quality of the fills (`fill_quality.py`), and the worst cases. Every gap is a line
of ``FOLDER/accuracy.csv``. Finished cases are not repeated: an interrupted study resumes, and a
larger ``--count`` adds cases. Use a new folder after a change of priorfill. ``--plots N`` draws the
N worst and N ordinary gaps (matplotlib).
"""

from __future__ import annotations

import argparse
import os
import sys
import time
import zlib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from accuracy_rows import Row, append, key_of, load, save
from accuracy_tables import (
    DATABASES,
    print_errors,
    print_quality,
    print_ratios,
    print_uncertainty,
    print_worst,
)
from artificial_gaps import KINDS, cut_gaps
from fill_quality import edge_step, jitter, penetration, reference_step
from numpy.typing import NDArray

from priorfill.cli.encoding import replace_what_is_lacking

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
from method_alone import method_alone
from process_pool import process_pool
from recordings import SETS, SUBJECT, add_data_option, subject_of

import priorfill as pf
from priorfill.cli.progress import progress
from priorfill.evaluation.body_parts import FEET, BodyParts, parts_of
from priorfill.gaps import find_gaps
from priorfill.geometry.axes import to_upright
from priorfill.methods import get_method

MAX_SECONDS = 25.0
"""s. Longer recordings are cut to a random part of this length, so that fills stay fast and a clip
does not contain every pose."""

MAX_RECORDINGS = {"hdm05_cut_markers": 40}
"""Maximum number of cases' recordings of a large folder; databases contain all of it."""

MAX_DRAWS = 100
"""Recordings tried to find one with room for a gap."""


@dataclass(frozen=True)
class Plan:
    """Settings that all cases of a study depend on."""

    data: Path
    databases: Path
    folders: tuple[str, ...]
    seed: int
    window: float

    @property
    def text(self) -> str:
        """The plan as text: equal plans have equal cases."""
        return f"seed {self.seed}, {self.window:g} s of {' '.join(self.folders)}"

    def files(self, folder: str) -> list[Path]:
        """Return the recordings of a folder that cases are drawn from."""
        found = sorted((self.data / folder).glob("*.c3d"))
        rng = np.random.default_rng([self.seed, zlib.crc32(folder.encode())])
        chosen = rng.permutation(len(found))[: MAX_RECORDINGS.get(folder)]
        return [found[i] for i in sorted(chosen)]


@dataclass(frozen=True, eq=False)
class Case:
    """A recording, the samples removed from it, and its segments and limbs."""

    name: str
    kind: str
    file: Path
    truth: pf.Clip
    gone: NDArray[np.bool_]
    parts: BodyParts

    @property
    def gappy(self) -> pf.Clip:
        """The clip with gaps."""
        positions = self.truth.positions.copy()
        positions[self.gone] = np.nan
        return self.truth.with_positions(positions)


def set_of(folder: str) -> str | None:
    """Return the marker set of a folder's recordings; None if unknown, without a database."""
    return next((name for name, folders in SETS.items() if folder in folders), None)


@lru_cache(maxsize=8)
def read(file: Path) -> pf.Clip:
    """Read a recording."""
    return pf.read(file)


def case_name(kind: str, number: int) -> str:
    """Return the name of a case."""
    return f"{kind}-{number}"


def draw_case(plan: Plan, kind: str, number: int) -> Case:
    """Draw a case; equal arguments give equal cases."""
    rng = np.random.default_rng([plan.seed, zlib.crc32(kind.encode()), number])
    by_folder = {folder: plan.files(folder) for folder in plan.folders}
    # large folders count more, by the square root of their size
    weight = np.sqrt([len(files) for files in by_folder.values()])
    for _ in range(MAX_DRAWS):
        files = list(by_folder.values())[rng.choice(len(weight), p=weight / weight.sum())]
        file = files[rng.integers(len(files))]
        clip = read(file)
        frames = min(clip.frames, round(plan.window * clip.rate))
        first = int(rng.integers(clip.frames - frames + 1))
        clip = replace(
            clip,
            positions=clip.positions[first : first + frames],
            subject=subject_of(file),
            first_frame=first,
            source=None,
        )
        parts = parts_of(clip)
        found = cut_gaps(kind, clip, parts, rng)
        if found is not None:
            return Case(case_name(kind, number), kind, file, *found, parts)
    raise LookupError(f"{kind}: no recording has room for such gaps; use other --folders")


def selection_of(case: Case, database: str) -> pf.Selection:
    """Return which clips of the database may be used."""
    if database == "no-subject":
        return pf.Selection(not_names=(case.file.stem,), not_subjects=(subject_of(case.file),))
    return pf.Selection(not_names=(case.file.stem,))


def fill(plan: Plan, case: Case, database: str, method: str) -> pf.Result:
    """Fill a case."""
    place = None if database == "none" else plan.databases / str(set_of(case.file.parent.name))
    options = method_alone(selection_of(case, database))
    return pf.fill(case.gappy, database=place, method=method, options=options)


def linear(clip: pf.Clip) -> NDArray[np.float64]:
    """Interpolate each gap linearly; at the ends of the clip, repeat the nearest sample."""
    positions = clip.positions.copy()
    frames = np.arange(clip.frames)
    for marker in np.flatnonzero(clip.missing.any(axis=0)):
        known = ~clip.missing[:, marker]
        if known.any():
            for i in range(3):
                at = positions[known, marker, i]
                positions[:, marker, i] = np.interp(frames, frames[known], at)
    return positions


def run_case(
    plan: Plan, kind: str, number: int, wanted: Sequence[tuple[str, str]]
) -> list[list[Row]]:
    """Draw a case, fill it by pairs of database and method, and return the rows of each."""
    case = draw_case(plan, kind, number)
    straight = linear(case.gappy)
    outcomes = []
    for database, method in wanted:
        if database != "none" and set_of(case.file.parent.name) is None:
            continue
        begin = time.perf_counter()
        result = fill(plan, case, database, method)
        seconds = time.perf_counter() - begin
        outcomes.append(rows_of(plan, case, result, straight, database, method, seconds))
    return outcomes


def rows_of(
    plan: Plan,
    case: Case,
    result: pf.Result,
    straight: NDArray[np.float64],
    database: str,
    method: str,
    seconds: float,
) -> list[Row]:
    """Compare a result with the truth, gap by gap."""
    truth, gappy, up = case.truth, case.gappy, case.truth.up
    error = np.linalg.norm(result.clip.positions - truth.positions, axis=2)
    off_line = np.linalg.norm(straight - truth.positions, axis=2)
    heights = [to_upright(c.positions, up)[..., 2] for c in (result.clip, truth, gappy)]
    gaps = find_gaps(case.gone)
    rows = []
    for gap in gaps:
        inside = slice(gap.start, gap.stop), gap.marker
        label = truth.labels[gap.marker]
        summary = next(g for g in result.gaps if g.label == label and g.start <= gap.start < g.stop)
        here = result.filled[inside]
        off = error[inside][here]
        segment = case.parts.segment_of[label]
        path, true_path = result.clip.positions[:, gap.marker], truth.positions[:, gap.marker]
        around = slice(max(gap.start - 1, 0), gap.stop + 1)
        shaking, shaking_truth = (jitter(p[around], truth.rate) for p in (path, true_path))
        nothing = float("nan")
        penetrations = [nothing, nothing]
        if here.all() and any(segment.endswith(foot) for foot in FEET):
            filled, true, measured = (height[:, gap.marker] for height in heights)
            if np.isfinite(measured).any():
                lowest = float(np.nanmin(measured))
                penetrations = [
                    penetration(h[gap.start : gap.stop], lowest) for h in (filled, true)
                ]
        rows.append(
            Row(
                plan=plan.text,
                case=case.name,
                kind=case.kind,
                folder=case.file.parent.name,
                clip=case.file.stem,
                subject=subject_of(case.file),
                window=truth.first_frame,
                clip_frames=truth.frames,
                rate=truth.rate,
                database=database,
                method=method,
                gaps=len(gaps),
                marker=label,
                segment=segment,
                start=gap.start,
                frames=gap.frames,
                seconds=gap.frames / truth.rate,
                filled=int(here.sum()),
                error=float(off.mean()) if len(off) else nothing,
                rms=float(np.sqrt((off**2).mean())) if len(off) else nothing,
                worst=float(off.max()) if len(off) else nothing,
                linear=float(off_line[inside].mean()),
                expected_mean=summary.expected_mean_error_mm,
                expected_rms=summary.expected_rms_mm,
                bound=summary.error_bound_90_mm,
                below=int((off < result.error_bound_90_mm[inside][here]).sum()),
                below_gap=int((off < summary.error_bound_90_mm).sum()),
                poses=summary.training_poses,
                how="; ".join(summary.sources),
                edge=edge_step(path, gap.start, gap.stop),
                edge_truth=edge_step(true_path, gap.start, gap.stop),
                edge_reference=reference_step(gappy.positions[:, gap.marker]),
                jitter=shaking[0] / shaking_truth[0] if shaking_truth[0] > 0 else nothing,
                jitter_mm=shaking[1],
                jitter_truth_mm=shaking_truth[1],
                penetration=penetrations[0],
                penetration_truth=penetrations[1],
                fill_seconds=seconds,
            )
        )
    return rows


def make_databases(plan: Plan) -> None:
    """Build the databases that do not exist yet."""
    for name in {set_of(folder) for folder in plan.folders} - {None}:
        place = plan.databases / str(name)
        if place.exists():
            continue
        files = [
            f for folder in SETS[str(name)] for f in sorted((plan.data / folder).glob("*.c3d"))
        ]
        unfinished = plan.databases / f"{name}-unfinished-{os.getpid()}"
        plan.databases.mkdir(parents=True, exist_ok=True)
        with (
            pf.PriorDatabase.create(unfinished) as database,
            progress(len(files), f"database of {name}") as show,
        ):
            for done, file in enumerate(files):
                database.add(
                    replace(pf.read(file), name=file.stem), pf.ClipOrigin(subject=subject_of(file))
                )
                show(done + 1, None)
        unfinished.rename(place)


def run(
    plan: Plan,
    kinds: Sequence[str],
    count: int,
    wanted: Sequence[tuple[str, str]],
    processes: int,
    file: Path,
) -> tuple[list[Row], int]:
    """Run the cases that are not in the file yet.

    Parameters
    ----------
    plan : Plan
        Settings of the cases.
    kinds : sequence of str
        Kinds of gaps.
    count : int
        Cases of each kind.
    wanted : sequence of (str, str)
        Pairs of database and method.
    processes : int
        Number of cases filled in parallel.
    file : Path
        The CSV file.

    Returns
    -------
    rows : list of Row
        All requested rows, those of earlier runs included.
    failures : int
        Number of failed cases; each is named on stderr.
    """
    rows = load(file)
    save(file, rows)  # without incomplete lines
    done = {key_of(row) for row in rows}
    wanted_keys: set[tuple[str, ...]] = set()
    tasks: list[tuple[str, int, list[tuple[str, str]]]] = []
    for number in range(count):
        for kind in kinds:
            keys = {w: (plan.text, case_name(kind, number), *w) for w in wanted}
            wanted_keys.update(keys.values())
            rest = [w for w in wanted if keys[w] not in done]
            if rest:
                tasks.append((kind, number, rest))
    failures = 0
    with _pool(processes) as submit, progress(len(tasks), "cases") as show:
        futures = {submit(run_case, plan, *task): case_name(*task[:2]) for task in tasks}
        for n, future in enumerate(as_completed(futures)):
            try:
                outcomes = future.result()
            except Exception as error:  # a failure must not stop the other cases
                print(f"{futures[future]}: {type(error).__name__}: {error}", file=sys.stderr)
                failures += 1
                continue
            for outcome in outcomes:
                append(file, outcome)
                rows += outcome
            show(n + 1, None)
    return [row for row in rows if key_of(row) in wanted_keys], failures


@contextmanager
def _pool(processes: int) -> Iterator[Callable[..., Future[list[list[Row]]]]]:
    """Yield a function that submits a call to worker processes, or to a thread for one process."""
    if processes > 1:
        with process_pool(processes) as pool:
            yield pool.submit
    else:
        with ThreadPoolExecutor(1) as pool:
            yield pool.submit


def plot(plan: Plan, some: Sequence[Row], folder: Path) -> None:
    """Plot one gap of each case by coordinate: truth, fill and 90 % bound."""
    try:
        import matplotlib as mpl
    except ImportError:
        print("no plots: matplotlib is not installed (pip install matplotlib)", file=sys.stderr)
        return
    mpl.use("Agg")
    from matplotlib import pyplot

    for row in some:
        kind, number = row.case.rsplit("-", 1)
        case = draw_case(plan, kind, int(number))
        result = fill(plan, case, row.database, row.method)
        marker = case.truth.labels.index(row.marker)
        around = max(row.frames // 3, round(0.2 * row.rate))
        shown = np.arange(
            max(0, row.start - around), min(row.clip_frames, row.start + row.frames + around)
        )
        inside = shown[(shown >= row.start) & (shown < row.start + row.frames)]
        seconds, filled = shown / row.rate, result.clip.positions[:, marker]
        straight = linear(case.gappy)[:, marker]
        figure, axes = pyplot.subplots(4, 1, figsize=(9, 9), sharex=True, layout="constrained")
        for i in range(3):
            axes[i].plot(seconds, case.truth.positions[shown, marker, i], "k", linewidth=1,
                         label="measured")  # fmt: skip
            axes[i].plot(inside / row.rate, filled[inside, i], "C3", label="filled")
            bound = result.error_bound_90_mm[inside, marker]
            axes[i].fill_between(inside / row.rate, filled[inside, i] - bound,
                                 filled[inside, i] + bound, color="C3", alpha=0.15,
                                 linewidth=0, label="90 % bound")  # fmt: skip
            axes[i].plot(inside / row.rate, straight[inside, i], "C0:", linewidth=0.8,
                         label="straight line")  # fmt: skip
            axes[i].set_ylabel(f"{'xyz'[i]} mm")
        off = np.linalg.norm(filled - case.truth.positions[:, marker], axis=1)
        axes[3].plot(inside / row.rate, off[inside], "k", linewidth=1, label="error")
        axes[3].plot(
            inside / row.rate, result.expected_rms_mm[inside, marker], "C3", label="expected rms"
        )
        axes[3].plot(
            inside / row.rate, result.error_bound_90_mm[inside, marker], "C3--", label="90 % bound"
        )
        axes[3].set(xlabel="s", ylabel="distance mm")
        axes[0].legend(loc="upper right", fontsize=8)
        axes[3].legend(loc="upper right", fontsize=8)
        figure.suptitle(
            f"{row.case}: {row.marker} of {row.clip}, {row.method}, database {row.database}\n"
            f"mean error {row.error:.1f} mm, expected {row.expected_mean:.1f} mm"
        )
        name = folder / f"{row.case}_{row.marker}_{row.database}_{row.method}.png"
        figure.savefig(name, dpi=90)
        pyplot.close(figure)
        print(f"plot: {name}")


def chosen_for_plots(worst: Sequence[Sequence[Row]], number: int) -> list[Row]:
    """Return the worst gap of each of the worst cases, and of as many median cases."""
    middle = max(0, len(worst) // 2 - number // 2)
    cases = [*worst[:number], *worst[max(middle, number) :][:number]]
    return [max(some, key=lambda row: row.error) for some in cases]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_data_option(parser)
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of the results")
    parser.add_argument("--count", type=int, default=20, help="cases of each kind")
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--folders", default=",".join(SUBJECT), help="folders of recordings")
    parser.add_argument("--databases", default=",".join(DATABASES))
    parser.add_argument("--methods", default="auto", help="auto,neighbours,baumann2011,...")
    parser.add_argument("--long-edge", type=float, default=MAX_SECONDS, metavar="S",
                        help="longer recordings are cut to this length")  # fmt: skip
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--plots", type=int, default=0, metavar="N")
    given = parser.parse_args(arguments)
    lists = {n: getattr(given, n).split(",") for n in ("kinds", "folders", "databases", "methods")}
    for name, known in (("kinds", KINDS), ("databases", DATABASES)):
        unknown = [item for item in lists[name] if item not in known]
        if unknown:
            parser.error(f"--{name}: {unknown[0]} is not one of {' '.join(known)}")
    for method in lists["methods"]:
        try:
            get_method(method)
        except pf.PriorfillError as error:
            parser.error(f"--methods: {error}")
    folders = [f for f in lists["folders"] if any((given.data / f).glob("*.c3d"))]
    if not folders:
        print(f"{given.data}: no recordings in {given.folders}; use --data", file=sys.stderr)
        return 1
    given.output.mkdir(parents=True, exist_ok=True)
    plan = Plan(given.data, given.output / "databases", tuple(folders), given.seed, given.long_edge)
    if set(lists["databases"]) - {"none"}:
        make_databases(plan)
    file = given.output / "accuracy.csv"
    wanted = [(database, method) for database in lists["databases"] for method in lists["methods"]]
    rows, failures = run(plan, lists["kinds"], given.count, wanted, given.processes, file)
    order = {kind: i for i, kind in enumerate(KINDS)}
    place = {database: i for i, database in enumerate(DATABASES)}
    rows.sort(key=lambda r: (order[r.kind], int(r.case.rsplit("-", 1)[1]), r.method,
                             place[r.database], r.start, r.marker))  # fmt: skip
    cases = {row.case for row in rows}
    print(f"{len(cases)} cases from {len({r.clip for r in rows})} recordings of "
          f"{len({r.subject for r in rows})} subjects; {plan.text}; rows: {file}")  # fmt: skip
    print_errors(rows)
    print_ratios(rows)
    print_uncertainty(rows)
    print_quality(rows)
    worst = print_worst(rows)
    if given.plots:
        plot(plan, chosen_for_plots(worst, given.plots), given.output)
    return 1 if failures else 0


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
