"""The methods of Tits et al. 2018 on a task, with reasons for what stays missing."""

from __future__ import annotations

from priorfill.errors import MethodError
from priorfill.gaps import Gap
from priorfill.methods.task import Estimate, Progress, Task, no_progress
from priorfill.methods.tits2018.recovery import (
    MODELS,
    centroid,
    often_visible,
    recover,
)
from priorfill.methods.tits2018.tits2018_options import Tits2018Options

__all__ = ["glr", "lgrnn", "li", "lpr", "pma", "wpca"]


MIN_MARKERS = 4
"""A missing marker and its three references."""

NEVER_VISIBLE = "it is never visible; use a method that learns from other recordings"

NO_REFERENCES = (
    "no three other markers are visible together in it and in the frames adjacent to it; "
    "fill these first, or use a method that learns from other recordings"
)

COLLINEAR = "its reference markers lie on one line, or are never visible with it"

TOO_FEW_PREDICTORS = (
    "fewer than four other markers are visible throughout it, or never together with this one; "
    "use pma, which has other models too"
)

NEVER_TOGETHER = (
    "the markers that are visible throughout its gaps are never visible together with it; "
    "use pma, which has other models too"
)


def _filled(
    task: Task,
    progress: Progress,
    models: tuple[str, ...],
    options: Tits2018Options | None,
    source: str,
    failure: str = COLLINEAR,
) -> Estimate:
    """Fill a task by some models; ``failure`` is the reason where none of them has a prediction."""
    options = options or Tits2018Options()
    often = often_visible(task.positions, options)
    if often.sum() < MIN_MARKERS:
        raise MethodError(
            f"{task.name}: {often.sum()} markers are visible in at least "
            f"{options.min_presence:.0%} of the frames; this method needs {MIN_MARKERS}: "
            "one to fill and its three references"
        )
    if "wpca" in models and centroid(task.positions) is None:
        models = tuple(model for model in models if model != "wpca")
        if not models:
            raise MethodError(
                f"{task.name}: no marker is visible in every frame, and poses are centred by those "
                "that are; use pma, which then leaves the PCA out, or fill one marker first"
            )
    recovery = recover(task.positions, task.rate, models, options, progress)

    def reason(gap: Gap) -> str:
        if not task.valid[:, gap.marker].any():
            return NEVER_VISIBLE
        if not often[gap.marker]:
            share = float(task.valid[:, gap.marker].sum()) / len(task.valid)
            return (
                f"it is visible in {share:.0%} of the frames, less than {options.min_presence:.0%}"
            )
        return failure if recovery.failed[gap.start, gap.marker] else NO_REFERENCES

    return Estimate.without_errors(task, recovery.positions, source, reason)


def li(
    task: Task, progress: Progress = no_progress, options: Tits2018Options | None = None
) -> Estimate:
    """Fill gaps by linear interpolation in the frame of three references (``li``).

    Parameters
    ----------
    task : Task
        The clip; its takes are not used.
    progress : callable
        Called with the number of samples done since the last call.
    options : Tits2018Options, optional
        The constants of the published program if not given.

    Returns
    -------
    Estimate
        Gaps without three references stay missing. Errors are not predicted.

    Raises
    ------
    MethodError
        Where fewer than four markers are visible often enough.

    See Also
    --------
    pma : The average of all five models.
    priorfill.methods.rigid_body.fill : With neighbours in a rigid group.
    """
    return _filled(task, progress, ("li",), options, "local interpolation between three markers")


def lpr(
    task: Task, progress: Progress = no_progress, options: Tits2018Options | None = None
) -> Estimate:
    """Fill gaps by a polynomial regression on the shape of three references; see `li`."""
    return _filled(task, progress, ("lpr",), options, "local polynomial regression")


def lgrnn(
    task: Task, progress: Progress = no_progress, options: Tits2018Options | None = None
) -> Estimate:
    """Fill gaps by a mean of frames in which three references have a similar shape; see `li`."""
    return _filled(task, progress, ("lgrnn",), options, "local generalised regression network")


def glr(
    task: Task, progress: Progress = no_progress, options: Tits2018Options | None = None
) -> Estimate:
    """Fill gaps by linear regression on the markers visible throughout; see `li`."""
    source = "global linear regression"
    return _filled(task, progress, ("glr",), options, source, TOO_FEW_PREDICTORS)


def wpca(
    task: Task, progress: Progress = no_progress, options: Tits2018Options | None = None
) -> Estimate:
    """Fill gaps by the weighted PCA of Gløersen and Federolf 2016; see `li`.

    Raises
    ------
    MethodError
        Also where no marker is visible in every frame.
    """
    return _filled(task, progress, ("wpca",), options, "weighted PCA", NEVER_TOGETHER)


def pma(
    task: Task, progress: Progress = no_progress, options: Tits2018Options | None = None
) -> Estimate:
    """Fill gaps by the average of all five models, weighted by probability; see `li`.

    Where no marker is visible in every frame, the average is that of the models without the PCA.
    """
    return _filled(task, progress, MODELS, options, "probabilistic average of five models")
