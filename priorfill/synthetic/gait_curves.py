"""Published joint angles of walking and running over the gait cycle.

0 % is the initial contact of the foot. The curves are periodic cubic splines. **Their nodes are not
from a published table: they follow the published mean curves approximately, by eye.** They were
then adjusted by a least-squares fit, by at most 5.4 degrees, so that the stance foot of the mean
body hardly moves and the pelvis moves vertically as in people. The peaks are the values given in
the sources (`WALKING_PEAKS`, `RUNNING_PEAKS`); the fit preserves them, and the tests check them.

Hip flexion is that of the thigh against the vertical (the pelvis counts as upright), knee
flexion and ankle dorsiflexion are positive; all in degrees.

Sources
-------
[P10] Perry and Burnfield, *Gait Analysis: Normal and Pathological Function*, 2nd ed. 2010:
    thigh by phase of gait (20 at contact, -20 in terminal stance, 25 in mid-swing),
    knee (60 in initial swing), pelvis (4 degrees drop, 5 degrees rotation each way), arm
    swing (24 degrees extension to 8 flexion).
[W09] Winter, *Biomechanics and Motor Control of Human Movement*, 4th ed. 2009, and *The
    Biomechanics and Motor Control of Human Gait*, 2nd ed. 1991: knee and ankle at natural
    cadence (knee about 20 in stance and 64 in swing, ankle about 10 and -20).
[K90] Kadaba, Ramakrishnan, Wootten, J. Orthop. Res. 8 (1990): hip range of 43 degrees.
[N98] Novacheck, *The biomechanics of running*, Gait and Posture 7 (1998): toe-off at 39 %,
    knee 45 in absorption, 25 in propulsion, 90 in swing.
[M67] Murray, Sepic, Barnard, *Patterns of sagittal rotation of the upper limbs in walking*,
    Phys. Ther. 47 (1967): elbow range about 30 degrees.
[S10] Schoenfeld, *Squatting kinematics and kinetics*, J. Strength Cond. Res. 24 (2010): half
    squats bend the knees by 70 to 100 degrees, deep squats by more.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

__all__ = [
    "RUNNING",
    "RUNNING_PEAKS",
    "SQUAT_KNEE",
    "STEPPING",
    "WALKING",
    "WALKING_PEAKS",
    "GaitCurves",
    "cyclic",
]

Curve = Callable[[NDArray[np.float64]], NDArray[np.float64]]

WALKING_PEAKS = MappingProxyType(
    {
        "hip_flexion": 25.0,  # [P10] mid-swing
        "hip_extension": -18.5,  # between [P10] -20 and [W09] -11, so that the range is [K90]'s
        "knee_stance": 19.0,  # [P10] 15 to 20, [W09] 20
        "knee_swing": 62.0,  # [P10] 60, [W09] 64
        "ankle_dorsiflexion": 10.0,  # [P10], [W09]
        "ankle_plantarflexion": -20.0,  # [W09], just after toe-off
    }
)
"""Peak angles in walking at natural cadence (degrees)."""

RUNNING_PEAKS = MappingProxyType(
    {
        "knee_absorption": 45.0,  # [N98]
        "knee_propulsion": 25.0,  # [N98]
        "knee_swing": 90.0,  # [N98]
    }
)
"""Peak angles in running (degrees)."""

SQUAT_KNEE = 105.0
"""Knee flexion of a squat to about horizontal thighs: between half and deep [S10]."""


def cyclic(*nodes: tuple[float, float]) -> Curve:
    """Return the periodic cubic spline through nodes (percent of the cycle, value).

    The curve is a function of the phase in cycles, any real number.
    """
    percent, value = np.array(nodes).T
    spline = CubicSpline(
        np.append(percent, percent[0] + 100.0) / 100.0,
        np.append(value, value[0]),
        bc_type="periodic",
    )

    def curve(phase: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(spline(np.mod(phase - percent[0] / 100.0, 1.0) + percent[0] / 100.0))

    return curve


@dataclass(frozen=True)
class GaitCurves:
    """A gait: sagittal curves of a leg, its timing, and amplitudes of the other movements.

    Attributes
    ----------
    hip, knee, ankle : callable
        Angle (degrees) as a function of the phase (cycles) of the leg.
    toe_off : float
        Phase at which the foot leaves the floor.
    flat : tuple of float
        Phases between which the foot is flat on the floor.
    pelvis_list, pelvis_rotation, thorax_rotation : float
        Amplitudes to each side (degrees).
    pelvis_tilt, trunk_lean : float
        Mean inclinations forwards (degrees).
    sway : float
        Amplitude of the leg's inclination to the side (degrees).
    shoulder, elbow : tuple of float
        Mean flexion and amplitude of the swing (degrees).
    shoulder_abduction, shoulder_rotation : float
        Mean angles (degrees).
    """

    hip: Curve
    knee: Curve
    ankle: Curve
    toe_off: float
    flat: tuple[float, float]
    pelvis_list: float
    pelvis_rotation: float
    thorax_rotation: float
    pelvis_tilt: float
    trunk_lean: float
    sway: float
    shoulder: tuple[float, float]
    elbow: tuple[float, float]
    shoulder_abduction: float
    shoulder_rotation: float


WALKING = GaitCurves(
    hip=cyclic(
        (0, 21.4), (7, 22.2), (20, 9.6), (30, -1.4), (40, -11.2), (51, -18.8), (60, -10.2),
        (66, 0.8), (73, 16.1), (79, 25.1), (85, 25.0), (93, 23.0),
    ),
    knee=cyclic(
        (0, 4.0), (5, 14.0), (10, 18.6), (14, 19.1), (20, 15.0), (30, 9.9), (39, 8.0), (45, 7.4),
        (50, 11.7), (55, 22.1), (60, 36.3), (65, 56.2), (70.5, 62.0), (77, 55.1), (84, 35.1),
        (90, 16.2), (96, 5.3),
    ),
    ankle=cyclic(
        (0, 1.9), (6, -5.4), (11, -0.8), (15, 0.7), (20, 4.2), (30, 6.0), (40, 9.7), (44, 10.3),
        (50, 8.1), (55, 2.0), (60, -17.2), (64, -20.0), (68, -15.9), (73, -8.2), (80, 0.5),
        (86, 1.5), (93, 0.7),
    ),
    toe_off=0.60,
    flat=(0.10, 0.36),
    pelvis_list=4.0,
    pelvis_rotation=5.0,
    thorax_rotation=4.0,
    pelvis_tilt=0.0,
    trunk_lean=2.0,
    sway=1.2,
    shoulder=(-8.0, 16.0),
    elbow=(27.0, 13.0),
    shoulder_abduction=9.0,
    shoulder_rotation=12.0,
)  # fmt: skip
"""Walking at natural cadence. Arm swing [P10], elbow [M67], the rest [P10], [W09]."""

RUNNING = GaitCurves(
    hip=cyclic(
        (0, 26.1), (8, 25.8), (16, 17.4), (24, 4.0), (32, -10.8), (40, -19.1), (44, -22.0),
        (51, -11.9), (60, 8.0), (70, 27.0), (79, 35.9), (86, 38.0), (93, 34.6),
    ),
    knee=cyclic(
        (0, 14.9), (6, 30.2), (12, 43.5), (17, 45.0), (23, 42.6), (30, 32.1), (37, 24.9),
        (42, 28.3), (50, 53.2), (58, 79.0), (65, 90.0), (72, 85.0), (80, 61.0), (88, 30.9),
        (94, 16.3),
    ),
    ankle=cyclic(
        (0, 4.9), (4, 3.4), (10, 12.9), (18, 23.1), (24, 24.6), (30, 13.4), (36, -10.2),
        (41, -20.1), (46, -16.6), (55, -5.0), (65, 3.0), (80, 5.0), (90, 5.0),
    ),
    toe_off=0.39,
    flat=(0.06, 0.17),
    pelvis_list=5.0,
    pelvis_rotation=6.0,
    thorax_rotation=9.0,
    pelvis_tilt=4.0,
    trunk_lean=6.0,
    sway=0.6,
    shoulder=(-14.0, 27.0),
    elbow=(92.0, 12.0),
    shoulder_abduction=14.0,
    shoulder_rotation=28.0,
)  # fmt: skip
"""Running at about 3 m/s. Legs [N98]; amplitudes of trunk and arms are plausible, not published."""

STEPPING = GaitCurves(
    hip=cyclic((0, 4), (8, 2), (58, 2), (66, 6), (80, 27), (92, 12)),
    knee=cyclic((0, 7), (8, 5), (58, 5), (66, 15), (80, 52), (92, 20)),
    ankle=cyclic((0, 1), (8, 3), (58, 3), (66, -4), (80, -4), (92, -2)),
    toe_off=0.62,
    flat=(0.0, 0.60),
    pelvis_list=2.5,
    pelvis_rotation=1.5,
    thorax_rotation=1.5,
    pelvis_tilt=0.0,
    trunk_lean=2.0,
    sway=2.0,
    shoulder=(-2.0, 5.0),
    elbow=(24.0, 5.0),
    shoulder_abduction=11.0,
    shoulder_rotation=12.0,
)
"""Stepping on the spot while turning. Plausible amplitudes, not published."""
