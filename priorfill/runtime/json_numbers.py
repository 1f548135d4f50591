"""Numbers as JSON has them."""

from __future__ import annotations

import math

__all__ = ["json_number"]


def json_number(value: float, digits: int) -> float | None:
    """Return a rounded number for JSON; None for NaN and infinity, which JSON lacks.

    Parameters
    ----------
    value : float
        The number.
    digits : int
        Decimals that are kept.

    Examples
    --------
    >>> json_number(1.23456, 3), json_number(float("nan"), 3)
    (1.235, None)
    """
    return round(value, digits) if math.isfinite(value) else None
