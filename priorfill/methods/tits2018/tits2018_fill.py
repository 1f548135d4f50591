"""The task side: which models a method has, and what it says of gaps."""

from __future__ import annotations

from collections.abc import Callable

from priorfill.errors import MethodError
from priorfill.gaps import Gap
from priorfill.methods.task import Estimate, Task
from priorfill.methods.tits2018.recovery import (
    MODELS,
    centre,
    often,
    recover,
)
from priorfill.methods.tits2018.tits2018_options import Tits2018Options

__all__ = ["glr", "lgrnn", "li", "lpr", "pma", "wpca"]

Progress = Callable[[], None]

PUBLISHED = Tits2018Options()
"""The options of the published program."""

FEWEST_MARKERS = 4
"""A marker to be filled and its three references."""

NEVER = "it is never seen; use a method that learns from other recordings"

NO_REFERENCES = (
    "no three other markers are seen together in it and beside it; fill these first, or use a "
    "method that learns from other recordings"
)

ON_A_LINE = "the markers that it could be held to lie on one line, or are never seen with it"

TOO_FEW = (
    "fewer than four other markers are seen throughout it, or never together with this one; "
    "use pma, which has other models too"
)

NOT_WHOLE = (
    "the markers that are seen throughout its gaps are never seen together with it; "
    "use pma, which has other models too"
)


def _filled(
    task: Task,
    progress: Progress,
    models: tuple[str, ...],
    options: Tits2018Options,
    how: str,
    failure: str = ON_A_LINE,
) -> Estimate:
    """Fill a task by some models."""
    enough = often(task.positions, options)
    if enough.sum() < FEWEST_MARKERS:
        raise MethodError(
            f"{task.name}: {enough.sum()} markers are seen in at least {options.presence:.0%} of "
            f"the frames; this method needs {FEWEST_MARKERS}: one to be filled and three that it "
            "is held to"
        )
    if "wpca" in models and centre(task.positions) is None:
        models = tuple(model for model in models if model != "wpca")
        if not models:
            raise MethodError(
                f"{task.name}: no marker is seen in every frame, and poses are centred by those "
                "that are; use pma, which goes on without the PCA, or fill one marker first"
            )
    recovery = recover(task.positions, task.rate, models, options)
    for _ in task.groups:
        progress()

    def reason(gap: Gap) -> str:
        if not task.valid[:, gap.marker].any():
            return NEVER
        if not enough[gap.marker]:
            share = float(task.valid[:, gap.marker].sum()) / len(task.valid)
            return f"it is seen in {share:.0%} of the frames, less than {options.presence:.0%}"
        return failure if recovery.failed[gap.start, gap.marker] else NO_REFERENCES

    return Estimate.told(task, recovery.positions, how, reason)


def _nothing() -> None:
    """Report no progress."""


def li(task: Task, progress: Progress = _nothing, options: Tits2018Options = PUBLISHED) -> Estimate:
    """Fill gaps by straight lines in the frame of three stiffly linked markers.

    Parameters
    ----------
    task : Task
        The clip; takes are not looked at.
    progress : callable
        Called once a gap group.
    options : Tits2018Options
        All constants.

    Returns
    -------
    Estimate
        Gaps without three references stay missing.

    Raises
    ------
    MethodError
        Where fewer than four markers are seen often enough.
    """
    return _filled(task, progress, ("li",), options, "local interpolation between three markers")


def lpr(
    task: Task, progress: Progress = _nothing, options: Tits2018Options = PUBLISHED
) -> Estimate:
    """Fill gaps by a polynomial of the shape that three stiffly linked markers have; see `li`."""
    return _filled(task, progress, ("lpr",), options, "local polynomial regression")


def lgrnn(
    task: Task, progress: Progress = _nothing, options: Tits2018Options = PUBLISHED
) -> Estimate:
    """Fill gaps by frames in which three stiffly linked markers have a like shape; see `li`."""
    return _filled(task, progress, ("lgrnn",), options, "local generalised regression network")


def glr(
    task: Task, progress: Progress = _nothing, options: Tits2018Options = PUBLISHED
) -> Estimate:
    """Fill gaps by linear regression on the markers seen throughout; see `li`."""
    return _filled(task, progress, ("glr",), options, "global linear regression", TOO_FEW)


def wpca(
    task: Task, progress: Progress = _nothing, options: Tits2018Options = PUBLISHED
) -> Estimate:
    """Fill gaps by weighted PCA; see `li`.

    Raises
    ------
    MethodError
        Where no marker is seen in every frame, too.
    """
    return _filled(task, progress, ("wpca",), options, "weighted PCA", NOT_WHOLE)


def pma(
    task: Task, progress: Progress = _nothing, options: Tits2018Options = PUBLISHED
) -> Estimate:
    """Fill gaps by the mean of all five models, weighed by how likely distances are; see `li`.

    Where no marker is seen in every frame, by the mean of the four others.
    """
    return _filled(task, progress, MODELS, options, "probabilistic average of five models")
