"""A progress bar on a terminal, and nothing elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import TYPE_CHECKING

from priorfill.cli.encoding import encodable
from priorfill.cli.output import duration
from priorfill.runtime.display import escaped
from priorfill.runtime.held_files import WINDOWS

if TYPE_CHECKING:
    from rich.progress import Progress, ProgressColumn

    from priorfill.study.study_options import StudyProgress

MINUTE = 60.0

__all__ = ["fill_progress", "progress", "study_progress"]


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
    if not _is_shown():
        yield lambda done, total: None
        return
    texts = {name: encodable(escaped(name), sys.stderr) for name in (description, before or "")}
    from rich.progress import TimeRemainingColumn

    with _bar(TimeRemainingColumn()) as bar:
        known = total
        task = bar.add_task(texts[before or description], total=total, count=_count(0, total, unit))

        def show(done: int, total: int | None) -> None:
            nonlocal known
            known = known if total is None else total
            text = description if known is not None or before is None else before
            count = _count(done, known, unit)
            bar.update(task, completed=done, total=known, description=texts[text], count=count)

        yield show


@contextmanager
def study_progress() -> Iterator[Callable[[StudyProgress], None]]:
    """Show the progress of a study like that of a task, with the time left.

    Yields
    ------
    callable
        To be called with a `priorfill.StudyProgress`.
    """
    if not _is_shown():
        yield lambda at: None
        return
    from rich.progress import TextColumn

    with _bar(TextColumn("{task.fields[left]}", markup=False)) as bar:
        task = bar.add_task("reading and checking", total=None, count="", left="")

        def show(at: StudyProgress) -> None:
            failed = f", {at.failed:,} failed" if at.failed else ""
            left = "" if at.seconds_left is None else f"{_rounded(at.seconds_left)} left"
            count = f"{at.done:,}/{at.total:,} files{failed}"
            bar.update(
                task, description="filling", completed=at.share, total=1.0, count=count, left=left
            )

        yield show


def _rounded(seconds: float) -> str:
    """Return a duration that is known roughly."""
    return f"{seconds:.0f} s" if seconds < MINUTE else duration(seconds)


def _is_shown() -> bool:
    """Return whether there is a terminal for a progress bar."""
    # rich moves the cursor of Windows consoles through stdout, also for what it draws on stderr
    return sys.stderr.isatty() and (not WINDOWS or sys.stdout.isatty())


def _bar(last: ProgressColumn) -> Progress:
    """Return a progress bar with a column of its own at the end."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.fields[count]}", markup=False),
        last,
        console=Console(stderr=True),
        transient=True,
        # redirection would send what is printed to a file or a pipe to the terminal
        redirect_stdout=sys.stdout.isatty(),
    )


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
