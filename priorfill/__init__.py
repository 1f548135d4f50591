"""priorfill: fills gaps in optical motion capture from a database of motions.

Examples
--------
Remove samples from a synthetic recording and fill the gap:

>>> import priorfill as pf
>>> from priorfill.synthetic import synthesise
>>> recording = synthesise("walking", seconds=2.0, rate=30.0)
>>> positions = recording.positions.copy()  # (frames, markers, 3), mm; NaN = missing
>>> positions[20:35, recording.labels.index("LKNE")] = float("nan")
>>> result = pf.fill(recording.with_positions(positions))
>>> [(gap.label, gap.start, gap.stop) for gap in result.gaps]
[('LKNE', 20, 35)]
>>> result.complete
True

The same with files:

>>> clip = pf.read("walk.c3d")  # doctest: +SKIP
>>> result = pf.fill(clip, database="lab-priors")  # doctest: +SKIP
>>> pf.write("walk_filled.c3d", result.clip, result.filled)  # doctest: +SKIP

The names in ``__all__`` are the public interface. Each is imported on first use, so that
``import priorfill`` loads neither NumPy nor numba.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from priorfill.artefacts import Artefact, find_artefacts
    from priorfill.clip import Clip
    from priorfill.database import PriorDatabase, Selection
    from priorfill.errors import PriorfillError
    from priorfill.evaluation import Evaluation, evaluate
    from priorfill.filling.fill_clip import fill
    from priorfill.filling.gap_filter import GapFilter
    from priorfill.filling.result import FilledGap, Result
    from priorfill.filling.uncertainty_file import write_uncertainty
    from priorfill.formats import read, write
    from priorfill.gaps import (
        Gap,
        GapGroup,
        find_gaps,
        gap_groups,
    )
    from priorfill.markers.marker_set import MarkerSet

_PLACES = {
    "Clip": "priorfill.clip",
    "Evaluation": "priorfill.evaluation",
    "FilledGap": "priorfill.filling.result",
    "Gap": "priorfill.gaps",
    "GapGroup": "priorfill.gaps",
    "MarkerSet": "priorfill.markers.marker_set",
    "PriorDatabase": "priorfill.database",
    "PriorfillError": "priorfill.errors",
    "Result": "priorfill.filling.result",
    "GapFilter": "priorfill.filling.gap_filter",
    "Selection": "priorfill.database",
    "Artefact": "priorfill.artefacts",
    "evaluate": "priorfill.evaluation",
    "fill": "priorfill.filling.fill_clip",
    "find_gaps": "priorfill.gaps",
    "find_artefacts": "priorfill.artefacts",
    "gap_groups": "priorfill.gaps",
    "read": "priorfill.formats",
    "write": "priorfill.formats",
    "write_uncertainty": "priorfill.filling.uncertainty_file",
}

__all__ = [
    "Artefact",
    "Clip",
    "Evaluation",
    "FilledGap",
    "Gap",
    "GapFilter",
    "GapGroup",
    "MarkerSet",
    "PriorDatabase",
    "PriorfillError",
    "Result",
    "Selection",
    "__version__",
    "evaluate",
    "fill",
    "find_artefacts",
    "find_gaps",
    "gap_groups",
    "read",
    "write",
    "write_uncertainty",
]


def __getattr__(name: str) -> Any:
    """Load a public name when it is first used."""
    if name == "__version__":
        from importlib.metadata import version  # takes longer to import than all else here

        return version("priorfill")
    if name not in _PLACES:
        raise AttributeError(f"module 'priorfill' has no attribute {name!r}")
    return getattr(import_module(_PLACES[name]), name)


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(__all__)
