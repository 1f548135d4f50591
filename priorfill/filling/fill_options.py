"""Options of a fill that few fills need, and the arguments of `fill` as types."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from numbers import Real
from pathlib import Path
from typing import Any, TypedDict

from priorfill.database import Selection
from priorfill.errors import OptionError
from priorfill.filling.fill_cache import FillCache
from priorfill.filling.gap_filter import GapFilter
from priorfill.filling.overrides import Overrides
from priorfill.filling.plausibility_options import PlausibilityOptions
from priorfill.markers.marker_set import MarkerSet
from priorfill.runtime.argument_types import check_attributes, check_number, check_type
from priorfill.runtime.option_texts import Duration, seconds_of

__all__ = ["FillKeywords", "FillOptions"]


@dataclass(frozen=True)
class FillOptions:
    """Options of `priorfill.fill` that few fills need.

    Attributes
    ----------
    method_options : mapping of str to object, or dataclass
        Options of the method that differ from its defaults by dotted name, such as ``{"sigma":
        100.0}`` for ``r1``; or all of them as the method's options class
        (`priorfill.methods.get_options`).
    selection : Selection
        Which clips of the database to learn from; all by default. The clip itself, other versions
        of the same recording and parts of it are never learnt from.
    trust_filled : bool
        Learn also from samples of the database that were filled, as if they were measured.
    marker_set : MarkerSet, optional
        Definition of the marker set. By default the set is recognised by the labels or, if no
        definition fits, found from the data.
    extrapolate : float or str
        s, or frames as text (``"10f"``). Before the first and after the last frame in which at
        least three markers are visible, samples are filled this far; by default they stay missing.
    max_error : float, optional
        mm. Samples with a greater expected mean error, or an unknown one, stay missing; all are
        kept by default.
    plausibility : PlausibilityOptions
        Limits of the check of fills, and whether methods see samples that
        `priorfill.find_artefacts` holds in doubt.
    estimate_errors : bool
        Find expected errors from artificial gaps where the method predicts none. That takes as long
        as two more fills.
    database_state : str
        An earlier `priorfill.PriorDatabase.state` of a database that is given by its folder; by
        default the latest.
    cache : FillCache, optional
        What earlier fills of the same clip computed; it makes a repeated fill faster, and changes
        no result.
    progress : callable, optional
        Called with the number of missing samples done and that of all in the clip's gap groups:
        with 0 before the first is filled, then whenever more are done, last with the total.
    checkpoint : callable, optional
        Called often during a fill, also from its threads; what it raises stops the fill.

    Raises
    ------
    OptionError
        Where `extrapolate` is negative, or `max_error` is not positive.

    See Also
    --------
    priorfill.fill : Fill the gaps of a clip.

    Examples
    --------
    >>> import priorfill as pf
    >>> options = pf.FillOptions(selection=pf.Selection(not_subjects=("anna",)))
    >>> options.trust_filled
    False
    """

    method_options: Any = field(default_factory=dict)
    selection: Selection = field(default_factory=Selection)
    trust_filled: bool = False
    marker_set: MarkerSet | None = None
    extrapolate: Duration = 0.0
    max_error: float | None = None
    plausibility: PlausibilityOptions = field(default_factory=PlausibilityOptions)
    estimate_errors: bool = True
    database_state: str = ""
    cache: FillCache | None = field(default=None, repr=False, compare=False)
    progress: Callable[[int, int], None] | None = field(default=None, repr=False, compare=False)
    checkpoint: Callable[[], None] | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the limits, and types that are easily mistaken."""
        seconds = (Real, str)
        check_type("extrapolate", self.extrapolate, seconds, "seconds, or frames as '10f'")
        sets = (MarkerSet, type(None))
        check_type("marker_set", self.marker_set, sets, "a MarkerSet, as that of a Result")
        kind = PlausibilityOptions
        check_type("plausibility", self.plausibility, kind, kind.__name__)
        check_type("cache", self.cache, (FillCache, type(None)), "a FillCache, or None")
        if self.max_error is not None:
            check_number("max_error", self.max_error)
        for name in ("progress", "checkpoint"):
            if getattr(self, name) is not None:
                check_attributes(name, getattr(self, name), ("__call__",), "a function")
        if not seconds_of(self.extrapolate, 1.0) >= 0.0:
            raise OptionError(f"`extrapolate` is {self.extrapolate}; it must be at least 0")
        if self.max_error is not None and not self.max_error > 0.0:
            raise OptionError(f"`max_error` is {self.max_error:g} mm; it must be above 0")


class FillKeywords(TypedDict, total=False):
    """Arguments of `priorfill.fill` that `priorfill.fill_file` passes on."""

    method: str
    gap_filter: GapFilter | None
    overrides: Overrides | Path | str | None
    reject_artefacts: bool
    options: FillOptions | None
