"""Options of the warnings about gaps: from which value each is given."""

from __future__ import annotations

from dataclasses import dataclass

from priorfill.runtime.option_checks import check_at_least

__all__ = ["WarningOptions"]


@dataclass(frozen=True)
class WarningOptions:
    """From which value on a page warns of a gap.

    The figures are those of ``scripts/studies/warning_study.py --methods gpr,linear,rigid`` with
    ``--seed 1`` and ``--seed 7``; the limit of lengths was chosen by the first alone. A warning
    should hardly be given for a fill that is right (mean error below 10 mm) unless it states
    something true, nor for the true positions. Fills above 30 mm are wrong.

    Attributes
    ----------
    jump_ratio : float
        Greatest change of the step at an edge of the fill, as a multiple of the greatest measured
        one of the marker, of its contralateral marker, or of neighbours at that time. Straight
        lines: 73.5 and 65.8 % of the wrong fills, 7.7 and 0.5 % of the right ones, which do bend
        there, most of them by more than 1.5 times as much; true positions: 0.2 and 0.3 %.
    min_jump : float
        mm. Smaller changes are no warning: noise of cameras, a marker that rests.
    speed_ratio : float
        Greatest speed within the fill, as a multiple of the greatest measured one (likewise). True
        positions: 0.6 and 1.0 %.
    min_speed : float
        m/s. Slower motion is no warning.
    length_error : float
        mm. Greatest deviation of the distance within a rigid segment from the range of the measured
        ones. `gpr`: 27.8 and 29.1 % of the wrong fills, 1.5 and 0.5 % of the right ones; true
        positions: 1.1 and 0.6 %.
    length_share : float
        The same as a share of the distance: skin over long segments moves more.
    below_floor : float
        mm. Greatest depth below the floor where the marker rests; shoes and soft floors give way.
        No gap of the two seeds is below.
    wide_bound : float
        mm. Greatest 90 % bound. `gpr`: 93.2 and 95.5 % of the wrong fills, 3.7 and 0.7 % of the
        right ones.
    similar_seconds : float
        s. Gaps of several markers from this length on are expected to profit from a database; in
        shorter ones `gpr` does not look for anything alike.
    min_within_bound : float
        Smallest share of the frames with a true error below the 90 % bound. 0.9 is expected of many
        gaps together; single ones scatter.

    See Also
    --------
    priorfill.write_report : Writes the page with the warnings.

    Examples
    --------
    >>> WarningOptions(wide_bound=30.0).length_error
    15.0
    """

    jump_ratio: float = 1.0
    min_jump: float = 5.0
    speed_ratio: float = 1.2
    min_speed: float = 0.5
    length_error: float = 15.0
    length_share: float = 0.075
    below_floor: float = 15.0
    wide_bound: float = 50.0
    similar_seconds: float = 0.5
    min_within_bound: float = 0.5

    def __post_init__(self) -> None:
        check_at_least(self, 0.0, *self.__dataclass_fields__)
