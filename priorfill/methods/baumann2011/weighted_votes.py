"""The method ``neighbours``: `baumann2011` with distance-weighted votes.

As `priorfill.methods.baumann2011.neighbour_votes`, but nearer neighbours have larger weights
(Tautges et al. 2011), and the clip's own frames are searched in addition to the database. It shows
what the published method can do without regression, for comparison with ``gpr``.
"""

from __future__ import annotations

from dataclasses import dataclass

from priorfill.methods.baumann2011 import neighbour_votes
from priorfill.methods.baumann2011.neighbour_votes import Baumann2011Options
from priorfill.methods.task import Estimate, Progress, Task, no_progress

__all__ = ["NeighboursOptions", "fill"]


@dataclass(frozen=True)
class NeighboursOptions(Baumann2011Options):
    """Options of ``neighbours``: those of `Baumann2011Options` with other defaults.

    With weights that decrease with distance, more than some tens of neighbours change nothing.
    """

    neighbours: int | None = 64
    weight_by_distance: bool = True
    search_own_clip: bool = True


def fill(
    task: Task,
    progress: Progress = no_progress,
    options: NeighboursOptions | None = None,
) -> Estimate:
    """Fill the gaps of a task by distance-weighted neighbours.

    Parameters
    ----------
    task : Task
        The clip and the takes to search.
    progress : callable
        Called with the number of samples done since the last call.
    options : NeighboursOptions, optional
        The defaults if not given.

    Returns
    -------
    Estimate
        As for `priorfill.methods.baumann2011.neighbour_votes.fill`.

    See Also
    --------
    priorfill.methods.baumann2011.neighbour_votes.fill : The published method.
    """
    return neighbour_votes.fill(task, progress, options or NeighboursOptions())
