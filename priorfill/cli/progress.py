"""A progress bar on a terminal, and nothing elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from priorfill.cli.encoding import encodable
from priorfill.runtime.display import escaped
from priorfill.runtime.held_files import WINDOWS

__all__ = ["progress"]


@contextmanager
def progress(total: int | None, description: str) -> Iterator[Callable[[int, int | None], None]]:
    """Show the progress of a task on stderr, if that is a terminal; on Windows, if stdout is, too.

    Parameters
    ----------
    total : int or None
        Number of steps; None if it is not known yet.
    description : str
        The task.

    Yields
    ------
    callable
        To be called with the number of steps done and of all steps (None: unchanged).
    """
    # rich moves the cursor of Windows consoles through stdout, also for what it draws on stderr
    if not sys.stderr.isatty() or (WINDOWS and not sys.stdout.isatty()):
        yield lambda done, total: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    shown = encodable(escaped(description), sys.stderr)
    with Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
        # redirection would send what is printed to a file or a pipe to the terminal
        redirect_stdout=sys.stdout.isatty(),
    ) as bar:
        task = bar.add_task(shown, total=total)

        def show(done: int, total: int | None) -> None:
            if total is not None:
                bar.update(task, total=total)
            bar.update(task, completed=done)

        yield show
