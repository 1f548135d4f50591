"""The motions by name, what varies in all of them, and sequences of several."""

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
"""What follows what in the motion ``mixed``, over and over."""

MOTIONS: tuple[str, ...] = (*_MAKERS, "mixed")
"""The motions that can be synthesised: walking and running straight on, turning (walking
along a curve), pivoting (turning on the spot), reaching and squatting on the spot, and
mixed (`SEQUENCE`)."""

PART = 3.0
"""Length (s) of a part of a sequence."""

BLEND = 0.3
"""Scale (s) of the Gaussian with which one part passes into the next."""

HEARD = 0.2
"""Share in a blend from which on a gait lifts its feet."""

ANGLE_SD = MappingProxyType({"hip": 0.5, "knee": 0.8, "ankle": 0.6, "foot": 0.5, "pelvis": 0.5})
"""Standard deviation (degrees) of what is never twice the same, by the joint; else below."""

OTHER_SD = 1.4
"""The same for trunk, head and arms."""

_LIMB_JOINTS = (
    "hip", "knee", "ankle", "foot", "clavicle", "shoulder", "elbow", "forearm", "wrist",
)  # fmt: skip

VARIATION_HZ, DRIFT_HZ = 0.5, 0.06
"""Bandwidths (Hz) of the variation from cycle to cycle, and of the slow drift."""


def _vary(
    score: JointTrajectories, rate: float, style: Style, rng: np.random.Generator
) -> JointTrajectories:
    """Return a score with asymmetry, drift and variability."""
    frames = len(score.angles)
    size = np.array(
        [ANGLE_SD.get(c.removeprefix(_side(c)).split("_")[0], OTHER_SD) for c in CHANNELS]
    )
    side = np.array([{"l": 1.0, "r": -1.0}.get(_side(c), 0.0) for c in CHANNELS])
    noise = smooth_noise(score.angles.shape, VARIATION_HZ, rate, rng)
    drift = style.drift * smooth_noise((frames, 1), DRIFT_HZ, rate, rng)
    middle = score.angles.mean(axis=0)
    factor = (1.0 + 0.5 * style.asymmetry * side) * (1.0 + np.clip(drift, -0.2, 0.2))
    angles = middle + factor * (score.angles - middle) + style.variability * size * noise
    return JointTrajectories(angles, score.contact, score.flat, score.turn)


def _side(channel: str) -> str:
    """Return the side of a joint angle: l, r, or nothing."""
    return channel[0] if channel[1:].startswith(_LIMB_JOINTS) else ""


def compose(
    motion: str,
    time: Array,
    rate: float,
    skeleton: SyntheticSkeleton,
    style: Style,
    rng: np.random.Generator,
) -> JointTrajectories:
    """Return the score of a motion.

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
        The manner.
    rng : Generator
        Source of all that is random.

    Raises
    ------
    OptionError
        For an unknown motion, or a speed that is not for it.
    """
    if motion not in MOTIONS:
        raise OptionError(f"motion {motion!r} is unknown; use one of {', '.join(MOTIONS)}")
    if motion != "mixed":
        return _vary(_MAKERS[motion](time, rate, skeleton, style, rng), rate, style, rng)
    part = ((time - time[0]) // PART).astype(np.intp)
    scores = {
        name: _MAKERS[name](time, rate, skeleton, style, rng) for name in dict.fromkeys(SEQUENCE)
    }
    mixed = JointTrajectories.standing(len(time))
    mixed.flat[:] = 0.0
    for name, score in scores.items():
        playing = np.isin(part % len(SEQUENCE), [i for i, n in enumerate(SEQUENCE) if n == name])
        share = gaussian_filter1d(playing.astype(np.float64), BLEND * rate / 2.0, mode="nearest")
        mixed.angles[:] += share[:, None] * score.angles
        # steps are made in full or not: a foot swings as soon as its gait is heard at all
        mixed.contact[:] -= np.minimum(share / HEARD, 1.0)[:, None] * (1.0 - score.contact)
        mixed.flat[:] += share[:, None] * score.flat
        mixed.turn[:] += share * score.turn
    np.clip(mixed.contact, 0.0, 1.0, out=mixed.contact)
    return _vary(mixed, rate, style, rng)
