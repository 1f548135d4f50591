"""A progress bar on a terminal, and nothing elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

from priorfill.cli.encoding import encodable
from priorfill.runtime.display import escaped
from priorfill.runtime.held_files import WINDOWS

__all__ = ["fill_progress", "progress"]


@contextmanager
def progress(
    total: int | None, description: str, *, before: str | None = None, unit: str = ""
) -> Iterator[Callable[[int, int | None], None]]:
    """Show the progress of a task on stderr, if that is a terminal; on Windows, if stdout is, too.

    Parameters
    ----------
    total : int or None
        Number of steps; None if it is not known yet.
    description : str
        The task.
    before : str, optional
        What is done until the number of steps is known, if that is not the task itself.
    unit : str
        What is counted, in the plural.

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
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    texts = {name: encodable(escaped(name), sys.stderr) for name in (description, before or "")}
    with Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.fields[count]}", markup=False),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
        # redirection would send what is printed to a file or a pipe to the terminal
        redirect_stdout=sys.stdout.isatty(),
    ) as bar:
        known = total
        task = bar.add_task(texts[before or description], total=total, count=_count(0, total, unit))

        def show(done: int, total: int | None) -> None:
            nonlocal known
            known = known if total is None else total
            text = description if known is not None or before is None else before
            count = _count(done, known, unit)
            bar.update(task, completed=done, total=known, description=texts[text], count=count)

        yield show


def fill_progress(name: str) -> AbstractContextManager[Callable[[int, int | None], None]]:
    """Show the progress of a fill; `priorfill.FillOptions` takes what is yielded.

    Parameters
    ----------
    name : str
        What is filled.
    """
    before = f"reading and checking {name}"
    return progress(None, f"filling {name}", before=before, unit="samples")


def _count(done: int, total: int | None, unit: str) -> str:
    """Return how much is done as text; empty while the number of steps is not known."""
    if total is None:
        return f"{done}/?" if done else ""
    return f"{done:,}/{total:,} {unit}".rstrip()
