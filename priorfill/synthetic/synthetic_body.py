"""The synthetic body: lengths of its segments, and positions of the 41 markers on them.

Lengths are fractions of the body height by Drillis and Contini (*Body segment parameters*,
New York University, 1966) as shown in Winter, *Biomechanics and Motor Control of Human
Movement*, 4th ed. 2009, figure 4.1. Hip joint centres are placed from the anterior iliac
spines by Bell, Brand and Pedersen (Human Movement Science 8, 1989: 30 % of their distance
below, 14 % medial, 22 % behind). Markers are placed by their anatomical description (front
and back of the head band, seventh cervical vertebra, acromion, lateral epicondyle, ...);
none of the figures is taken from a recording.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.synthetic.synthetic_options import check_range

__all__ = ["LABELS", "MARKER_SEGMENTS", "SIDES", "Body", "SyntheticSkeleton"]

SIDES = ("l", "r")
"""Prefixes of the segments and joint angles of the left and the right limbs."""

REFERENCE_HEIGHT = 1750.0
"""Body height (mm) of the offsets below."""

# Fractions of the body height, Winter 2009 figure 4.1.
HIP_HEIGHT = 0.530
KNEE_HEIGHT = 0.285
ANKLE_HEIGHT = 0.039
SHOULDER_HEIGHT = 0.818
UPPER_ARM = 0.186
FOREARM = 0.146

HIP_HALF_WIDTH = 0.0505
"""Half the distance of the hip joint centres: 0.36 of an iliac spine distance of 0.14 H."""

SHOULDER_HALF_WIDTH = 0.105
"""Half the distance of the shoulder joint centres. The figure's 0.129 H extends to the deltoid."""

LUMBAR_HEIGHT = 0.615
"""Height of the joint between trunk and pelvis: the third lumbar vertebra."""

LUMBAR_BACK = 0.014
"""Distance of the spine behind the hip joints."""

NECK_HEIGHT = 0.861
"""Height of the joint between head and trunk: just above the seventh cervical vertebra."""

# (segment, label, x forwards, y left, z up) in mm at REFERENCE_HEIGHT, from the segment's
# proximal joint, in the upright pose. Tracking markers of upper arms, thighs and shanks sit
# at different heights left and right, as is common practice to distinguish the sides.
_PLACEMENT: tuple[tuple[str, str, float, float, float], ...] = (
    ("head", "LFHD", 97.0, 76.0, 160.0),
    ("head", "RFHD", 97.0, -76.0, 160.0),
    ("head", "LBHD", -28.0, 60.0, 96.0),
    ("head", "RBHD", -28.0, -60.0, 96.0),
    ("thorax", "C7", -48.0, 0.0, 404.0),
    ("thorax", "T10", -96.0, 0.0, 195.0),
    ("thorax", "CLAV", 84.0, 0.0, 337.0),
    ("thorax", "STRN", 116.0, 0.0, 185.0),
    ("thorax", "RBAC", -98.0, -92.0, 318.0),
    ("lclavicle", "LSHO", -4.0, 152.0, 52.0),
    ("lupperarm", "LUPA", 0.0, 48.0, -178.0),
    ("lupperarm", "LELB", -8.0, 46.0, -314.0),
    ("lforearm", "LFRM", 6.0, 43.0, -135.0),
    ("lforearm", "LWRA", 66.0, 10.0, -252.0),
    ("lforearm", "LWRB", -66.0, 10.0, -252.0),
    ("lhand", "LFIN", 12.0, 22.0, -88.0),
    ("rclavicle", "RSHO", -4.0, -152.0, 52.0),
    ("rupperarm", "RUPA", 4.0, -48.0, -132.0),
    ("rupperarm", "RELB", -8.0, -46.0, -314.0),
    ("rforearm", "RFRM", 6.0, -43.0, -95.0),
    ("rforearm", "RWRA", 66.0, -10.0, -252.0),
    ("rforearm", "RWRB", -66.0, -10.0, -252.0),
    ("rhand", "RFIN", 12.0, -22.0, -88.0),
    ("pelvis", "LFWT", 78.0, 126.0, 72.0),
    ("pelvis", "RFWT", 78.0, -126.0, 72.0),
    ("pelvis", "LBWT", -106.0, 55.0, 74.0),
    ("pelvis", "RBWT", -106.0, -55.0, 74.0),
    ("lthigh", "LTHI", 12.0, 88.0, -290.0),
    ("lthigh", "LKNE", 0.0, 58.0, -426.0),
    ("lshank", "LSHN", 16.0, 58.0, -215.0),
    ("lshank", "LANK", -4.0, 46.0, -424.0),
    ("lfoot", "LHEE", -72.0, 2.0, -22.0),
    ("lfoot", "LTOE", 153.0, 4.0, -24.0),
    ("lfoot", "LMT5", 106.0, 64.0, -44.0),
    ("rthigh", "RTHI", 12.0, -92.0, -215.0),
    ("rthigh", "RKNE", 0.0, -58.0, -426.0),
    ("rshank", "RSHN", 16.0, -60.0, -150.0),
    ("rshank", "RANK", -4.0, -46.0, -424.0),
    ("rfoot", "RHEE", -72.0, -2.0, -22.0),
    ("rfoot", "RTOE", 153.0, -4.0, -24.0),
    ("rfoot", "RMT5", 106.0, -64.0, -44.0),
)

LABELS: tuple[str, ...] = tuple(row[1] for row in _PLACEMENT)
"""The 41 markers, in the order of a synthetic clip."""

MARKER_SEGMENTS: tuple[str, ...] = tuple(row[0] for row in _PLACEMENT)
"""The segment of each marker in `LABELS`."""

_CLAVICLE = np.array([20.0, 22.0, -12.0])
"""The sternoclavicular joint from the level of the shoulders in the midline (mm)."""

# Where the sole touches the floor: under the heel and under the metatarsal heads. The toes
# carry no marker and bend away, so the foot ends there.
_HEEL = np.array([-48.0, 0.0])
_BALL = np.array([145.0, 0.0])


@dataclass(frozen=True)
class SyntheticSkeleton:
    """Joints and markers of a body, in the frames of its segments.

    Attributes
    ----------
    offsets : dict of str to ndarray [shape=(3,), mm]
        Proximal joint of each segment in its parent's frame.
    markers : ndarray [shape=(41, 3), mm]
        Each marker in its segment's frame.
    thigh, shank : float
        Lengths (mm).
    sole : ndarray [shape=(2, 3), mm]
        Heel and ball of the sole in the foot's frame.
    """

    offsets: dict[str, NDArray[np.float64]]
    markers: NDArray[np.float64]
    thigh: float
    shank: float
    sole: NDArray[np.float64]


@dataclass(frozen=True)
class Body:
    """A synthetic subject.

    Attributes
    ----------
    height : float
        Body height (mm).
    leg, trunk, arm, breadth : float
        Factors on the published proportions of legs, trunk, arms, and of all widths.
    placement_sd : float
        Standard deviation (mm, each axis) of the marker placement about the described positions.
    seed : int
        Seed of the placement, which is the same in all clips of a body.

    Raises
    ------
    OptionError
        Where a value is outside the range of adults.

    Examples
    --------
    >>> Body(height=1680.0).skeleton().markers.shape
    (41, 3)
    """

    height: float = REFERENCE_HEIGHT
    leg: float = 1.0
    trunk: float = 1.0
    arm: float = 1.0
    breadth: float = 1.0
    placement_sd: float = 5.0
    seed: int = 0

    def __post_init__(self) -> None:
        check_range("the body height (mm)", self.height, 1200.0, 2200.0)
        for name in ("leg", "trunk", "arm", "breadth"):
            check_range(f"the proportion of the {name}", getattr(self, name), 0.8, 1.25)
        check_range("the marker placement (mm)", self.placement_sd, 0.0, 20.0)

    @classmethod
    def random(cls, seed: int) -> Body:
        """Return a random body: height 1715 mm (sd 90 mm), proportions with an sd of 3 to 5 %."""
        rng = np.random.default_rng([seed, 41])
        factors = np.clip(rng.normal(0.0, 1.0, 5), -2.0, 2.0)
        return cls(
            height=float(1715.0 + 90.0 * factors[0]),
            leg=float(1.0 + 0.03 * factors[1]),
            trunk=float(1.0 + 0.03 * factors[2]),
            arm=float(1.0 + 0.03 * factors[3]),
            breadth=float(1.0 + 0.05 * factors[4]),
            seed=seed,
        )

    def skeleton(self) -> SyntheticSkeleton:
        """Return the joints and markers of this body."""
        height, widen = self.height, self.breadth
        scale = height / REFERENCE_HEIGHT
        thigh = (HIP_HEIGHT - KNEE_HEIGHT) * height * self.leg
        shank = (KNEE_HEIGHT - ANKLE_HEIGHT) * height * self.leg
        upper_arm = UPPER_ARM * height * self.arm
        forearm = FOREARM * height * self.arm
        to_shoulder = (SHOULDER_HEIGHT - LUMBAR_HEIGHT) * height * self.trunk
        offsets = {
            "thorax": np.array(
                [-LUMBAR_BACK * height, 0.0, (LUMBAR_HEIGHT - HIP_HEIGHT) * height * self.trunk]
            ),
            "head": np.array([-0.008 * height, 0.0, (NECK_HEIGHT - LUMBAR_HEIGHT) * height])
            * [1.0, 1.0, self.trunk],
        }
        for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
            joint = np.array([0.0, SHOULDER_HALF_WIDTH * height * widen * sign, to_shoulder])
            clavicle = _CLAVICLE * scale * [1.0, sign, 1.0] + [0.0, 0.0, to_shoulder]
            offsets |= {
                f"{side}clavicle": clavicle,
                f"{side}upperarm": joint - clavicle,
                f"{side}forearm": np.array([0.0, 0.0, -upper_arm]),
                f"{side}hand": np.array([0.0, 0.0, -forearm]),
                f"{side}thigh": np.array([0.0, sign * HIP_HALF_WIDTH * height * widen, 0.0]),
                f"{side}shank": np.array([0.0, 0.0, -thigh]),
                f"{side}foot": np.array([0.0, 0.0, -shank]),
            }
        lengthen = {"thorax": self.trunk, "thigh": self.leg, "shank": self.leg}
        lengthen |= {"upperarm": self.arm, "forearm": self.arm, "hand": self.arm}
        placed = np.array([row[2:] for row in _PLACEMENT]) * scale
        placed[:, 1] *= widen
        for row, segment in zip(placed, MARKER_SEGMENTS, strict=True):
            row[2] *= lengthen.get(segment, lengthen.get(segment[1:], 1.0))
        rng = np.random.default_rng([self.seed, 42])
        placed += self.placement_sd * np.clip(rng.normal(size=placed.shape), -2.5, 2.5)
        ankle = ANKLE_HEIGHT * height
        sole = np.array([[*_HEEL * scale, -ankle], [*_BALL * scale, -ankle]])
        return SyntheticSkeleton(offsets, placed, thigh, shank, sole)
