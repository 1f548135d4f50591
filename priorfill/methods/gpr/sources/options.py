"""Options of the sources of limbs' predictions."""

from __future__ import annotations

from dataclasses import dataclass

from priorfill.gp.features import Alignment
from priorfill.runtime.option_checks import check_at_least, check_between

__all__ = ["GapWindowOptions"]


@dataclass(frozen=True)
class GapWindowOptions:
    """Windows of the database that are as long as a gap.

    Attributes
    ----------
    alignments : tuple of Alignment
        Frames of reference that positions are compared and predicted in, and how the visible
        markers are weighted there; each gives a prediction. Windows are chosen in the first.
    max_windows : int
        Windows that the regression is trained with. 0 leaves windows out.
    min_windows : int
        With fewer nothing is predicted.
    compared_poses : int
        Evenly spaced poses of the gap and its edges whose nearest poses of the database give the
        windows, and that are compared to choose among these.
    neighbours : int
        Nearest poses of each.
    spacing : float
        Least distance of two windows of one take, as a share of their length: closer ones are
        alike.
    node_seconds : float
        s. Greatest distance of the frames that are predicted; a cubic spline passes through them.
    max_nodes : int
        Longer gaps, with more of these frames, are not predicted: no window is like them.
    min_seconds : float
        s. Shorter gaps are not predicted: the samples at their edges determine them.
    edge_weight : float
        Weight of the missing markers at the edges of the gap next to the visible ones in it.
    velocity_seconds : float
        s. A difference in velocity of 1 mm/s counts as this many mm.
    length_scale : float
        Length scale of the squared exponential covariance, in units of the distance of a window
        from its sixth neighbour, over all windows.
    linear : float
        Variance of the linear covariance next to a squared exponential one of variance 1.
    noise_variance : float
        In the same unit.
    own_penalty, stranger_penalty : float
        Factors of the expected errors, when they are weighted against those of the regression of
        poses, where takes of the clip's subject are among the windows, and where they are all of
        others. Best on gaps of limbs in a library of 2,600 motions; with 1 instead, errors are 3
        and 27 % larger: held-out windows of strangers are alike, the clip is not.
    weight_power : float
        The source and the regression of poses are weighted by their expected errors to the power
        of minus this.
    """

    alignments: tuple[Alignment, ...] = (
        Alignment("heading", 220.0, 0.3, rigidity_scale=10.0),
        Alignment("rigid", 220.0, 0.3, rigidity_scale=10.0),
    )
    max_windows: int = 400
    min_windows: int = 20
    compared_poses: int = 8
    neighbours: int = 100
    spacing: float = 0.06
    node_seconds: float = 2.0 / 15.0
    max_nodes: int = 48
    min_seconds: float = 0.3
    edge_weight: float = 0.6
    velocity_seconds: float = 0.13
    length_scale: float = 3.0
    linear: float = 0.3
    noise_variance: float = 0.01
    own_penalty: float = 1.4
    stranger_penalty: float = 3.0
    weight_power: float = 4.0

    def __post_init__(self) -> None:
        check_at_least(self, 0, "max_windows", "edge_weight", "velocity_seconds", "linear")
        check_at_least(self, 3, "min_windows", "max_nodes", "compared_poses")
        check_at_least(self, 1, "neighbours")
        check_at_least(self, 1e-3, "node_seconds", "min_seconds", "length_scale")
        check_at_least(self, 1e-8, "noise_variance")
        check_at_least(self, 0.1, "own_penalty", "stranger_penalty")
        check_between(self, 0.0, 1.0, "spacing")
        check_between(self, 0.0, 100.0, "weight_power")
