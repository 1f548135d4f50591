"""Options of the check of fills: a limit for each criterion."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from priorfill.runtime.option_checks import check_at_least

__all__ = ["UNCHECKED", "PlausibilityOptions"]


@dataclass(frozen=True)
class PlausibilityOptions:
    """When a fill is not believed, and what it must not learn from.

    An infinite limit switches its criterion off. The defaults were chosen on recordings from which
    samples were removed (``scripts/studies/plausibility_study.py``).

    Attributes
    ----------
    max_below_floor : float
        mm. Greatest depth below the lowest measured position of markers that rest on the floor.
        Soft floors and shoes give way by centimetres.
    max_speed_ratio : float
        Greatest speed, as a multiple of the fastest measured motion of the marker, of its
        contralateral marker, and of nearby markers at the same time. A marker can move faster in a
        gap than anywhere else, but hardly twice as fast.
    min_speed : float
        m/s. Speeds below this one are plausible in any case: a marker that rests while it is
        measured may move in a gap.
    certain_error : float
        mm. Samples whose error bound is smaller are believed below the floor and at any speed: the
        visible markers show a foot on a stair, or a kick.
    vague_error : float
        mm. Where the error bound is greater, the speed is compared with the measured motion of the
        marker alone, not also with that of the other side and of markers nearby.
    max_jump_ratio : float
        Greatest change of the displacement from one time step to the next, as a multiple of the
        greatest measured one (as for `max_speed_ratio`).
    min_jump : float
        mm. Changes below this one, or below the error bound that the result states, are plausible
        in any case. It is several times the noise of cameras. Where the error is unknown,
        `max_length_error` takes the place of the bound.
    max_length_spread : float
        mm. Markers are on the same rigid segment if the standard deviation of their distance is
        smaller.
    max_length_error : float
        mm. Greatest deviation of such a distance from its measured range. Skin and joints move
        markers by centimetres where the clip does not show it.
    length_std : float
        The deviation may also reach this number of standard deviations that the expected errors of
        the fill imply: an error that the result states is not hidden.
    max_stated_error : float
        mm. Greatest deviation of a distance, however large the expected errors are.
    step_seconds : float
        s. Time step of speeds and jumps; the noise of shorter ones hides the motion.
    neighbour_distance : float
        mm. Markers nearer than this share the motion of a marker: those of a limb do.
    around_seconds : float
        s. A sample is not believed if another one of the same fill fails within this time, and
        neighbours move at the same time if they do so within this time.
    suspect_seconds : float
        s. A failed fill is repeated without measured samples of the marker that are this near to it
        and fail a criterion themselves, or are part of a run shorter than this.
    hide_doubtful : bool
        Whether methods see no samples that `priorfill.find_artefacts` holds in doubt.
    max_doubtful_seconds : float
        s. Runs that last longer are hidden only if their distance from a reference marker differs
        from the usual one by more than half of it: in an unusual posture skin moves markers by
        centimetres for seconds.
    max_doubtful_share : float
        Runs with more than this share of the measured samples of their marker are not hidden: an
        object that is put down in a gap is in another place before it than after it, and neither
        place is the usual one.
    min_spike : float
        mm. Methods see smaller spikes, unless the marker is missing within `suspect_seconds`: they
        are no larger than the errors of fills, and every sample that is not seen costs accuracy.
    max_spike_seconds : float
        s. Likewise for longer ones: a blow with the hand lasts as long and looks alike.
    interpolate_seconds : float
        s. Methods see an interpolated path in place of a run of samples in doubt that is no longer
        than this and lies between others.

    See Also
    --------
    FillOptions : Has these options as ``plausibility``.

    Examples
    --------
    >>> import math
    >>> PlausibilityOptions(max_below_floor=math.inf).max_speed_ratio
    2.0
    """

    max_below_floor: float = 50.0
    max_speed_ratio: float = 2.0
    min_speed: float = 1.0
    certain_error: float = 50.0
    vague_error: float = 250.0
    max_jump_ratio: float = 2.0
    min_jump: float = 10.0
    max_length_spread: float = 10.0
    max_length_error: float = 60.0
    length_std: float = 3.0
    max_stated_error: float = 150.0
    step_seconds: float = 0.01
    neighbour_distance: float = 350.0
    around_seconds: float = 0.1
    suspect_seconds: float = 0.25
    hide_doubtful: bool = True
    max_doubtful_seconds: float = 1.0
    max_doubtful_share: float = 0.3
    min_spike: float = 40.0
    max_spike_seconds: float = 0.2
    interpolate_seconds: float = 0.3

    def __post_init__(self) -> None:
        check_at_least(
            self,
            0.0,
            *(name for name in self.__dataclass_fields__ if name != "hide_doubtful"),
        )

    @classmethod
    def from_json(cls, changes: Mapping[str, Any]) -> PlausibilityOptions:
        """Return the options that `to_json` described.

        Parameters
        ----------
        changes : mapping of str to object
            By name.
        """
        values: dict[str, Any] = {
            name: float(value) if isinstance(value, str) else value
            for name, value in changes.items()
        }
        return cls(**values)

    def to_json(self) -> dict[str, Any]:
        """Return the options that are not at their defaults; infinity is a text, for JSON."""
        default = type(self)()
        values = {one.name: getattr(self, one.name) for one in fields(self)}
        return {
            name: value if math.isfinite(value) else str(value)
            for name, value in values.items()
            if value != getattr(default, name)
        }


UNCHECKED = PlausibilityOptions(
    max_below_floor=math.inf,
    max_speed_ratio=math.inf,
    max_jump_ratio=math.inf,
    max_length_error=math.inf,
)
"""Options that keep every position that a method gives, as comparisons of methods need it."""
