"""``priorfill`` and ``python -m priorfill``: the command line.

Its imports take some tenths of a second, in which Ctrl-C would show a traceback.
"""

from __future__ import annotations

import sys

__all__ = ["start"]

_EXIT_INTERRUPTED = 130
"""As in `priorfill.cli`, which may not be imported yet."""


def start() -> None:
    """Run the command line, and end with exit status 130 if it is interrupted at any time."""
    try:
        from priorfill.cli import main

        main()
    except KeyboardInterrupt:
        sys.stderr.write("priorfill: interrupted\n")
        sys.exit(_EXIT_INTERRUPTED)


if __name__ == "__main__":
    start()
