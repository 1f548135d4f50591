"""From which values on a summary asks for a person."""

from __future__ import annotations

from dataclasses import dataclass

from priorfill.runtime.option_checks import check_at_least

__all__ = ["SummaryLimits"]


@dataclass(frozen=True)
class SummaryLimits:
    """From which values on a trial is to be looked at, or to be recorded again.

    Attributes
    ----------
    error : float
        Expected mean error of a gap (mm). Below 10 mm a fill counts as right in
        `priorfill.report.warning_options`, too.
    gap : float
        Length of a gap (s). A second is a stride: what is missing longer cannot be checked against
        the rest of the same movement.

    Examples
    --------
    >>> SummaryLimits(error=5.0).gap
    1.0
    """

    error: float = 10.0
    gap: float = 1.0

    def __post_init__(self) -> None:
        check_at_least(self, 0.0, *self.__dataclass_fields__)
