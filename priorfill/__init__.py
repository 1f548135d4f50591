"""priorfill: fills gaps in optical motion capture from a database of motions.

Examples
--------
>>> import priorfill as pf
>>> clip = pf.read("walk.c3d")
>>> result = pf.fill(clip, database="lab-priors")
>>> pf.write("walk_filled.c3d", result.clip, result.filled)

What is listed in ``__all__`` is the public interface. It is loaded when it is first used, so
that importing priorfill costs next to nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from priorfill.clip import Clip
    from priorfill.database import PriorDatabase, Selection
    from priorfill.errors import PriorfillError
    from priorfill.evaluation import Evaluation, evaluate
    from priorfill.filling import FilledGap, Result, fill
    from priorfill.formats import read, write, write_uncertainty
    from priorfill.gaps import Gap, GapGroup, find_gaps, gap_groups
    from priorfill.markerset import MarkerSet
    from priorfill.scope import Scope
    from priorfill.trouble import Trouble, find_trouble

_PLACES = {
    "Clip": "priorfill.clip",
    "Evaluation": "priorfill.evaluation",
    "FilledGap": "priorfill.filling",
    "Gap": "priorfill.gaps",
    "GapGroup": "priorfill.gaps",
    "MarkerSet": "priorfill.markerset",
    "PriorDatabase": "priorfill.database",
    "PriorfillError": "priorfill.errors",
    "Result": "priorfill.filling",
    "Scope": "priorfill.scope",
    "Selection": "priorfill.database",
    "Trouble": "priorfill.trouble",
    "evaluate": "priorfill.evaluation",
    "fill": "priorfill.filling",
    "find_gaps": "priorfill.gaps",
    "find_trouble": "priorfill.trouble",
    "gap_groups": "priorfill.gaps",
    "read": "priorfill.formats",
    "write": "priorfill.formats",
    "write_uncertainty": "priorfill.formats",
}

__all__ = [
    "Clip",
    "Evaluation",
    "FilledGap",
    "Gap",
    "GapGroup",
    "MarkerSet",
    "PriorDatabase",
    "PriorfillError",
    "Result",
    "Scope",
    "Selection",
    "Trouble",
    "__version__",
    "evaluate",
    "fill",
    "find_gaps",
    "find_trouble",
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
