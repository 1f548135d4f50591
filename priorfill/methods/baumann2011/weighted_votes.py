"""The method ``neighbours``: the published machinery with kernel-weighted votes.

As `priorfill.methods.baumann2011.neighbour_votes`, but the nearer a neighbour, the more its vote
counts, and the
clip's own frames are searched beside the database. It is what the published method can do without
regression, and tells how much of ``prior``'s gain is due to that.
"""

from __future__ import annotations

from collections.abc import Callable

from priorfill.methods.baumann2011 import neighbour_votes as baumann2011
from priorfill.methods.task import Estimate, Task

__all__ = ["OPTIONS", "fill"]

OPTIONS = baumann2011.Baumann2011Options(neighbours=64, kernel=True, own=True)
"""With weights that fall with distance, more than some tens of neighbours change nothing."""


def fill(task: Task, progress: Callable[[], None] = lambda: None) -> Estimate:
    """Fill the gaps of a task by kernel-weighted neighbours; see `baumann2011.fill`."""
    return baumann2011.fill(task, progress, OPTIONS)
