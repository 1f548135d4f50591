#!/usr/bin/env python
"""Check that a study with bad files and killed processes fills all that can be filled.

    python scripts/checks/torture_study.py [--data FOLDER] [--good 92] [--garbage 5] [--hanging 1]
    [--hungry 1] [--blocked 1] [--kills 2] [--cluster] [--method linear]
    [--minutes 0.5]

Makes a study of recordings with gaps, and of files

good       the only ones that can be filled
garbage    of random bytes, or cut off
hanging    at which a reader hangs
hungry     for which a reader takes 30 GB
blocked    whose output is there already, as a folder

Then `priorfill batch` fills it, while some of its processes are killed (with ``--cluster`` workers
of Dask, else the children that fill), and once more, for jobs whose children were killed. All good
files must come out as a fill of the file alone writes them, all others must be reported with a
reason; no temporary file may be left. Exit status 1 if that is not so.

The readers are doubles: a module ``sitecustomize`` that children import lets them hang or take
memory.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil

import priorfill as pf
from priorfill.cli.encoding import replace_what_is_lacking

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
from recordings import add_data_option
from study_files import count_files, make_study, outputs

BAD = ("garbage", "hanging", "hungry", "blocked")
"""Kinds of files that cannot be filled."""

SITE = """
import io, sys, time
if any(word.startswith("batch-") for word in sys.orig_argv):
    true_open = io.open
    def open(file, *arguments, **options):
        name = str(file)
        if "hanging" in name and name.endswith(".c3d"):
            time.sleep(1e6)
        if "hungry" in name and name.endswith(".c3d"):
            held = [bytearray(b"x") * (1 << 26) for _ in range(480)]
        return true_open(file, *arguments, **options)
    io.open = open
"""
"""The double of readers: in children, files of some names are not opened."""

GB = "1"
"""Memory that a fill may use."""

TEMPORARY = ".priorfill-*"
"""Files that are not finished."""

OF_DASK = "dask-scratch-space"
"""Folder that Dask keeps for temporary files, and clears when it is used the next time."""

FINE = "good files are right, others are reported, and nothing is left"
"""Printed where there is no fault."""

DONE = (0, 3)
"""Exit statuses of a study in which something was filled."""


@dataclass(frozen=True)
class Plan:
    """What a study is made of.

    Attributes
    ----------
    numbers : dict of str to int
        Number of files of each kind.
    kills : int
        Number of processes to kill.
    cluster : bool
        Whether Dask runs the jobs.
    method : str
        The method, one that learns from a clip alone.
    minutes : float
        Time that a fill may take.
    """

    numbers: dict[str, int]
    kills: int
    cluster: bool
    method: str
    minutes: float


def make_files(data: Path, folder: Path, plan: Plan) -> dict[str, list[str]]:
    """Make the study; return the names of its files by kind."""
    rng = random.Random(0)
    source, output = folder / "in", folder / "out"
    make_study(data, source, plan.numbers["good"])
    names = {"good": sorted(outputs(source))}
    one = (source / names["good"][0]).read_bytes()
    for kind in BAD:
        names[kind] = [f"bad/{kind}{number}.c3d" for number in range(plan.numbers[kind])]
        for number, name in enumerate(names[kind]):
            path = source / name
            path.parent.mkdir(exist_ok=True)
            broken = rng.randbytes(20_000) if number % 2 else one[: rng.randrange(len(one) // 2)]
            path.write_bytes(broken if kind == "garbage" else one)
            if kind == "blocked":
                (output / name).mkdir(parents=True)
    return names


def run_batch(folder: Path, plan: Plan, kills: int) -> tuple[int, list[dict[str, Any]], int]:
    """Fill the study; return the exit status, the outcomes, and the number of kills."""
    site, temporary = folder / "site", folder / "tmp"
    site.mkdir(exist_ok=True)
    temporary.mkdir(exist_ok=True)
    (site / "sitecustomize.py").write_text(SITE, encoding="utf-8")
    paths = [str(site), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(paths),
        **dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(temporary)),
    }
    command = [
        *(sys.executable, "-m", "priorfill", "batch", str(folder / "in"), "--json"),
        *("--output", str(folder / "out"), "--method", plan.method, "--workers", "2"),
        *("--time-limit", str(plan.minutes), "--memory-limit", GB),
        *(("--cluster", "local") if plan.cluster else ()),
    ]
    with (folder / "printed").open("w+b") as printed:
        process = psutil.Popen(command, stdout=printed, env=environment)
        try:
            killed = kill_some(process, folder / "out", plan, kills)
            status = process.wait()
        finally:
            if process.poll() is None:
                process.kill()
        printed.seek(0)
        text = printed.read()
    return status, json.loads(text) if text else [], killed


def kill_some(process: psutil.Popen, output: Path, plan: Plan, kills: int) -> int:
    """Kill some processes of a study while files are filled; return the number."""
    mark = "--multiprocessing-fork" if plan.cluster else "batch-job"
    for number in range(kills):
        wanted = plan.numbers["good"] * (number + 1) // (kills + 2)
        target = None
        while target is None or count_files(output) < wanted:
            if process.poll() is not None:
                return number
            time.sleep(0.05)
            target = _one_of(process, mark)
        target.kill()
    return kills


def _one_of(process: psutil.Popen, mark: str) -> psutil.Process | None:
    """Return a process that another one has started, by a word of its command."""
    try:
        for child in process.children(recursive=True):
            if mark in child.cmdline():
                return child
    except psutil.Error:  # it ended just now
        pass
    return None


def faults(folder: Path, names: dict[str, list[str]], outcomes: list[dict[str, Any]]) -> list[str]:
    """Return what is wrong with the outcomes and the files."""
    found = []
    by_name = {one["name"]: one for one in outcomes}
    for kind in BAD:
        for name in names[kind]:
            one = by_name.get(name, {})
            if one.get("status") != "failed" or not one.get("reason"):
                found.append(f"{name}: is not reported: {one.get('status')}")
    made = outputs(folder / "out")
    for name in names["good"]:
        status = by_name.get(name, {}).get("status")
        if status not in ("filled", "incomplete", "no gaps"):
            found.append(f"{name}: {status}: {by_name.get(name, {}).get('reason')}")
        elif made.get(name) != (folder / "alone" / name).read_bytes():
            found.append(f"{name}: is not what a fill of the file alone writes")
    places = (folder / "out", folder / "in", folder / "tmp")
    left = [path for place in places for path in place.rglob(TEMPORARY)]
    left += [path for path in (folder / "tmp").iterdir() if path.name != OF_DASK]
    found += [f"{path} is left" for path in left]
    return found + [f"{name}: should not be there" for name in {*made} - {*names["good"]}]


def fill_alone(folder: Path, names: Sequence[str], method: str) -> None:
    """Fill each good file alone."""
    for name in names:
        target = folder / "alone" / name
        target.parent.mkdir(parents=True, exist_ok=True)
        pf.fill_file(folder / "in" / name, target, method=method)


def main() -> int:
    """Make the study, fill it, and print what became of it."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_data_option(parser)
    for kind, number in {"good": 92, "garbage": 5, **dict.fromkeys(BAD[1:], 1), "kills": 2}.items():
        parser.add_argument(f"--{kind}", type=int, default=number, help="number")
    parser.add_argument("--cluster", action="store_true", help="kill workers of Dask")
    parser.add_argument("--method", default="linear", help="one that learns from a clip alone")
    parser.add_argument(
        "--minutes", type=float, default=0.5, help="limit of a fill; more on a busy computer"
    )
    given = parser.parse_args()
    numbers = {kind: getattr(given, kind) for kind in ("good", *BAD)}
    plan = Plan(numbers, given.kills, given.cluster, given.method, given.minutes)
    with tempfile.TemporaryDirectory(prefix="priorfill-torture-") as name:
        folder = Path(name)
        names = make_files(given.data, folder, plan)
        fill_alone(folder, names["good"], plan.method)
        found = []
        for kills in (plan.kills, 0) if plan.kills else (0,):
            status, outcomes, killed = run_batch(folder, plan, kills)
            failed = sum(one["status"] == "failed" for one in outcomes)
            print(f"{len(outcomes)} files: {failed} failed; {killed} processes killed", flush=True)
            found += [f"exit status {status}"] * (status not in DONE)
        for one in outcomes:
            if one["status"] == "failed":
                print(f"    {one['name']}: {one['reason']}")
        found += faults(folder, names, outcomes)
    print("\n".join(f"FAULT: {fault}" for fault in found) or FINE)
    return int(bool(found))


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
