"""``priorfill`` and ``python -m priorfill``: the command line.

Its imports take some tenths of a second, in which Ctrl-C would show a traceback. What is imported
here and in `priorfill` itself is loaded by Python before (tests/test_public.py), so that only an
interrupt of Python's own start is not caught.
"""

from __future__ import annotations

import os
import sys

__all__ = ["start"]

_EXIT_INTERRUPTED = 130
"""As in `priorfill.cli.exit_status`, which may not be imported yet."""

_STDERR = 2

_BLAS_THREADS = "OPENBLAS_NUM_THREADS"
"""Environment variable of the BLAS library in NumPy and SciPy: its number of threads."""

OBJECTS_BEFORE_COLLECTION = 200_000
"""Objects made until Python looks for those in circles that nobody uses.

A short fill makes 90,000, nearly all by imports and for good; to look through them after every 700,
Python's number, takes it 0.07 s. A raw trial of 122 gaps takes as much memory as without circles
being looked for at all.
"""


def start() -> None:
    """Run the command line, and end with exit status 130 if it is interrupted at any time."""
    try:
        import gc

        # Fills have one BLAS thread each and divide their work themselves. Without this, OpenBLAS
        # starts its own when it is loaded, which take 0.4 s of a short fill for waiting.
        os.environ.setdefault(_BLAS_THREADS, "1")
        gc.set_threshold(OBJECTS_BEFORE_COLLECTION)
        try:
            from priorfill.cli import main

            main()
        finally:
            gc.freeze()  # what is left ends with the process, and needs no search for circles
    except KeyboardInterrupt:
        from contextlib import suppress

        with suppress(OSError):  # there may be no stderr; the module that prints may be missing
            os.write(_STDERR, b"priorfill: interrupted\n")
        _ignore_interrupts()
        sys.exit(_EXIT_INTERRUPTED)
    except SystemExit as end:
        if end.code == _EXIT_INTERRUPTED:
            _ignore_interrupts()
        raise


def _ignore_interrupts() -> None:
    """Let nothing interrupt Python's end.

    If the interrupt came while a class was made (`exec`), Python sends itself another one at its
    end, and would be ended by that signal instead of with our exit status.
    """
    import signal

    if hasattr(signal, "pthread_sigmask"):  # Windows has none
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


if __name__ == "__main__":
    start()
