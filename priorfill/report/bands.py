"""From the bound of a distance in space to bands of single coordinates.

A result states for each filled sample the distance from the truth below which 90 % of the errors
are expected. If errors are normal and alike in all directions, the bound also tells how far each
coordinate may be off.
"""

from __future__ import annotations

__all__ = ["BAND_50", "BAND_90", "HALO_50"]

BAND_90 = 0.658
"""Half the width of the 90 % band of a coordinate, as a share of the 90 % bound in space: the
quantiles of a normal distribution (1.6449) and of the distance of three of them (2.5003)."""

BAND_50 = 0.2
"""Half the width of the 50 % band of a coordinate, likewise. It would be 0.27 for normal errors;
those of fills have a higher peak and heavier tails (``scripts/studies/band_coverage.py``:
the bands hold 92 and 53 %)."""

HALO_50 = 0.48
"""Distance in space below which half of the errors are expected, as a share of the 90 % bound; it
would be 0.62 for normal errors."""
