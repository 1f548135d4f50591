"""``priorfill`` and ``python -m priorfill``: the command line.

Its imports take some tenths of a second, in which Ctrl-C would show a traceback.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress

__all__ = ["start"]

_EXIT_INTERRUPTED = 130
"""As in `priorfill.cli`, which may not be imported yet."""

_STDERR = 2


def start() -> None:
    """Run the command line, and end with exit status 130 if it is interrupted at any time."""
    try:
        from priorfill.cli import main

        main()
    except KeyboardInterrupt:
        with suppress(OSError):  # there may be no stderr; the module that prints may be missing
            os.write(_STDERR, b"priorfill: interrupted\n")
        sys.exit(_EXIT_INTERRUPTED)


if __name__ == "__main__":
    start()
