#!/usr/bin/env python
"""Check that a prior database loses nothing when writers are killed or the disk fails.

    python scripts/checks/torture_database.py [--rounds 200] [--kind KIND] [--seed 0]

Two hundred small C3D files are made. In each round a process works on a database and is disturbed:

kill    SIGKILL: at a random time, shortly after a line of output, when an unfinished file (such as
        a journal) appears in the database, or before, during or after a random call that writes,
        flushes, commits, renames or removes
term    the same with SIGTERM
hup     the same with SIGHUP
swap    files are exchanged while no process is at work: the catalogue is emptied, removed, replaced
        by that of another database or by its own older copy; segments are removed, emptied,
        shortened, lengthened, replaced by those of another database or by older copies; files that
        are not of the database are put next to them
full    no file may grow beyond a random size, or the database is on a tmpfs that becomes full
held    files cannot be renamed, removed or shortened, once or for ever, as on Windows while another
        program has them open
fsync   one call that writes, flushes, commits, renames or removes fails (a write after half of its
        bytes), fails although it was carried out, or fails like every later one

The process is ``priorfill db add`` with all files, or a driver that removes, accepts, compacts,
merges and adds by a random plan and prints what it has begun and finished.

On Windows, kill is TerminateProcess, there are no term and hup, and calls fail as on a full disk
instead of a limit. With ``--reader``, another process opens each database in all its states, with
its segments mapped, and must read the same bytes until it closes them; what could not be removed
meanwhile must go at the next opening. With ``--during compact,remove``, processes are killed in
these steps.

After each round a reader opens the database, verifies it, and compares every clip bit for bit with
an independent computation: every reported clip is present, a change that was begun is present
completely or not at all, and nothing else is present. Then the next writer (``db add``, or the rest
of the plan) must succeed. After an exchange of files, commands must notice it, and change no byte.
Exit status 1 if data was lost or unexpected, or if a disturbed process ended without a clean
message.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from torture.children import execute, work
from torture.clips import WrongError, check_nothing_left, contents
from torture.faults import Fault, Faults
from torture.materials import Materials
from torture.readers import Reader, serve
from torture.rounds import DURING, FILES, KINDS, Row, Torture

__all__ = [
    "Fault",
    "Faults",
    "Materials",
    "Reader",
    "Torture",
    "WrongError",
    "check_nothing_left",
    "contents",
    "main",
]


def print_table(rows: Sequence[Row]) -> None:
    """Print the results of the rounds."""
    print(
        f"{'what':43s} {'rounds':>6s} {'disturbed':>9s} {'unfinished':>10s} {'reported':>8s} "
        f"{'checked':>8s} {'held':>5s} {'good':>10s} {'min':>5s}"
    )
    for row in rows:
        if row.skipped:
            print(f"{row.title:43s} skipped: {row.skipped}")
            continue
        good = f"{row.rounds - len(row.faults)} of {row.rounds}"
        print(
            f"{row.title:43s} {row.rounds:6d} {row.disturbed:9d} {row.unfinished:10d} "
            f"{row.reported:8d} {row.found:8d} {row.held:5d} {good:>10s} {row.seconds / 60:5.1f}"
        )
    print(
        "disturbed: killed while running, or ended with an error; unfinished: a journal or similar "
        "was left;\nreported: clips or steps that the process reported as done; checked: clips "
        "compared bit for bit;\nheld: comparisons of a reader that stayed open"
    )
    for row in rows:
        if row.struck:
            where = ", ".join(f"{kind} {count}" for kind, count in row.struck.most_common())
            print(f"{row.title}: disturbed in {where}")
    for row in rows:
        for fault in row.faults:
            print(f"FAULT in {row.title}, {fault}")


def parse() -> argparse.Namespace:
    """Return the options of the command line."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=200, help="number per row of the table")
    parser.add_argument("--kind", choices=(*KINDS, "all"), default="all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--files", type=int, default=FILES, help="number of clips for db add")
    parser.add_argument("--reader", action="store_true", help="keep databases open meanwhile")
    parser.add_argument(
        "--during",
        default="",
        help=f"kill in these steps, separated by commas: {', '.join(DURING)}",
    )
    parser.add_argument("--quiet", action="store_true", help="only the table")
    arguments = parser.parse_args()
    arguments.during = [step for step in arguments.during.split(",") if step]
    if unknown := set(arguments.during) - set(DURING):
        parser.error(f"unknown steps: {', '.join(sorted(unknown))}")
    return arguments


def main() -> int:
    """Run the rounds."""
    inside: dict[str, Callable[..., None]] = {"--work": work, "--serve-reader": serve}
    if sys.argv[1:2] == ["--child"]:
        return execute([__file__, *sys.argv[1:]])
    if sys.argv[1:2] and sys.argv[1] in inside:
        inside[sys.argv[1]](*sys.argv[2:])
        return 0
    arguments = parse()
    folder = Path(tempfile.mkdtemp(prefix="priorfill-torture-"))

    def say(line: str) -> None:
        if not arguments.quiet:
            print(line, file=sys.stderr, flush=True)

    kinds = KINDS if arguments.kind == "all" else (arguments.kind,)
    with Torture(folder, arguments.seed, arguments.files, say, reader=arguments.reader) as torture:
        try:
            for kind in kinds:
                torture.run(kind, arguments.rounds, arguments.during)
        finally:
            print_table(torture.rows)
    if torture.failed:
        print(f"the databases of failed rounds are kept in {folder}")
    else:
        shutil.rmtree(folder)
    return int(torture.failed)


if __name__ == "__main__":
    sys.exit(main())
