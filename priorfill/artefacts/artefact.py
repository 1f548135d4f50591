"""What trouble is: kinds, and what is said of each."""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["FROZEN", "JUMP", "KINDS", "RELABELLED", "SPIKE", "SWAPPED", "Artefact"]

SPIKE, JUMP, RELABELLED, SWAPPED, FROZEN = "spike", "jump", "relabelled", "swapped", "frozen"

KINDS = {
    SPIKE: "is elsewhere for a moment",
    JUMP: "is elsewhere",
    RELABELLED: "looks relabelled",
    SWAPPED: "look swapped",
    FROZEN: "does not move while its body does",
}
"""Every kind, and what markers of it do."""


@dataclass(frozen=True)
class Artefact:
    """Measured samples that cannot be what they are labelled as.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    markers : tuple of str
        The marker; of a swap both.
    start, stop : int
        Frames ``start <= frame < stop``, counted from the clip's first as 0.
    size : float
        mm: by how far the path breaks; of a swap how far apart the two are; of a frozen marker how
        far its partner goes meanwhile. 0 where a path does not break.
    partner : str
        The marker that tells best, or that a relabelled one is on; empty if there is none.
    distance, usual, spread : float
        mm: how far the partner is there, otherwise (the median), and how much that varies. NaN
        where it is no evidence.
    """

    kind: str
    markers: tuple[str, ...]
    start: int
    stop: int
    size: float
    partner: str = ""
    distance: float = math.nan
    usual: float = math.nan
    spread: float = math.nan

    @property
    def evidence(self) -> str:
        """What tells it, in words and figures."""
        if self.kind == SWAPPED:
            return f"each goes on with the other's path, {self.size:.0f} mm apart"
        if self.kind == RELABELLED and math.isnan(self.distance) and self.partner:
            return (
                f"goes on with the path of {self.partner}, which is missing then, "
                f"{self.size:.0f} mm apart"
            )
        if self.kind == FROZEN:
            return f"exactly the same place while {self.partner} moves by {self.size:.0f} mm"
        told = [f"its path breaks by {self.size:.0f} mm"] if self.size else []
        if not math.isnan(self.distance):
            told.insert(
                0,
                f"{self.markers[0]}-{self.partner} {self.distance:.0f} mm, "
                f"usually {self.usual:.0f} +- {self.spread:.1f}",
            )
        return "; ".join(told)
