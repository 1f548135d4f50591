#!/usr/bin/env python
"""Speed-up by a second thread, and check that it changes no bit.

    python scripts/bench/threads.py FILE.c3d [--repeat 3]

Fills a file with one thread and with two, in a process each, and compares the output files.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from child import CLI, DONE, run

from priorfill.cli.encoding import replace_what_is_lacking


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path)
    parser.add_argument("--repeat", type=int, default=3)
    arguments = parser.parse_args()
    walls, made = [], []
    with tempfile.TemporaryDirectory() as folder:
        for threads in ("1", "2"):
            output = Path(folder) / f"{threads}.c3d"
            command = [*CLI, "fill", str(arguments.file), "-o", str(output), "--overwrite"]
            costs = [
                run([*command, "--threads", threads], accepted=DONE)
                for _ in range(arguments.repeat)
            ]
            best = min(costs, key=lambda cost: cost.wall)
            print(f"{threads} thread(s) {best.wall:8.2f} s wall {best.cpu:8.2f} s CPU")
            walls.append(best.wall)
            made.append(output.read_bytes())
    print(f"two threads are {walls[0] / walls[1]:.2f} times as fast")
    print(f"files are {'the same' if made[0] == made[1] else 'DIFFERENT'}")
    return 0 if made[0] == made[1] else 1


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
