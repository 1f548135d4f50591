"""Artefacts as JSON values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from priorfill.runtime.json_numbers import json_number

if TYPE_CHECKING:
    from priorfill.artefacts.artefact import Artefact
    from priorfill.clip import Clip

__all__ = ["artefact_facts"]


def artefact_facts(artefacts: Sequence[Artefact], clip: Clip) -> list[dict[str, Any]]:
    """Return artefacts in the form of the JSON output.

    Parameters
    ----------
    artefacts : sequence of Artefact
        As from `priorfill.find_artefacts`.
    clip : Clip
        The clip; its numbering of frames is used.
    """
    first = clip.first_frame
    return [
        {
            "kind": one.kind,
            "markers": list(one.markers),
            "first_frame": first + one.start,
            "last_frame": first + one.stop - 1,
            "size_mm": round(one.size, 1),
            "reference_marker": one.reference_marker or None,
            "distance_mm": json_number(one.distance, 1),
            "typical_distance_mm": json_number(one.typical_distance, 1),
            "spread_mm": json_number(one.spread, 1),
            "evidence": one.evidence,
        }
        for one in artefacts
    ]
