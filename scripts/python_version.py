"""Ends the program with a message if Python is too old. Every Python since 2.7 can read this."""

import sys

__all__ = ["OLDEST"]

OLDEST = (3, 11)
"""As in `pyproject.toml`."""

if sys.version_info < OLDEST:
    running = ".".join(str(number) for number in sys.version_info[:3])
    sys.exit("priorfill needs Python 3.11 or newer; this is Python " + running)
