#!/usr/bin/env python
"""Peak memory and CPU seconds of filling a long recording.

    python scripts/bench/memory.py [--minutes 10] [--rate 240] [--markers 60] [--method gpr]

Makes a synthetic clip with several kinds of gaps (`long_clip.py`) and fills it through the command
line in a process of its own. The bound, 800 MB, applies to the default length.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from child import CLI, DONE, run

from priorfill.cli.encoding import replace_what_is_lacking

HERE = Path(__file__).resolve().parent

BOUND = 800.0
"""MB. Maximum resident memory of the fill."""


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", default="10")
    parser.add_argument("--rate", default="240")
    parser.add_argument("--markers", default="60")
    parser.add_argument("--method", default="gpr")
    parser.add_argument("--clip", type=Path, help="fill this file instead of making one")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        clip = arguments.clip or Path(folder) / "long.c3d"
        if arguments.clip is None:
            size = ("--minutes", arguments.minutes, "--rate", arguments.rate)
            maker = (sys.executable, str(HERE / "long_clip.py"), str(clip))
            run([*maker, *size, "--markers", arguments.markers])
        output = Path(folder) / f"filled{clip.suffix}"
        size_mb = clip.stat().st_size / 1e6
        read = run([*CLI, "inspect", str(clip), "--json"])
        fill = run(
            [*CLI, "fill", str(clip), "-o", str(output), "--method", arguments.method],
            accepted=DONE,
        )
    print(f"file     {size_mb:8.0f} MB")
    for name, cost in (("inspect", read), ("fill", fill)):
        print(f"{name:8s} {cost.memory:8.0f} MB {cost.cpu:8.1f} s CPU {cost.wall:8.1f} s wall")
    print(fill.output)
    print(f"bound    {BOUND:8.0f} MB: {'kept' if fill.memory <= BOUND else 'EXCEEDED'}")
    return 0 if fill.memory <= BOUND else 1


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
