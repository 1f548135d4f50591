#!/usr/bin/env python
"""Where a fill spends its time: functions by own and by total time, and time by package.

    python scripts/bench/profile_fill.py [--cold] [--top 25] [--keep FILE] FILE [options of fill]

Runs `priorfill fill` under cProfile in this process, on one thread, so that all work is seen. It
runs twice, and the second run is measured; ``--cold`` measures the first one, with its imports and
compiled code. Profiling slows down Python functions, not loops in compiled code: compare shares,
and measure gains without it. ``--keep`` writes the profile for other programs.
"""

from __future__ import annotations

import argparse
import contextlib
import cProfile
import io
import pstats
import re
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import PurePath

from priorfill.cli import main as priorfill
from priorfill.cli.encoding import replace_what_is_lacking

INCOMPLETE = 3
"""Exit status of a fill that leaves gaps."""


def main() -> int:
    """Fill and print the profile."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cold", action="store_true", help="measure the first fill")
    parser.add_argument("--top", type=int, default=25, help="functions of each table")
    parser.add_argument("--keep", help="write the profile to this file")
    arguments, of_fill = parser.parse_known_args()
    if not arguments.cold:
        fill(of_fill)
    profile = cProfile.Profile()
    began = time.process_time()
    profile.enable()
    fill(of_fill)
    profile.disable()
    print(f"{time.process_time() - began:.2f} s of CPU, profiling included")
    if arguments.keep:
        profile.dump_stats(arguments.keep)
    stats = pstats.Stats(profile)
    packages = Counter[str]()
    for (file, _, function), (_, _, own, _, _) in stats.stats.items():  # type: ignore[attr-defined]
        packages[package_of(file, function)] += own
    print("\nown time by package")
    for package, seconds in packages.most_common(arguments.top):
        print(f"{seconds:8.3f} s  {package}")
    stats.strip_dirs()
    for order in ("tottime", "cumtime"):
        stats.sort_stats(order).print_stats(arguments.top)
    return 0


def fill(arguments: Sequence[str]) -> None:
    """Run `priorfill fill` without its output."""
    errors = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(errors):
        try:
            priorfill(["fill", "--threads", "1", *arguments])
        except SystemExit as end:
            status = end.code
    if status not in (0, INCOMPLETE):
        raise SystemExit(errors.getvalue())


def package_of(file: str, function: str) -> str:
    """Return the package, or folder of priorfill, that a function belongs to."""
    parts = PurePath(file).parts
    if "priorfill" in parts:
        last = len(parts) - 1 - parts[::-1].index("priorfill")
        return "/".join(parts[last:-1])
    if "site-packages" in parts:
        return parts[parts.index("site-packages") + 1]
    if file == "~":  # built in
        found = re.search(r"(numpy|scipy|numba|llvmlite)[.\w]*", function)
        return f"{found[0] if found else 'Python'}, built in"
    return "Python"


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
