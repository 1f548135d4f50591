"""Options of a synthetic recording: style of movement, and noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

from priorfill.errors import OptionError

__all__ = ["Noise", "Style", "check_range"]


def check_range(what: str, value: float, low: float, high: float) -> None:
    """Check that a value is in [low, high].

    Raises
    ------
    OptionError
        Where it is not.
    """
    if not (math.isfinite(value) and low <= value <= high):
        raise OptionError(f"{what} is {value:g}; give a value from {low:g} to {high:g}")


@dataclass(frozen=True)
class Style:
    """How a synthetic subject moves.

    The defaults are the published mean movements (`priorfill.synthetic.gait_curves`).

    Attributes
    ----------
    speed : float or None
        Mean speed over the ground (m/s) of walking, turning (0.6 to 2.1) and running (2.2
        to 4.5); None for the natural one. It determines the step length.
    cadence : float or None
        Steps per minute; None for the natural one at the speed.
    amplitude : float
        Factor on the depth of a squat and the extent of a reach.
    arm_swing : float
        Factor on the swing of shoulders and elbows in walking and running.
    step_width : float
        Distance between the feet, perpendicular to the direction of walking (mm).
    toe_out : float
        Angle of each foot outwards (degrees).
    lean : float
        Additional forward inclination of the trunk (degrees).
    asymmetry : float
        Fraction by which the movements of the left side exceed those of the right.
    variability : float
        Factor on the variation between cycles; with 0 all cycles are equal.
    drift : float
        Relative standard deviation of slow changes of all amplitudes.
    turn_rate : float
        Change of heading while turning (degrees/s); positive is to the left.

    Raises
    ------
    OptionError
        Where a value is outside the range of human movement.
    """

    speed: float | None = None
    cadence: float | None = None
    amplitude: float = 1.0
    arm_swing: float = 1.0
    step_width: float = 95.0
    toe_out: float = 7.0
    lean: float = 0.0
    asymmetry: float = 0.0
    variability: float = 1.0
    drift: float = 0.03
    turn_rate: float = 35.0

    def __post_init__(self) -> None:
        if self.speed is not None:
            check_range("the speed (m/s)", self.speed, 0.6, 4.5)
        if self.cadence is not None:
            check_range("the cadence (steps/min)", self.cadence, 70, 210)
        check_range("the amplitude", self.amplitude, 0.3, 1.3)
        check_range("the arm swing", self.arm_swing, 0.0, 2.0)
        check_range("the step width (mm)", self.step_width, 0.0, 250.0)
        check_range("the toe-out angle (degrees)", self.toe_out, -10.0, 30.0)
        check_range("the lean (degrees)", self.lean, -5.0, 20.0)
        check_range("the asymmetry", self.asymmetry, -0.3, 0.3)
        check_range("the variability", self.variability, 0.0, 3.0)
        check_range("the drift", self.drift, 0.0, 0.1)
        check_range("the turn rate (degrees/s)", self.turn_rate, -90.0, 90.0)


@dataclass(frozen=True)
class Noise:
    """Noise of the marker positions.

    Attributes
    ----------
    soft_tissue : float
        Factor on the soft-tissue artefacts of `priorfill.synthetic.noise`; with 0 segments are
        rigid.
    measurement : float
        Standard deviation of the measurement noise (mm), independent in each sample.

    Raises
    ------
    OptionError
        Where a value is negative or unrealistically large.
    """

    soft_tissue: float = 1.0
    measurement: float = 0.15

    def __post_init__(self) -> None:
        check_range("the soft-tissue factor", self.soft_tissue, 0.0, 3.0)
        check_range("the measurement noise (mm)", self.measurement, 0.0, 10.0)
