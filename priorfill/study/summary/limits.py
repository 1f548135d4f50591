"""From which values on a summary asks for a person."""

from __future__ import annotations

from dataclasses import dataclass

from priorfill.runtime.option_checks import check_at_least

__all__ = ["SummaryLimits"]

LONG_SECONDS = 1.0
"""s. A stride lasts about as long: what is missing longer cannot be compared with the rest of the
same movement."""


@dataclass(frozen=True)
class SummaryLimits:
    """From which values on a trial is to be looked at, or to be recorded again.

    The figures of ``scripts/studies/summary_rule_study.py`` are in docs/study_summary.md.

    Attributes
    ----------
    error : float
        Expected mean error of a gap (mm). Fills below 10 mm count as right
        (`priorfill.report.warning_options`).
    gap : float, optional
        Length of a gap (s). By default, a length alone is no reason to look: long gaps with a
        small expected error are seldom wrong.

    Examples
    --------
    >>> SummaryLimits(error=5.0).long, SummaryLimits(gap=0.2).long
    (1.0, 0.2)
    """

    error: float = 10.0
    gap: float | None = None

    def __post_init__(self) -> None:
        check_at_least(self, 0.0, "error", *(() if self.gap is None else ("gap",)))

    @property
    def long(self) -> float:
        """Length (s) from which on a gap that is not filled well is lost."""
        return LONG_SECONDS if self.gap is None else self.gap
