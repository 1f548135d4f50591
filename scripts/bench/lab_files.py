#!/usr/bin/env python
"""Time of filling files as labs have them, against a bound for each.

    python scripts/bench/lab_files.py [--data DIR] [--cases FILE] [--only raw,limb] [--repeat 2]

Prints a row for each kind of file: what it takes, the bound, and whether it is met. Seconds are CPU
seconds of complete processes on one thread, the least of several runs after one that compiles.
Rows with another unit: `walkl` is the time of a fill, without start-up and reading, in units of
that of the method ``r2`` without expected errors, the mean over its masks; `memory` is the peak of
the fill of ten minutes; `threads` is how many times as fast (wall clock, so on an idle machine) two
threads fill them.

``--cases`` names a JSON file with a list of clips with artificial gaps: ``name``, ``source`` (a
file below the folder of recordings), ``first`` (frame), ``frames``, ``markers`` and ``gaps``
(marker, start, length). The rows `walkl`, `single` and `limb` are the cases whose names begin as
`CASES` states. ``--database`` is the prior database for the row `limb with a database`; without it,
one of all other recordings of the same marker set is built first.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from child import CLI, DONE, Cost, run

from priorfill.cli.encoding import replace_what_is_lacking

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
from recordings import SETS, add_data_option

import priorfill as pf
from priorfill.runtime.threads import limit_threads
from priorfill.signal.cubic_spline import cubic_spline
from priorfill.synthetic import Body, synthesise

HERE = Path(__file__).resolve().parent

CASES = {"walkl": "d17_", "single": ("d01_", "d02_", "d03_"), "limb": "d06_"}
"""How names of cases begin, by row."""

RAW = "real_gaps/HC040A14_raw.c3d"
"""A trial with the gaps that the cameras left."""

BOUNDS = {
    "walkl": 10.0,
    "raw": 6.0,
    "scattered": 10.0,
    "single": 2.0,
    "limb": 1.0,
    "limb with a database": 1.5,
    "many markers": 3.0,
    "ten minutes": 15.0,
    "memory": 800.0,
    "threads": 1.7,
}
"""Bounds: at least for `threads`, at most for the others. In the units of `UNITS`, or CPU s."""

UNITS = {"walkl": "x r2", "memory": "MB", "threads": "x"}

REFERENCE = "r2"
"""The method whose time is the unit of `walkl`."""

QUIET = {
    "OPENBLAS_NUM_THREADS": "1",
    "PRIORFILL_THREADS": "1",
    "PYTHONDONTWRITEBYTECODE": "",  # modules are compiled once, as in an installed package
}
"""Environment of processes that are measured on one thread."""

SCATTERED = (800, 53, 3147)
"""Frames, markers and gaps of the scattered file, which is made from a recording of `gait`."""

MEAN_LENGTH, MAX_LENGTH, EDGE = 6, 40, 2
"""Frames. Mean and greatest length of a scattered gap; frames at the ends without one."""

MANY = (30, 40, 1000)
"""Persons, markers of each and frames of the file with many markers."""

MINUTES = "10"
"""Length of the long file."""

METHOD = "auto"


class Row(NamedTuple):
    """A measured value of a row of the table."""

    name: str
    value: float
    detail: str = ""

    @property
    def is_met(self) -> bool:
        """Whether the value is within its bound."""
        bound = BOUNDS[self.name]
        return self.value >= bound if self.name == "threads" else self.value <= bound

    def __str__(self) -> str:
        unit = UNITS.get(self.name, "s")
        sign = ">=" if self.name == "threads" else "<="
        bound = f"{sign} {BOUNDS[self.name]:g} {unit}"
        met = "met" if self.is_met else "NOT MET"
        return f"{self.name:22s} {self.value:8.2f} {unit:5s} {bound:12s} {met:8s} {self.detail}"


@dataclass(frozen=True)
class Bench:
    """What all rows use: folders, cases, and how often a fill is measured."""

    folder: Path
    data: Path
    cases: Path
    database: Path | None
    repeat: int

    def fill(self, file: Path, *more: str, threads: int = 1, repeat: int | None = None) -> Cost:
        """Return the least cost of a complete process that fills a file."""
        command = [*CLI, "fill", str(file), "-o", str(self.folder / f"filled{file.suffix}")]
        command += ["--overwrite", "--threads", str(threads), "--method", METHOD, *more]
        environment = {**QUIET, "PRIORFILL_THREADS": str(threads)}
        runs = range(self.repeat if repeat is None else repeat)
        costs = [run(command, environment=environment, accepted=DONE, quiet=True) for _ in runs]
        return min(costs, key=lambda cost: cost.cpu if threads == 1 else cost.wall)

    def written(self, clip: pf.Clip, name: str) -> Path:
        """Write a clip into the folder."""
        file = self.folder / f"{name}.c3d"
        if not file.exists():
            pf.write(file, clip)
        return file

    def cut(self, row: str) -> Iterator[tuple[str, pf.Clip]]:
        """Yield the clips of a row with their artificial gaps."""
        for case in json.loads(self.cases.read_text(encoding="utf-8")):
            if not case["name"].startswith(CASES[row]):
                continue
            whole = pf.read(self.data / case["source"])
            markers = [whole.labels.index(label) for label in case["markers"]]
            part = slice(case["first"], case["first"] + case["frames"])
            positions = whole.positions[part, markers].copy()
            for label, start, length in case["gaps"]:
                positions[start : start + length, case["markers"].index(label)] = np.nan
            yield case["name"], pf.Clip(positions, tuple(case["markers"]), whole.rate)

    def written_cases(self, row: str) -> dict[str, Path]:
        """Write the cases of a row as files."""
        return {name: self.written(clip, name) for name, clip in self.cut(row)}

    @cached_property
    def prior(self) -> Path:
        """A prior database of all recordings but those that the cases of `limb` are cut from."""
        if self.database is not None:
            return self.database
        cases = json.loads(self.cases.read_text(encoding="utf-8"))
        own = {Path(c["source"]).stem for c in cases if c["name"].startswith(CASES["limb"])}
        files = [
            str(file)
            for folder in SETS["baumann41"]
            for file in sorted((self.data / folder).glob("*.c3d"))
            if file.stem not in own
        ]
        made = self.folder / "database"
        run([*CLI, "db", "add", "--database", str(made), *files])
        return made

    @cached_property
    def long_file(self) -> Path:
        """The long file with several kinds of gaps."""
        made = self.folder / "long.c3d"
        run([sys.executable, str(HERE / "long_clip.py"), str(made), "--minutes", MINUTES])
        return made


def walkl(bench: Bench) -> Iterator[Row]:
    """Fill a treadmill walk; in units of a fast method that learns from the clip."""
    limit_threads(1)
    ratios, detail = [], []
    for name, clip in bench.cut("walkl"):
        own, other = (
            min(_seconds_of(clip, method, options) for _ in range(bench.repeat))
            for method, options in (
                (METHOD, pf.FillOptions()),
                (REFERENCE, pf.FillOptions(estimate_errors=False)),
            )
        )
        ratios.append(own / other)
        detail.append(f"{name[-4:]}: {own:.2f}/{other:.2f} s")
    yield Row("walkl", float(np.mean(ratios)), ", ".join(detail))


def _seconds_of(clip: pf.Clip, method: str, options: pf.FillOptions) -> float:
    """Return the CPU seconds of a fill in this process."""
    began = time.process_time()
    pf.fill(clip, method=method, options=options)
    return time.process_time() - began


def raw(bench: Bench) -> Iterator[Row]:
    """Fill a trial as the cameras left it."""
    file = bench.data / RAW
    yield Row("raw", bench.fill(file, repeat=1).cpu, file.name)


def scattered(bench: Bench) -> Iterator[Row]:
    """Fill very many short gaps."""
    clip = _scattered_clip(bench.data)
    cost = bench.fill(bench.written(clip, "scattered"), repeat=1)
    yield Row("scattered", cost.cpu, f"{clip.missing.mean():.0%} of the samples missing")


def _scattered_clip(data: Path) -> pf.Clip:
    """Return a recorded gait with short gaps at random places that do not touch.

    The longest recording with enough markers that are always visible is played more slowly, to have
    the number of frames.
    """
    frames, count, gaps = SCATTERED
    clips = [pf.read(file) for file in sorted((data / "gait").glob("*.c3d"))]
    enough = [clip for clip in clips if (~clip.missing.any(axis=0)).sum() >= count]
    clip = max(enough, key=lambda clip: clip.frames)
    whole = np.flatnonzero(~clip.missing.any(axis=0))[:count]
    query = np.linspace(0.0, clip.frames - 1.0, frames)
    positions = cubic_spline(np.arange(clip.frames), clip.positions[:, whole], query)
    rng = np.random.default_rng(3)
    gone = np.zeros(positions.shape[:2], dtype=bool)
    while gaps:
        marker = rng.integers(count)
        length = min(1 + rng.geometric(1 / MEAN_LENGTH), MAX_LENGTH)
        start = rng.integers(EDGE, len(gone) - EDGE - length)
        if not gone[start - 1 : start + length + 1, marker].any():
            gone[start : start + length, marker] = True
            gaps -= 1
    positions[gone] = np.nan
    return pf.Clip(positions, tuple(clip.labels[marker] for marker in whole), clip.rate)


def single(bench: Bench) -> Iterator[Row]:
    """Fill single markers; the slowest case."""
    costs = {name: bench.fill(file).cpu for name, file in bench.written_cases("single").items()}
    detail = ", ".join(f"{name[:3]}: {cpu:.2f} s" for name, cpu in costs.items())
    yield Row("single", max(costs.values()), detail)


def limb(bench: Bench) -> Iterator[Row]:
    """Fill an arm, without and with a prior database."""
    for file in bench.written_cases("limb").values():
        yield Row("limb", bench.fill(file).cpu, file.stem)
        cost = bench.fill(file, "--database", str(bench.prior))
        yield Row("limb with a database", cost.cpu, file.stem)


def many(bench: Bench) -> Iterator[Row]:
    """Fill very many markers by straight lines: what a fill costs besides its method."""
    persons, markers, frames = MANY
    rng = np.random.default_rng(4)
    parts = []
    for number in range(persons):
        one = synthesise("walking", seconds=frames / 120.0, rate=120.0, body=Body(seed=number))
        parts.append(one.positions[:frames, :markers] + [0.0, 2000.0 * number, 0.0])
    positions = np.concatenate(parts, axis=1)
    for marker in range(0, positions.shape[1], 3):
        start = rng.integers(EDGE, frames - 2 * MEAN_LENGTH)
        positions[start : start + MEAN_LENGTH, marker] = np.nan
    labels = tuple(f"P{i:04d}" for i in range(positions.shape[1]))
    file = bench.written(pf.Clip(positions, labels, 120.0), "many")
    cost = bench.fill(file, "--method", "linear")
    yield Row("many markers", cost.cpu, f"{len(labels)} markers, {frames} frames, linear")


def long(bench: Bench) -> Iterator[Row]:
    """Fill ten minutes at 240 Hz with 60 markers: time, memory and a second thread."""
    one = bench.fill(bench.long_file, repeat=1)
    yield Row("ten minutes", one.cpu)
    two = bench.fill(bench.long_file, threads=2, repeat=1)
    yield Row("memory", max(one.memory, two.memory))
    yield Row("threads", one.wall / two.wall, f"{one.wall:.1f}/{two.wall:.1f} s of wall clock")


ROWS: dict[str, Callable[[Bench], Iterator[Row]]] = {
    "walkl": walkl,
    "raw": raw,
    "scattered": scattered,
    "single": single,
    "limb": limb,
    "many": many,
    "long": long,
}


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_data_option(parser)
    parser.add_argument("--cases", type=Path, help="default: bench/cases.json next to the data")
    parser.add_argument("--database", type=Path, help="prior database for the limb")
    parser.add_argument("--only", default=",".join(ROWS), help="rows, for example raw,limb")
    parser.add_argument("--repeat", type=int, default=2, help="runs of each short fill")
    parser.add_argument("--folder", type=Path, help="keep the files that are made here")
    arguments = parser.parse_args()
    if unknown := set(arguments.only.split(",")) - set(ROWS):
        parser.error(f"--only: no row {', '.join(sorted(unknown))}; there are {', '.join(ROWS)}")
    cases = arguments.cases or arguments.data.parent / "bench" / "cases.json"
    kept = True
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.folder or Path(temporary)
        folder.mkdir(exist_ok=True)
        bench = Bench(folder, arguments.data, cases, arguments.database, arguments.repeat)
        _compile(bench)
        print(f"{'':22s} {'takes':>14s} bound")
        for name in arguments.only.split(","):
            for row in ROWS[name](bench):
                print(row, flush=True)
                kept &= row.is_met
    return 0 if kept else 1


def _compile(bench: Bench) -> None:
    """Fill a short clip twice, so that no measured run compiles."""
    clip = synthesise("walking", seconds=2.0, rate=60.0)
    positions = clip.positions.copy()
    positions[30:60, :6] = np.nan
    clip = clip.with_positions(positions)
    bench.fill(bench.written(clip, "first"), repeat=1)
    pf.fill(clip, method=METHOD)


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
