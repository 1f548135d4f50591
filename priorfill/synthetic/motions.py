"""The motions by name, their random variation, and sequences of several motions."""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from priorfill.errors import OptionError
from priorfill.synthetic import gait, tasks
from priorfill.synthetic.kinematics import CHANNELS, JointTrajectories
from priorfill.synthetic.noise import smooth_noise
from priorfill.synthetic.synthetic_body import SyntheticSkeleton
from priorfill.synthetic.synthetic_options import Style

__all__ = ["MOTIONS", "SEQUENCE", "compose"]

Array = NDArray[np.float64]
Maker = Callable[[Array, float, SyntheticSkeleton, Style, np.random.Generator], JointTrajectories]

_MAKERS: MappingProxyType[str, Maker] = MappingProxyType(
    {
        "walking": gait.walking,
        "running": gait.running,
        "turning": gait.turning,
        "pivoting": gait.pivoting,
        "reaching": tasks.reaching,
        "squatting": tasks.squatting,
    }
)

SEQUENCE = ("walking", "reaching", "turning", "squatting", "pivoting", "reaching")
"""The sequence of the motion ``mixed``, which is repeated."""

MOTIONS: tuple[str, ...] = (*_MAKERS, "mixed")
"""The motions that can be synthesised: walking and running straight on, turning (walking
along a curve), pivoting (turning on the spot), reaching and squatting on the spot, and
mixed (`SEQUENCE`)."""

PART_SECONDS = 3.0
"""s. Duration of each part of a sequence."""

BLEND_SECONDS = 0.3
"""s. Standard deviation scale of the Gaussian that blends consecutive parts."""

MIN_SWING_SHARE = 0.2
"""Share of a gait in a blend at which its swing feet are off the floor."""

ANGLE_SD = MappingProxyType({"hip": 0.5, "knee": 0.8, "ankle": 0.6, "foot": 0.5, "pelvis": 0.5})
"""Standard deviation (degrees) of the random variation, by joint."""

OTHER_SD = 1.4
"""The same for the trunk, the head and the arms."""

_LIMB_JOINTS = (
    "hip", "knee", "ankle", "foot", "clavicle", "shoulder", "elbow", "forearm", "wrist",
)  # fmt: skip

VARIATION_HZ, DRIFT_HZ = 0.5, 0.06
"""Hz. Bandwidths of the variation between cycles, and of the slow drift."""


def _vary(
    joints: JointTrajectories, rate: float, style: Style, rng: np.random.Generator
) -> JointTrajectories:
    """Return joint trajectories with asymmetry, drift and variability."""
    frames = len(joints.angles)
    size = np.array(
        [ANGLE_SD.get(c.removeprefix(_side(c)).split("_")[0], OTHER_SD) for c in CHANNELS]
    )
    side = np.array([{"l": 1.0, "r": -1.0}.get(_side(c), 0.0) for c in CHANNELS])
    noise = smooth_noise(joints.angles.shape, VARIATION_HZ, rate, rng)
    drift = style.drift * smooth_noise((frames, 1), DRIFT_HZ, rate, rng)
    middle = joints.angles.mean(axis=0)
    factor = (1.0 + 0.5 * style.asymmetry * side) * (1.0 + np.clip(drift, -0.2, 0.2))
    angles = middle + factor * (joints.angles - middle) + style.variability * size * noise
    return JointTrajectories(angles, joints.contact, joints.flat, joints.turn)


def _side(channel: str) -> str:
    """Return the side of a joint angle: ``l``, ``r``, or an empty string."""
    return channel[0] if channel[1:].startswith(_LIMB_JOINTS) else ""


def compose(
    motion: str,
    time: Array,
    rate: float,
    skeleton: SyntheticSkeleton,
    style: Style,
    rng: np.random.Generator,
) -> JointTrajectories:
    """Return the joint trajectories of a motion.

    Parameters
    ----------
    motion : str
        One of `MOTIONS`.
    time : ndarray [shape=(frames,), s]
        Time, evenly spaced.
    rate : float
        Frames per second (Hz).
    skeleton : SyntheticSkeleton
        The body.
    style : Style
        How the subject moves.
    rng : Generator
        Source of the random variation.

    Raises
    ------
    OptionError
        For an unknown motion, or a speed outside its range.
    """
    if motion not in MOTIONS:
        raise OptionError(f"motion {motion!r} is unknown; use one of {', '.join(MOTIONS)}")
    if motion != "mixed":
        return _vary(_MAKERS[motion](time, rate, skeleton, style, rng), rate, style, rng)
    part = ((time - time[0]) // PART_SECONDS).astype(np.intp)
    by_motion = {
        name: _MAKERS[name](time, rate, skeleton, style, rng) for name in dict.fromkeys(SEQUENCE)
    }
    mixed = JointTrajectories.standing(len(time))
    mixed.flat[:] = 0.0
    for name, joints in by_motion.items():
        active = np.isin(part % len(SEQUENCE), [i for i, n in enumerate(SEQUENCE) if n == name])
        share = gaussian_filter1d(
            active.astype(np.float64), BLEND_SECONDS * rate / 2.0, mode="nearest"
        )
        mixed.angles[:] += share[:, None] * joints.angles
        # a foot is either off the floor or not: it swings above a small share of its gait
        mixed.contact[:] -= np.minimum(share / MIN_SWING_SHARE, 1.0)[:, None] * (
            1.0 - joints.contact
        )
        mixed.flat[:] += share[:, None] * joints.flat
        mixed.turn[:] += share * joints.turn
    np.clip(mixed.contact, 0.0, 1.0, out=mixed.contact)
    return _vary(mixed, rate, style, rng)
