"""Synthetic recordings from a motion, a body, and noise."""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import CubicSpline

from priorfill.clip import Clip
from priorfill.errors import OptionError
from priorfill.synthetic.grounding import ground
from priorfill.synthetic.kinematics import Segments, marker_positions, rot_z
from priorfill.synthetic.motions import compose
from priorfill.synthetic.noise import soft_tissue
from priorfill.synthetic.synthetic_body import LABELS, Body
from priorfill.synthetic.synthetic_options import Noise, Style

__all__ = ["simulate", "synthesise"]

INNER_RATE = 240.0
"""Hz. Rate of the simulation, from which clips are sampled, so that a seed gives the same motion at
every rate."""

MARGIN = 1.0
"""s. Time simulated before and after the clip, so that it has no edge effects of filters."""


def simulate(
    motion: str, *, seconds: float, body: Body, style: Style, seed: int = 0
) -> tuple[Segments, slice]:
    """Return the moving segments of a synthetic body, at `INNER_RATE`.

    Parameters
    ----------
    motion : str
        One of `MOTIONS`.
    seconds : float
        Length of the clip (s).
    body : Body
        The subject.
    style : Style
        How the subject moves.
    seed : int
        Seed of the random variation.

    Returns
    -------
    segments : dict
        The segments, with `MARGIN` before and after the clip.
    inside : slice
        The frames of the clip itself.
    """
    margin = round(MARGIN * INNER_RATE)
    # two extra frames, so that samples at any rate are inside
    frames = math.ceil(seconds * INNER_RATE) + 2 * margin + 2
    time = np.arange(frames) / INNER_RATE
    skeleton = body.skeleton()
    rng = np.random.default_rng([seed, 1])
    joints = compose(motion, time, INNER_RATE, skeleton, style, rng)
    return ground(joints, skeleton, INNER_RATE), slice(margin, frames - margin)


def synthesise(
    motion: str,
    *,
    seconds: float,
    rate: float = 120.0,
    body: Body | None = None,
    style: Style | None = None,
    noise: Noise | None = None,
    seed: int = 0,
) -> Clip:
    """Return a synthetic recording of 41 markers.

    Parameters
    ----------
    motion : str
        One of `MOTIONS`.
    seconds : float
        Length (s).
    rate : float
        Frames per second (Hz).
    body : Body or None
        The subject; None for the published mean proportions.
    style : Style or None
        How the subject moves; None for the published mean movements.
    noise : Noise or None
        Soft-tissue artefacts and measurement noise; None for typical amplitudes.
    seed : int
        Seed of the random variation; the same arguments and seed give the same clip.

    Returns
    -------
    clip : Clip
        Without gaps, in mm, with +Z up and the floor at z = 0. Its name starts with ``synthetic_``,
        that of its subject with ``synthetic-``.

    Raises
    ------
    OptionError
        For an unknown motion, a length or rate that is not positive, a negative seed, or a
        speed outside the range of the motion.

    See Also
    --------
    priorfill.synthetic.demo.make_demo_clip : A synthetic recording with gaps.

    Examples
    --------
    >>> synthesise("walking", seconds=1.0, rate=60.0).positions.shape
    (60, 41, 3)
    """
    if not (math.isfinite(seconds) and seconds > 0):
        raise OptionError(f"the length is {seconds:g} s; give a positive number of seconds")
    if not (math.isfinite(rate) and rate > 0):
        raise OptionError(f"the frame rate is {rate:g} Hz; give a positive one")
    if seed < 0:
        raise OptionError(f"the seed is {seed}; give 0 or a positive whole number")
    body, style, noise = body or Body(), style or Style(), noise or Noise()
    segments, inside = simulate(motion, seconds=seconds, body=body, style=style, seed=seed)

    rng = np.random.default_rng([seed, 2])
    displacement = noise.soft_tissue * soft_tissue(
        segments, INNER_RATE, np.random.default_rng([body.seed, 43]), rng
    )
    inner = marker_positions(segments, body.skeleton(), displacement)[inside]
    # a random position in the room, and a random heading
    centre = segments["pelvis"][0][inside].mean(axis=0) * [1.0, 1.0, 0.0]
    away = rot_z(np.array([rng.uniform(0.0, 360.0)]))[0]
    inner = (inner - centre) @ away.T

    frames = max(1, round(seconds * rate))
    sample = CubicSpline(np.arange(len(inner)) / INNER_RATE, inner, axis=0)
    positions = sample(np.arange(frames) / rate)
    positions += noise.measurement * rng.standard_normal(positions.shape)
    return Clip(
        positions,
        LABELS,
        rate,
        name=f"synthetic_{motion}_{seed:03d}",
        subject=f"synthetic-{body.seed}",
    )
