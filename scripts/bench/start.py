#!/usr/bin/env python
"""Start-up time: help, import, first and second fill.

    python scripts/bench/start.py [--repeat 5]

Each line is the minimum of several runs, each in a process of its own. The first fill starts with
an empty numba cache.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from child import CLI, DONE, Cost, run

from priorfill.cli.encoding import replace_what_is_lacking

HELP, IMPORT, MORE = 0.15, 0.3, 8.0
"""Bounds (CPU s): `--help`, `import priorfill`, and the extra time of the first fill."""

MAKE = """
import sys
import priorfill as pf
from priorfill.synthetic.demo import make_demo_clip
pf.write(sys.argv[1], make_demo_clip()[1])
"""

HEAVY = """
import sys
from priorfill.cli import main
try:
    main(["--help"])
except SystemExit:
    pass
print(sorted({"numba", "scipy", "numpy", "ezc3d"} & set(sys.modules)), file=sys.stderr)
"""


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=5)
    repeat = parser.parse_args().repeat

    def best(command: tuple[str, ...], times: int = repeat, **options: object) -> Cost:
        return min(run(command, **options) for _ in range(times))

    with tempfile.TemporaryDirectory() as folder:
        clip, output, cache = (str(Path(folder) / name) for name in ("in.c3d", "out.c3d", "cache"))
        run((sys.executable, "-c", MAKE, clip))
        fill = (*CLI, "fill", clip, "-o", output, "--overwrite")
        fresh = {"environment": {"NUMBA_CACHE_DIR": cache}}
        costs = {
            "python": best((sys.executable, "-c", "pass")),
            "--help": best((*CLI, "--help")),
            "import": best((sys.executable, "-c", "import priorfill")),
            "fill -m linear": best((*fill, "-m", "linear"), accepted=DONE),
            "first fill": run(fill, accepted=DONE, **fresh),
            "second fill": best(fill, min(repeat, 2), accepted=DONE, **fresh),
        }
    run((sys.executable, "-c", HEAVY))
    for name, cost in costs.items():
        print(f"{name:16s} {cost.cpu:7.2f} s CPU {cost.wall:7.2f} s wall {cost.memory:6.0f} MB")
    more = costs["first fill"].cpu - costs["second fill"].cpu
    print(f"extra time of the first fill: {more:.2f} s CPU")
    held = costs["--help"].cpu <= HELP and costs["import"].cpu <= IMPORT and more <= MORE
    print(f"bounds {HELP}, {IMPORT}, {MORE}: {'kept' if held else 'EXCEEDED'}")
    return 0 if held else 1


if __name__ == "__main__":
    replace_what_is_lacking()
    sys.exit(main())
