"""Kinds of artefact, and the description of a single one."""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["JUMP", "KINDS", "LABEL_SWAP", "MISLABELLED", "SPIKE", "STUCK", "Artefact"]

SPIKE, JUMP, MISLABELLED = "spike", "jump", "mislabelled"
LABEL_SWAP, STUCK = "label swap", "stuck"

KINDS = {
    SPIKE: "leaves its path for a moment",
    JUMP: "is in a different place",
    MISLABELLED: "appears to be mislabelled",
    LABEL_SWAP: "appear to have swapped labels",
    STUCK: "does not move while the body does",
}
"""Every kind of artefact, with a predicate for messages ("LWRA leaves its path for a moment")."""


@dataclass(frozen=True)
class Artefact:
    """Measured samples that cannot belong to the marker they are labelled as.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    markers : tuple of str
        The marker; for a label swap both markers.
    start, stop : int
        Frames ``start <= frame < stop``, counted from 0 at the clip's first frame.
    size : float
        mm. Size of the jump at the ends; for a label swap the distance between the two markers;
        for a stuck marker how far its reference marker moves meanwhile. 0 where the path does not
        jump.
    reference_marker : str
        The reference marker that shows the artefact most clearly, or the marker whose path a
        mislabelled one continues; empty if there is none.
    distance, typical_distance, spread : float
        mm. Distance from the reference marker during the artefact; its median in the rest of the
        clip; and the standard deviation of the latter. NaN where the distance is no evidence.

    See Also
    --------
    find_artefacts : Finds the artefacts of a clip.

    Examples
    --------
    >>> Artefact("spike", ("LWRA",), 10, 12, 61.0, "LWRB", 102.0, 58.0, 2.5).evidence
    'LWRA-LWRB 102 mm, usually 58 +- 2.5; its path jumps by 61 mm'
    """

    kind: str
    markers: tuple[str, ...]
    start: int
    stop: int
    size: float
    reference_marker: str = ""
    distance: float = math.nan
    typical_distance: float = math.nan
    spread: float = math.nan

    @property
    def evidence(self) -> str:
        """The measurements that show the artefact, as a phrase for messages."""
        if self.kind == LABEL_SWAP:
            return f"each continues the path of the other, {self.size:.0f} mm apart"
        if self.kind == MISLABELLED and math.isnan(self.distance) and self.reference_marker:
            return (
                f"continues the path of {self.reference_marker}, which is missing then, "
                f"{self.size:.0f} mm apart"
            )
        if self.kind == STUCK:
            return (
                f"exactly the same place while {self.reference_marker} moves by {self.size:.0f} mm"
            )
        phrases = []
        if not math.isnan(self.distance):
            phrases.append(
                f"{self.markers[0]}-{self.reference_marker} {self.distance:.0f} mm, "
                f"usually {self.typical_distance:.0f} +- {self.spread:.1f}"
            )
        if self.size:
            phrases.append(f"its path jumps by {self.size:.0f} mm")
        return "; ".join(phrases)
