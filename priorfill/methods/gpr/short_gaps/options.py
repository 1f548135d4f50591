"""Options of the estimates of short gaps."""

from __future__ import annotations

from dataclasses import dataclass

from priorfill.gp.kernels import Matern52
from priorfill.gp.process import GaussianProcess
from priorfill.runtime.option_checks import check_at_least, check_between

__all__ = ["ShortGapOptions"]

_PROCESSES = tuple(GaussianProcess(Matern52(0.3), noise) for noise in (1e-7, 1e-6, 1e-5, 1e-4))


@dataclass(frozen=True)
class ShortGapOptions:
    """How short gaps are estimated over time, and when a regression is spared.

    Attributes
    ----------
    max_seconds : float
        s. Longer gaps are not estimated over time: a regression predicts nearly all of them better.
    processes : tuple of GaussianProcess
        Processes of time; of one kernel, with different noise variances in units of the process's
        own variance. Filtered recordings are predicted best with the smallest, and recordings with
        camera noise with the largest ones.
    samples_per_side : int
        Samples on either side of a gap. More do not predict better.
    context_seconds : float
        s. How far a sample may be from the gap.
    neighbours : int
        Markers that define the frame of a marker's local path.
    length_scale, rigidity_scale : float
        mm. A marker at the rms distance D, whose standard deviation is S, has the weight
        exp(-D² / 2 length_scale²) / (1 + (S / rigidity_scale)²) as neighbour.
    blocks : int
        Blocks of the clip that are left out, for each marker and length of gap.
    min_blocks : int
        With fewer, the error is unknown, and the gap is predicted by regression.
    weight_power : float
        Estimates are weighted by their expected error to the power of minus this.
    prior_blocks : float
        See `priorfill.gp.ensemble.EnsembleOptions`.
    measurement_noise : float
        mm. An estimate with a smaller expected error is kept: more cannot be gained.
    regression_share : float
        An estimate is kept if its expected error is below this share of that of a regression with
        one model, whose ensemble is better. On gaps of 1 to 30 frames in recordings of walking,
        exercises and acrobatics, shares of 0.7 to 0.9 fill alike.
    """

    max_seconds: float = 0.2
    processes: tuple[GaussianProcess, ...] = _PROCESSES
    samples_per_side: int = 6
    context_seconds: float = 0.3
    neighbours: int = 6
    length_scale: float = 200.0
    rigidity_scale: float = 8.0
    blocks: int = 80
    min_blocks: int = 12
    weight_power: float = 8.0
    prior_blocks: float = 8.0
    measurement_noise: float = 0.1
    regression_share: float = 0.75

    def __post_init__(self) -> None:
        check_at_least(self, 0.0, "max_seconds", "context_seconds", "prior_blocks")
        check_at_least(self, 2, "samples_per_side")
        check_at_least(self, 3, "neighbours")
        check_at_least(self, 1.0, "length_scale", "rigidity_scale")
        check_at_least(self, 1, "blocks", "min_blocks")
        check_between(self, 0.0, 20.0, "weight_power")
        check_at_least(self, 0.0, "measurement_noise", "regression_share")
