"""What can be chosen about a synthetic recording: the manner of moving and the noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

from priorfill.errors import OptionError

__all__ = ["Noise", "Style", "check_range"]


def check_range(what: str, value: float, low: float, high: float) -> None:
    """Refuse a value outside [low, high] with one line that says what to do.

    Raises
    ------
    OptionError
        Where it is outside, or not a number.
    """
    if not (math.isfinite(value) and low <= value <= high):
        raise OptionError(f"{what} is {value:g}; give a value from {low:g} to {high:g}")


@dataclass(frozen=True)
class Style:
    """How a synthetic person moves.

    The defaults are the published mean movements (`priorfill.synthetic.gait_curves`).

    Attributes
    ----------
    speed : float or None
        Mean speed over the ground (m/s) of walking, turning (0.6 to 2.1) and running (2.2
        to 4.5); None for the natural one. The length of the step follows from it.
    cadence : float or None
        Steps per minute; None for the one that goes with the speed.
    amplitude : float
        Factor on the depth of a squat and the extent of a reach.
    arm_swing : float
        Factor on the swing of shoulders and elbows in walking and running.
    step_width : float
        Distance of the feet from the line of progression to each other (mm).
    toe_out : float
        Angle of each foot outwards (degrees).
    lean : float
        Inclination of the trunk forwards that is added throughout (degrees).
    asymmetry : float
        By which fraction the left side moves more than the right.
    variability : float
        Factor on the differences from cycle to cycle; 0 makes every cycle alike.
    drift : float
        Standard deviation of the slow change of all amplitudes, as a fraction.
    turn_rate : float
        Change of heading while turning (degrees/s); positive is to the left.

    Raises
    ------
    OptionError
        Where a value is outside the range for which the movement stays human.
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
    """What keeps the markers from following the bones exactly.

    Attributes
    ----------
    soft_tissue : float
        Factor on the displacement of skin against bone (`priorfill.synthetic.noise` has
        the sizes); 0 makes the segments rigid.
    measurement : float
        Standard deviation of the cameras' error (mm), independent in every sample.

    Raises
    ------
    OptionError
        Where a value is negative or beyond any camera system.
    """

    soft_tissue: float = 1.0
    measurement: float = 0.15

    def __post_init__(self) -> None:
        check_range("the soft-tissue factor", self.soft_tissue, 0.0, 3.0)
        check_range("the measurement noise (mm)", self.measurement, 0.0, 10.0)
