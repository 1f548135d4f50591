#!/usr/bin/env python
"""Check that every C3D file below a folder can be read, filled and written back.

    python scripts/checks/survey.py FOLDER [--method linear] [--gap 0.25] [--seconds 60]
    [--memory 2]

For each file, a gap is placed in the marker that is visible longest; this gap and those of the
file are filled and written. Outside the records of filled samples no byte may differ from the
source. Filled samples must read back as filled, all others as in the source. Then ezc3d reads the
output, if it can read the source. Each file is processed in a worker process with limits on time
and memory: a file that hangs or crashes a reader becomes a line of the table. Exit status 1 if a
file failed.
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import ezc3d
import numpy as np

from priorfill.cli.encoding import replace_what_is_lacking
from priorfill.clip import Clip
from priorfill.errors import PriorfillError
from priorfill.filling.fill_clip import fill
from priorfill.formats import read_c3d, write_c3d
from priorfill.formats.c3d.layout import parse_layout, read_points

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
from method_alone import method_alone
from worker import DONE, Worker

STEPS = ("read", "filled", "byte-exact", "read back", "ezc3d agrees")
"""Steps for each file, in order; the last only if ezc3d can read the source."""

FLOAT_ERROR = 1e-6
"""Maximum relative error of a coordinate stored in 32 bits, after conversion of units."""

PRELOADED = (
    "ezc3d",
    "priorfill.filling.fill_clip",
    "priorfill.formats",
    "priorfill.methods.interpolation",
)
"""Modules that new processes inherit imported: a file then takes hundredths of a second."""

OFF_ORIGIN = 2e-6
"""File units by which a sample at the origin is moved, because it would read as missing."""


class Job(NamedTuple):
    """A file and the settings of the survey."""

    path: Path
    output: Path
    method: str
    gap: float


@dataclass(frozen=True)
class Row:
    """Steps that a file passed.

    Attributes
    ----------
    path : Path
        The file.
    passed : tuple of str
        The steps that succeeded.
    skipped : str
        Why ezc3d was not compared; empty if it was, or if a previous step failed.
    failure : str
        What went wrong; empty if nothing did.
    samples : int
        Samples written.
    """

    path: Path
    passed: tuple[str, ...]
    skipped: str = ""
    failure: str = ""
    samples: int = 0


def survey_file(job: Job) -> Row:
    """Read, fill, write and compare a file."""
    passed: list[str] = []
    try:
        clip = read_c3d(job.path)
        passed.append("read")
        result = fill(_with_gap(clip, job.gap), method=job.method, options=method_alone())
        passed.append("filled")
        write_c3d(job.output, result.clip, result.filled)
    except PriorfillError as error:
        return Row(job.path, tuple(passed), failure=str(error))
    samples = int(result.filled.sum())
    if not _same_outside(job, clip, result.filled):
        return Row(job.path, tuple(passed), failure="bytes outside the filled samples differ")
    passed.append("byte-exact")
    back = read_c3d(job.output)
    fault = _fault(clip, result.clip, result.filled, back, job.output)
    if fault:
        return Row(job.path, tuple(passed), failure=fault)
    return Row(job.path, (*passed, "read back"), samples=samples)


def compare_with_ezc3d(job: Job) -> str:
    """Compare the output as read by ezc3d and by priorfill; return the difference."""
    data = job.output.read_bytes()
    positions, residual = read_points(data, parse_layout(data, job.output.name))
    positions[residual < 0] = np.nan
    positions[np.isnan(positions).any(axis=2)] = np.nan
    theirs = ezc3d.c3d(str(job.output))["data"]["points"][:3].transpose(2, 1, 0)
    if theirs.shape != positions.shape:
        return f"ezc3d reads {theirs.shape[:2]} frames and points of {positions.shape[:2]}"
    theirs = np.where(np.isnan(theirs).any(axis=2, keepdims=True), np.nan, theirs)
    same = np.array_equal(theirs, positions, equal_nan=True)
    return "" if same else "ezc3d reads other positions than we do"


def can_ezc3d(path: Path) -> bool:
    """Return whether ezc3d can read a file; it may crash."""
    try:
        return bool(ezc3d.c3d(str(path))["data"]["points"].shape[2])
    except Exception:  # its C++ code raises any exception
        return False


def _with_gap(clip: Clip, seconds: float) -> Clip:
    """Remove samples in the middle of the longest run of frames with a visible marker."""
    longest, where, middle = 0, 0, 0
    for marker in range(len(clip.labels)):
        seen = np.flatnonzero(np.diff(np.r_[True, clip.missing[:, marker], True].astype(np.int8)))
        for start, stop in zip(seen[::2], seen[1::2], strict=True):
            if stop - start > longest:
                longest, where, middle = stop - start, marker, (start + stop) // 2
    length = min(max(1, round(seconds * clip.rate)), longest - 2)
    if length < 1:
        return clip
    positions = clip.positions.copy()
    start = middle - length // 2
    positions[start : start + length, where] = np.nan
    return clip.with_positions(positions)


def _same_outside(job: Job, clip: Clip, filled: np.ndarray) -> bool:
    """Return whether an output equals its source outside the filled samples."""
    before, after = job.path.read_bytes(), job.output.read_bytes()
    if len(before) != len(after):
        return False
    layout = parse_layout(before, job.path.name)
    frames, markers = np.nonzero(filled)
    points = np.asarray(clip.source.points)[markers]
    changed = np.frombuffer(before, np.uint8) != np.frombuffer(after, np.uint8)
    places = layout.record_offsets(frames, points)[:, None] + np.arange(layout.record_bytes)
    changed[places] = False
    return not changed.any()


def _fault(clip: Clip, wanted: Clip, filled: np.ndarray, back: Clip, output: Path) -> str:
    """Return how the output, read back, differs from the filled clip."""
    if back.labels != clip.labels or back.first_frame != clip.first_frame:
        return "other markers or frames are read back"
    if not np.array_equal(back.positions[~filled], clip.positions[~filled], equal_nan=True):
        return "a sample that was not filled is read back as another"
    layout = parse_layout(output.read_bytes(), output.name)
    off = np.abs(back.positions[filled] - wanted.positions[filled])
    allowed = np.full_like(off, layout.scale * clip.source.mm_per_unit)
    if layout.is_float:
        allowed = np.abs(wanted.positions[filled]) * FLOAT_ERROR
        allowed += OFF_ORIGIN * clip.source.mm_per_unit
    return "" if (off <= allowed).all() else "a filled sample is read back elsewhere"


def survey(
    paths: Iterable[Path], *, method: str, gap: float, seconds: float, memory: int
) -> list[Row]:
    """Survey files, each in a worker process."""
    rows = []
    limits = {"seconds": seconds, "memory": memory, "fresh": True, "preload": PRELOADED}
    with (
        tempfile.TemporaryDirectory() as folder,
        Worker(survey_file, **limits) as ours,
        Worker(compare_with_ezc3d, **limits) as theirs,
        Worker(can_ezc3d, **limits) as able,
    ):
        for path in paths:
            job = Job(path, Path(folder) / f"out{path.suffix.lower()}", method, gap)
            outcome = ours.do(job)
            if outcome.kind != DONE:
                rows.append(Row(path, (), failure=f"{outcome.kind}: {outcome.value}"))
                job.output.unlink(missing_ok=True)
                continue
            row: Row = outcome.value
            if not row.failure:
                outcome = theirs.do(job)
                fault = outcome.value if outcome.kind == DONE else f"ezc3d: {outcome.value}"
                if not fault:
                    row = Row(path, STEPS, samples=row.samples)
                elif able.do(path).value is True:
                    row = Row(path, row.passed, failure=fault, samples=row.samples)
                else:  # nor can it read the source
                    row = Row(path, row.passed, skipped=fault, samples=row.samples)
            rows.append(row)
            job.output.unlink(missing_ok=True)
    return rows


def kind_of(row: Row) -> str:
    """Return a failure without the name and numbers of its file."""
    text = row.failure.replace(f"{row.path.name}: ", "").replace(f"{row.path.stem}: ", "")
    return re.sub(r"\d[\d.e+-]*", "N", text)


def report(rows: Sequence[Row], folder: Path) -> None:
    """Print the tables."""
    groups = defaultdict(list)
    for row in rows:
        groups[str(row.path.parent.relative_to(folder))].append(row)
    width = max(map(len, (*groups, "folder", "all")))
    print(f"{'folder':{width}}  {'files':>5}  " + "  ".join(f"{step:>12}" for step in STEPS))
    for name, some in (*sorted(groups.items()), ("all", rows)):
        done = [sum(step in row.passed for row in some) for step in STEPS]
        print(f"{name:{width}}  {len(some):5}  " + "  ".join(f"{count:12}" for count in done))
    skipped = [row for row in rows if row.skipped]
    failed = defaultdict(list)
    for row in rows:
        if row.failure:
            failed[kind_of(row)].append(row)
    if skipped:
        print(f"\n{len(skipped)} files cannot be read by ezc3d, such as {skipped[0].path.name}")
    if failed:
        print("\nfiles  failure (the first file)")
    for kind, some in sorted(failed.items(), key=lambda item: -len(item[1])):
        print(f"{len(some):5}  {kind} ({some[0].path.relative_to(folder)})")
    share = {step: sum(step in row.passed for row in rows) / max(len(rows), 1) for step in STEPS}
    print(
        f"\n{len(rows)} files, {sum(row.samples for row in rows)} samples filled: "
        f"{share['read']:.1%} read, {share['byte-exact']:.1%} byte-exact, "
        f"{share['read back']:.1%} read back as filled"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Survey a folder."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--method", default="linear", help="fill method")
    parser.add_argument("--gap", type=float, default=0.25, help="length of the gap (s)")
    parser.add_argument("--seconds", type=float, default=60, help="time limit per file (s)")
    parser.add_argument("--memory", type=float, default=2, help="memory limit per file (GB)")
    options = parser.parse_args(arguments)
    paths = sorted(p for p in options.folder.rglob("*") if p.suffix.lower() == ".c3d")
    if not paths:
        print(f"{options.folder}: contains no C3D file", file=sys.stderr)
        return 1
    rows = survey(
        paths,
        method=options.method,
        gap=options.gap,
        seconds=options.seconds,
        memory=int(options.memory * 2**30),
    )
    report(rows, options.folder)
    return int(any(row.failure for row in rows))


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
