#!/usr/bin/env python
"""Speed-up of a study by a second worker, and check that nothing changes its files.

    python scripts/bench/study.py [--data FOLDER] [--files N] [--bar 1.7] [options of batch]

Makes gaps in copies of the recordings, and fills the copies with `priorfill batch`: with one
worker, with two, with two workers of Dask, and with a run that is killed once half of the files are
filled, and repeated. All runs must write the same bytes. Further options are those of `batch`, for
example ``--method linear`` where only the bytes count. Exit status 1 if files differ, or two
workers are not as many times as fast as one as ``--bar`` demands.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from child import CLI, DONE, run

from priorfill.cli.encoding import replace_what_is_lacking

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
from recordings import add_data_option
from study_files import kill_half_way, make_study, outputs

RUNS = {
    "1 worker": ("--workers", "1"),
    "2 workers": ("--workers", "2"),
    "2 workers of Dask": ("--workers", "2", "--cluster", "local"),
    "killed, and again": ("--workers", "2"),
}
"""Options of each run; the first is compared with all others."""

KILLED = "killed, and again"
"""The run of two processes."""


def main() -> int:
    """Run the benchmark."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_data_option(parser)
    parser.add_argument("--files", type=int, help="number of recordings; all by default")
    parser.add_argument("--bar", type=float, default=1.7, help="speed-up that is demanded")
    arguments, options = parser.parse_known_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        samples = make_study(arguments.data, folder / "in", arguments.files)
        print(f"{len(outputs(folder / 'in'))} files, {samples} samples removed")
        walls, made = {}, {}
        for title in RUNS:
            if "--cluster" in RUNS[title] and find_spec("distributed") is None:
                print(f"{title:18s} left out: distributed is not installed")
                continue
            walls[title] = _run(title, folder, options)
            made[title] = outputs(folder / title)
    return _compare(walls, made, arguments.bar)


def _run(title: str, folder: Path, options: Sequence[str]) -> float:
    """Fill the study, and return the seconds of the last process."""
    where = (str(folder / "in"), "--output", str(folder / title))
    command = [*CLI, "batch", *where, *RUNS[title], *options]
    if title == KILLED:
        left = kill_half_way(command, folder / "in", folder / title)
        print(f"{title:18s} {left} files were filled before the first process was killed")
    cost = run(command, accepted=DONE)
    print(f"{title:18s} {cost.wall:8.1f} s wall {cost.cpu:8.1f} s CPU", flush=True)
    return cost.wall


def _compare(walls: dict[str, float], made: dict[str, dict[str, bytes]], bar: float) -> int:
    """Print the speed-up and whether the files are the same; return the exit status."""
    one, two = [*walls.values()][:2]
    print(f"two workers are {one / two:.2f} times as fast as one; the bar is {bar:g}")
    first, *others = made.values()
    differ = sorted({name for other in others for name in first if other.get(name) != first[name]})
    more = sorted({name for other in others for name in other if name not in first})
    for name in [*differ, *more]:
        print(f"DIFFERENT: {name}")
    if not differ and not more:
        print(f"{len(first)} files are the same in {len(made)} runs")
    return int(bool(differ or more) or one / two < bar)


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
