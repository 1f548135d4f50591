"""Options of fills that compare methods, or reproduce their published results."""

from __future__ import annotations

import math
from dataclasses import replace

import priorfill as pf
from priorfill.filling.plausibility_options import UNCHECKED

__all__ = ["method_alone"]


def method_alone(selection: pf.Selection | None = None) -> pf.FillOptions:
    """Return options under which a fill is what the method gives.

    The method sees all measured samples. Nothing that it gives is left out afterwards, at the ends
    of the clip either, and no errors are estimated for it, which would take two more fills.

    Parameters
    ----------
    selection : Selection, optional
        Which clips of the database to learn from; all by default.
    """
    return pf.FillOptions(
        selection=pf.Selection() if selection is None else selection,
        extrapolate=math.inf,
        plausibility=replace(UNCHECKED, hide_doubtful=False),
        estimate_errors=False,
    )
