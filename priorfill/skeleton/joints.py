"""A skeleton, its motion, and forward kinematics: from joint angles to places in the world."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

__all__ = ["Motion", "Placed", "Skeleton", "euler", "forward"]

_AXES = "XYZ"


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Joints, each with the bone that begins in it.

    In the rest pose no joint is turned, so the frame of every bone has the axes of the world.

    Attributes
    ----------
    names : tuple of str
        The joints' names, a parent before its children; the first is the root.
    parents : tuple of int
        The number of each joint's parent; -1 for the root.
    offsets : ndarray [shape=(joints, 3), file units]
        From the parent to the joint, in the rest pose; 0 for the root.
    ends : ndarray [shape=(joints, 3), file units]
        From the joint to the end of its bone, in the rest pose.
    mm_per_unit : float or None
        Millimetres in a unit of length, where the file says it.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: NDArray[np.float64]
    ends: NDArray[np.float64]
    mm_per_unit: float | None = None

    def rest(self) -> NDArray[np.float64]:
        """Return where the joints are in the rest pose, from the root [shape=(joints, 3)]."""
        places = self.offsets.copy()
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                places[joint] += places[parent]
        return places


@dataclass(frozen=True, eq=False)
class Motion:
    """A skeleton's motion.

    Attributes
    ----------
    skeleton : Skeleton
        Whose.
    root : ndarray [shape=(frames, 3), file units]
        Where the root is.
    turns : dict of int to ndarray [shape=(frames, 3, 3)]
        How joints are turned from the rest pose, in their parent's frame; joints that are not
        named keep their parent's.
    moves : dict of int to ndarray [shape=(frames, 3), file units]
        What is in the place of the offset of joints that slide, too.
    rate : float or None
        Frames per second (Hz); None where the file does not say.
    """

    skeleton: Skeleton
    root: NDArray[np.float64]
    turns: dict[int, NDArray[np.float64]]
    moves: dict[int, NDArray[np.float64]] = field(default_factory=dict)
    rate: float | None = None


@dataclass(frozen=True, eq=False)
class Placed:
    """Where a skeleton's joints are in the world.

    Attributes
    ----------
    places : ndarray [shape=(frames, joints, 3), file units]
        The joints.
    rotations : ndarray [shape=(frames, joints, 3, 3)]
        From the frame of each joint's bone to the world.
    """

    places: NDArray[np.float64]
    rotations: NDArray[np.float64]


def euler(order: str, angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rotations by angles about axes that turn with what is turned.

    Parameters
    ----------
    order : str
        Axes, such as ``"ZXY"``: the rotation is the product of matrices in this order.
    angles : ndarray [shape=(..., axes), rad]
        One angle for each axis.

    Returns
    -------
    ndarray [shape=(..., 3, 3)]
        The identity where there is no axis.
    """
    turned = np.broadcast_to(np.eye(3), (*angles.shape[:-1], 3, 3))
    for column, axis in enumerate(order):
        turned = turned @ _about(_AXES.index(axis), angles[..., column])
    return turned


def _about(axis: int, angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rotations about one axis."""
    one, other = (axis + 1) % 3, (axis + 2) % 3
    turned = np.zeros((*angle.shape, 3, 3))
    turned[..., axis, axis] = 1.0
    turned[..., one, one] = turned[..., other, other] = np.cos(angle)
    turned[..., other, one] = np.sin(angle)
    turned[..., one, other] = -turned[..., other, one]
    return turned


def forward(motion: Motion) -> Placed:
    """Compute where the joints are.

    A joint is where its parent's bone frame takes its offset, and its own frame is the parent's,
    turned by its own turn.

    Parameters
    ----------
    motion : Motion
        The skeleton and its joint angles.
    """
    skeleton, frames = motion.skeleton, len(motion.root)
    places = np.empty((frames, len(skeleton.names), 3))
    rotations = np.empty((*places.shape, 3))
    for joint, parent in enumerate(skeleton.parents):
        if parent < 0:
            places[:, joint] = motion.root
            above = np.broadcast_to(np.eye(3), (frames, 3, 3))
        else:
            above = rotations[:, parent]
            offset = motion.moves.get(joint, skeleton.offsets[joint])
            places[:, joint] = places[:, parent] + np.einsum("...ij,...j->...i", above, offset)
        turn = motion.turns.get(joint)
        rotations[:, joint] = above if turn is None else above @ turn
    return Placed(places, rotations)
