"""Kinship: how far recordings agree with the body that is asked for; 1 for its own."""

from __future__ import annotations

__all__ = ["MIRROR_KINSHIP", "STRANGER_KINSHIP", "SYNTHESISED_KINSHIP"]

MIRROR_KINSHIP = 0.95
"""How far a body agrees with its mirror image; 0.7 to 0.95 fill about as well."""

STRANGER_KINSHIP = 0.9
"""How far a body agrees with others, offsets apart; 0.8 to 0.95 fill about as well."""

SYNTHESISED_KINSHIP = 0.8
"""The same for markers placed on a skeleton: as others, and about a centimetre off in poses."""
