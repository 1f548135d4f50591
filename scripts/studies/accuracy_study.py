#!/usr/bin/env python
"""How far off fills are, on real recordings, by kind of gap and by what the database holds.

    python scripts/studies/accuracy_study.py -o FOLDER [--count 20] [--kinds limb,long]
    [--processes 2]

Cuts random gaps of every kind (`artificial_gaps.py`) into recordings, fills them, and compares
with what was removed: from the clip alone (``none``), with a database of all other recordings of
the same marker set (``full``), and without the clip's own person (``no-person``). Prints tables of
errors, of what a database is worth, of how often the truth lies within what `priorfill` expects, of
the looks of the fills (`looks.py`), and the worst cases. Every gap is a line of
``FOLDER/accuracy.csv``; what that holds already is not computed again, so a study that was
interrupted goes on, and one of more cases (``--count``) only adds to it. After a change of
priorfill, take another folder. ``--plots N`` draws the N worst and N ordinary gaps (matplotlib).
"""

from __future__ import annotations

import argparse
import os
import sys
import time
import zlib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from accuracy_rows import Row, append, key_of, load, save
from accuracy_tables import (
    DATABASES,
    print_errors,
    print_looks,
    print_ratios,
    print_uncertainty,
    print_worst,
)
from artificial_gaps import KINDS, cut_gaps
from looks import depth, edge_step, shake, usual_step
from numpy.typing import NDArray

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
from recordings import PERSON, SETS, add_data_option, person_of

import priorfill as pf
from priorfill.cli.progress import progress
from priorfill.evaluation.body_parts import FEET, BodyParts, parts_of
from priorfill.gaps import find_gaps
from priorfill.geometry.axes import to_upright
from priorfill.methods import get_method

WINDOW = 25.0
"""s. Of longer recordings a random part as long is taken: so a fill stays fast, and a clip does not
know everything by itself."""

SAMPLED = {"hdm05_cut_markers": 40}
"""Recordings taken of a folder that would be most of all; all of it goes into databases."""

DRAWS = 100
"""Recordings tried until one has a place for a gap."""


@dataclass(frozen=True)
class Plan:
    """What all cases of a study depend on."""

    data: Path
    databases: Path
    folders: tuple[str, ...]
    seed: int
    window: float

    @property
    def text(self) -> str:
        """The plan in words: cases of equal plans are the same."""
        return f"seed {self.seed}, {self.window:g} s of {' '.join(self.folders)}"

    def files(self, folder: str) -> list[Path]:
        """Return the recordings of a folder that cases are made of."""
        found = sorted((self.data / folder).glob("*.c3d"))
        rng = np.random.default_rng([self.seed, zlib.crc32(folder.encode())])
        chosen = rng.permutation(len(found))[: SAMPLED.get(folder)]
        return [found[i] for i in sorted(chosen)]


@dataclass(frozen=True, eq=False)
class Case:
    """A recording, what is removed from it, and what its body is made of."""

    name: str
    kind: str
    file: Path
    truth: pf.Clip
    gone: NDArray[np.bool_]
    parts: BodyParts

    @property
    def gappy(self) -> pf.Clip:
        """The clip that is filled."""
        positions = self.truth.positions.copy()
        positions[self.gone] = np.nan
        return self.truth.with_positions(positions)


def set_of(folder: str) -> str | None:
    """Return the marker set of a folder's recordings; None: unknown, there is no database."""
    return next((name for name, folders in SETS.items() if folder in folders), None)


@lru_cache(maxsize=8)
def read(file: Path) -> pf.Clip:
    """Read a recording."""
    return pf.read(file)


def case_name(kind: str, number: int) -> str:
    """Return what a case is called."""
    return f"{kind}-{number}"


def draw_case(plan: Plan, kind: str, number: int) -> Case:
    """Return a case; the same one every time."""
    rng = np.random.default_rng([plan.seed, zlib.crc32(kind.encode()), number])
    by_folder = {folder: plan.files(folder) for folder in plan.folders}
    # large folders count more, but not by as much as they are larger
    weight = np.sqrt([len(files) for files in by_folder.values()])
    for _ in range(DRAWS):
        files = list(by_folder.values())[rng.choice(len(weight), p=weight / weight.sum())]
        file = files[rng.integers(len(files))]
        clip = read(file)
        frames = min(clip.frames, round(plan.window * clip.rate))
        first = int(rng.integers(clip.frames - frames + 1))
        clip = replace(
            clip,
            positions=clip.positions[first : first + frames],
            subject=person_of(file),
            first_frame=first,
            source=None,
        )
        parts = parts_of(clip)
        found = cut_gaps(kind, clip, parts, rng)
        if found is not None:
            return Case(case_name(kind, number), kind, file, *found, parts)
    raise LookupError(f"{kind}: no recording has a place for such gaps; take other folders")


def selection_of(case: Case, database: str) -> pf.Selection:
    """Return what of the database may be learnt from."""
    if database == "no-person":
        return pf.Selection(not_names=(case.file.stem,), not_subjects=(person_of(case.file),))
    return pf.Selection(not_names=(case.file.stem,))


def fill(plan: Plan, case: Case, database: str, method: str) -> pf.Result:
    """Fill a case."""
    place = None if database == "none" else plan.databases / str(set_of(case.file.parent.name))
    return pf.fill(
        case.gappy, database=place, method=method, selection=selection_of(case, database)
    )


def linear(clip: pf.Clip) -> NDArray[np.float64]:
    """Positions with each gap bridged by a straight line, or its edge's position repeated."""
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
    """Draw a case and fill it from some databases by some methods: their rows."""
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
        told = next(g for g in result.gaps if g.label == label and g.start <= gap.start < g.stop)
        here = result.filled[inside]
        off = error[inside][here]
        segment = case.parts.segment_of[label]
        path, true_path = result.clip.positions[:, gap.marker], truth.positions[:, gap.marker]
        around = slice(max(gap.start - 1, 0), gap.stop + 1)
        shaking, shaking_truth = (shake(p[around], truth.rate) for p in (path, true_path))
        nothing = float("nan")
        sunk = [nothing, nothing]
        if here.all() and any(segment.endswith(foot) for foot in FEET):
            filled, true, measured = (height[:, gap.marker] for height in heights)
            if np.isfinite(measured).any():
                lowest = float(np.nanmin(measured))
                sunk = [depth(h[gap.start : gap.stop], lowest) for h in (filled, true)]
        rows.append(
            Row(
                plan=plan.text,
                case=case.name,
                kind=case.kind,
                folder=case.file.parent.name,
                clip=case.file.stem,
                person=person_of(case.file),
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
                expected_mean=told.expected_mean_error,
                expected_rms=told.expected_rms,
                bound=told.error_bound_90,
                below=int((off < result.error_bound_90[inside][here]).sum()),
                below_gap=int((off < told.error_bound_90).sum()),
                poses=told.training_poses,
                how="; ".join(told.sources),
                edge=edge_step(path, gap.start, gap.stop),
                edge_truth=edge_step(true_path, gap.start, gap.stop),
                edge_usual=usual_step(gappy.positions[:, gap.marker]),
                shake=shaking[0] / shaking_truth[0] if shaking_truth[0] > 0 else nothing,
                shake_mm=shaking[1],
                shake_truth_mm=shaking_truth[1],
                sunk=sunk[0],
                sunk_truth=sunk[1],
                fill_seconds=seconds,
            )
        )
    return rows


def make_databases(plan: Plan) -> None:
    """Make the databases that are not there yet."""
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
                database.add(replace(pf.read(file), name=file.stem), subject=person_of(file))
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
    """Fill what is not in the file yet.

    Parameters
    ----------
    plan : Plan
        What the cases depend on.
    kinds : sequence of str
        Kinds of gaps.
    count : int
        Cases of each.
    wanted : sequence of (str, str)
        Databases and methods to fill them with.
    processes : int
        How many cases are filled at a time.
    file : Path
        What is done, and where more of it goes.

    Returns
    -------
    rows : list of Row
        All that were asked for, done now or before.
    failures : int
        Cases that could not be done; each is named on stderr.
    """
    rows = load(file)
    save(file, rows)  # without what was torn
    done = {key_of(row) for row in rows}
    asked: set[tuple[str, ...]] = set()
    tasks: list[tuple[str, int, list[tuple[str, str]]]] = []
    for number in range(count):
        for kind in kinds:
            keys = {w: (plan.text, case_name(kind, number), *w) for w in wanted}
            asked.update(keys.values())
            rest = [w for w in wanted if keys[w] not in done]
            if rest:
                tasks.append((kind, number, rest))
    failures = 0
    with _pool(processes) as submit, progress(len(tasks), "cases") as show:
        futures = {submit(run_case, plan, *task): case_name(*task[:2]) for task in tasks}
        for n, future in enumerate(as_completed(futures)):
            try:
                outcomes = future.result()
            except Exception as error:  # one case's fault is not that of the others
                print(f"{futures[future]}: {type(error).__name__}: {error}", file=sys.stderr)
                failures += 1
                continue
            for outcome in outcomes:
                append(file, outcome)
                rows += outcome
            show(n + 1, None)
    return [row for row in rows if key_of(row) in asked], failures


@contextmanager
def _pool(processes: int) -> Iterator[Callable[..., Future[list[list[Row]]]]]:
    """Hand out what submits a call to some processes; to this one where there is one only."""
    if processes > 1:
        with ProcessPoolExecutor(processes) as pool:
            yield pool.submit
    else:
        with ThreadPoolExecutor(1) as pool:
            yield pool.submit


def plot(plan: Plan, some: Sequence[Row], folder: Path) -> None:
    """Draw a gap of each of some cases: truth, fill and its 90 % bound, by coordinate."""
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
            bound = result.error_bound_90[inside, marker]
            axes[i].fill_between(inside / row.rate, filled[inside, i] - bound,
                                 filled[inside, i] + bound, color="C3", alpha=0.15,
                                 linewidth=0, label="90 % bound")  # fmt: skip
            axes[i].plot(inside / row.rate, straight[inside, i], "C0:", linewidth=0.8,
                         label="straight line")  # fmt: skip
            axes[i].set_ylabel(f"{'xyz'[i]} mm")
        off = np.linalg.norm(filled - case.truth.positions[:, marker], axis=1)
        axes[3].plot(inside / row.rate, off[inside], "k", linewidth=1, label="error")
        axes[3].plot(
            inside / row.rate, result.expected_rms[inside, marker], "C3", label="expected rms"
        )
        axes[3].plot(
            inside / row.rate, result.error_bound_90[inside, marker], "C3--", label="90 % bound"
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
    """Return the worst gap of each of the worst cases, and of as many from the middle."""
    middle = max(0, len(worst) // 2 - number // 2)
    cases = [*worst[:number], *worst[max(middle, number) :][:number]]
    return [max(some, key=lambda row: row.error) for some in cases]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_data_option(parser)
    parser.add_argument("-o", "--output", type=Path, required=True, help="where the rows go")
    parser.add_argument("--count", type=int, default=20, help="cases of each kind")
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--folders", default=",".join(PERSON), help="of recordings")
    parser.add_argument("--databases", default=",".join(DATABASES))
    parser.add_argument("--methods", default="auto", help="auto,neighbours,baumann2011,...")
    parser.add_argument("--long-edge", type=float, default=WINDOW, metavar="S",
                        help="of longer recordings a random part is taken")  # fmt: skip
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--plots", type=int, default=0, metavar="N")
    given = parser.parse_args(arguments)
    lists = {n: getattr(given, n).split(",") for n in ("kinds", "folders", "databases", "methods")}
    for name, known in (("kinds", KINDS), ("databases", DATABASES)):
        unknown = [item for item in lists[name] if item not in known]
        if unknown:
            parser.error(f"--{name}: {unknown[0]} is none of {' '.join(known)}")
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
          f"{len({r.person for r in rows})} people; {plan.text}; rows: {file}")  # fmt: skip
    print_errors(rows)
    print_ratios(rows)
    print_uncertainty(rows)
    print_looks(rows)
    worst = print_worst(rows)
    if given.plots:
        plot(plan, chosen_for_plots(worst, given.plots), given.output)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
