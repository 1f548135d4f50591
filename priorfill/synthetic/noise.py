"""Movements of markers relative to bones: soft-tissue artefacts and measurement noise.

Skin moves against the bone by some 10 to 30 mm on the thigh and up to 15 mm on the shank,
reproducibly with the joint's angle and more after impacts; less elsewhere (review: Leardini,
Chiari, Della Croce, Cappozzo, Gait and Posture 21, 2005). Three parts are added up in the
segment's frame: slow random drift, sliding with the angle of the joint that stretches the skin, and
a lag proportional to the acceleration of the segment. The amplitudes in `TISSUE` are within the
range of that review: they are plausible, not fitted.
"""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft, rfftfreq
from scipy.ndimage import gaussian_filter1d

from priorfill.synthetic.kinematics import Segments
from priorfill.synthetic.synthetic_body import MARKER_SEGMENTS

__all__ = ["TISSUE", "Tissue", "smooth_noise", "soft_tissue"]

Array = NDArray[np.float64]

WANDER_HZ = 1.2
"""Hz. Bandwidth of the slow drift."""

LAG_SMOOTHING = 0.02
"""s. Standard deviation of the Gaussian that smooths accelerations."""

LAG_LIMIT = 60.0
"""m/s². Acceleration at which the lag saturates."""


class Tissue(NamedTuple):
    """Amplitudes of the soft-tissue artefacts of a segment.

    Attributes
    ----------
    wander : float
        Standard deviation (mm, each axis) of the slow drift.
    slide : float
        Standard deviation over markers and axes of the sliding (mm per radian).
    lag : float
        Displacement per acceleration (mm per m/s²).
    joint : tuple of str
        The segments between which the angle is measured; ``*`` is replaced by the side.
    """

    wander: float
    slide: float
    lag: float
    joint: tuple[str, str]


TISSUE = MappingProxyType(
    {
        "head": Tissue(0.3, 0.3, 0.02, ("thorax", "head")),
        "thorax": Tissue(1.0, 3.0, 0.06, ("pelvis", "thorax")),
        "clavicle": Tissue(1.2, 4.0, 0.08, ("thorax", "*upperarm")),
        "upperarm": Tissue(1.4, 4.0, 0.10, ("*upperarm", "*forearm")),
        "forearm": Tissue(0.9, 2.0, 0.06, ("*upperarm", "*forearm")),
        "hand": Tissue(0.6, 1.0, 0.04, ("*forearm", "*hand")),
        "pelvis": Tissue(1.3, 3.0, 0.10, ("pelvis", "thorax")),
        "thigh": Tissue(2.5, 5.0, 0.22, ("*thigh", "*shank")),
        "shank": Tissue(1.5, 2.5, 0.12, ("*thigh", "*shank")),
        "foot": Tissue(0.5, 0.8, 0.03, ("*shank", "*foot")),
    }
)
"""Soft-tissue artefacts by segment."""


def smooth_noise(
    shape: tuple[int, ...], bandwidth: float, rate: float, rng: np.random.Generator
) -> Array:
    """Return low-pass Gaussian noise along the first axis, with variance 1.

    Parameters
    ----------
    shape : tuple of int
        Number of frames, and any further axes.
    bandwidth : float
        Frequency (Hz) at which the amplitude has fallen to 61 % (one standard deviation of
        the Gaussian transfer function).
    rate : float
        Frames per second (Hz).
    rng : Generator
        Source of the noise.
    """
    # longer by eight standard deviations, so that both ends are independent
    margin = math.ceil(8.0 * rate / (2.0 * np.pi * bandwidth))
    length = next_fast_len(shape[0] + margin, real=True)
    spectrum = rfft(rng.standard_normal((length, *shape[1:])), axis=0)
    transfer = np.exp(-0.5 * (rfftfreq(length, 1.0 / rate) / bandwidth) ** 2)
    # every frequency but zero represents two
    transfer /= np.sqrt((2.0 * (transfer**2).sum() - transfer[0] ** 2) / length)
    spectrum *= transfer.reshape(-1, *[1] * (len(shape) - 1))
    return np.asarray(irfft(spectrum, n=length, axis=0)[: shape[0]])


def soft_tissue(
    segments: Segments, rate: float, body_rng: np.random.Generator, rng: np.random.Generator
) -> Array:
    """Return the displacements of the markers relative to their segments.

    Parameters
    ----------
    segments : dict
        The segments of the moving body.
    rate : float
        Frames per second (Hz).
    body_rng : Generator
        Source of the directions of sliding, which are the same in all clips of a body.
    rng : Generator
        Source of the drift.

    Returns
    -------
    displacement : ndarray [shape=(frames, 41, 3), mm]
        In the frame of each marker's segment.
    """
    frames = len(segments["pelvis"][0])
    wander = smooth_noise((frames, len(MARKER_SEGMENTS), 3), WANDER_HZ, rate, rng)
    slide = body_rng.standard_normal((len(MARKER_SEGMENTS), 3))
    softness = body_rng.uniform(0.6, 1.4, len(MARKER_SEGMENTS))
    out = np.empty_like(wander)
    for segment in dict.fromkeys(MARKER_SEGMENTS):
        on = [i for i, name in enumerate(MARKER_SEGMENTS) if name == segment]
        side = "" if segment in TISSUE else segment[0]
        tissue = TISSUE[segment[len(side) :]]
        first, second = (segments[name.replace("*", side)][1] for name in tissue.joint)
        angle = np.arccos(np.clip(np.einsum("fi,fi->f", first[:, :, 2], second[:, :, 2]), -1, 1))
        origin, axes = segments[segment]
        acceleration = (
            np.gradient(np.gradient(origin, 1.0 / rate, axis=0), 1.0 / rate, axis=0) / 1000.0
        )
        smoothed = gaussian_filter1d(
            np.einsum("fji,fj->fi", axes, acceleration),
            LAG_SMOOTHING * rate,
            axis=0,
            mode="nearest",
        )
        smoothed = LAG_LIMIT * np.tanh(smoothed / LAG_LIMIT)
        out[:, on] = (
            tissue.wander * wander[:, on]
            + tissue.slide * angle[:, None, None] * slide[on]
            - tissue.lag * softness[on, None] * smoothed[:, None]
        )
    return out
