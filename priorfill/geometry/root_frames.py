"""Root frames: the position and orientation removed from poses before they are compared.

A root frame is estimated from a group of rigidly connected markers (pelvis, thorax, head, or
markers near a gap) by aligning them with a template of that group. There are two kinds: *heading*
frames remove the position and the rotation about the vertical only, so that a lying body remains
lying; *rigid* frames remove the complete rotation, which suits markers that turn together with the
group. [B11]_ removes "position and orientation" without saying which.

All coordinates are upright, in mm.

References
----------
.. [B11] Baumann, Krüger, Zinke and Weber, Data-driven completion of motion capture data,
   VRIPHYS 2011, section 4.1.
.. [K76] Kabsch, A solution for the best rotation to relate two sets of vectors, Acta
   Crystallographica A32, 1976.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "RootFrames",
    "RootGroup",
    "about_vertical",
    "heading_frames",
    "rigid_frames",
    "root_group",
]


@dataclass(frozen=True, eq=False)
class RootFrames:
    """Root frames of some poses.

    Attributes
    ----------
    origin : ndarray [shape=(frames, 3), mm]
        The root's position.
    rotation : ndarray [shape=(frames, 3, 3)]
        Orthonormal; ``local = (world - origin) @ rotation``.
    """

    origin: NDArray[np.float64]
    rotation: NDArray[np.float64]

    def to_local(self, positions: NDArray[np.floating]) -> NDArray[np.float64]:
        """Transform world positions [shape=(frames, markers, 3), mm] into the root frames."""
        from priorfill.geometry.alignment_kernels import to_local  # numba is slow to import

        points = np.ascontiguousarray(positions, dtype=np.float64)
        local = np.empty(points.shape)
        origin, rotation = np.ascontiguousarray(self.origin), np.ascontiguousarray(self.rotation)
        to_local(points, origin, rotation, local)
        return local

    def to_world(self, positions: NDArray[np.floating]) -> NDArray[np.float64]:
        """Transform positions from the root frames into the world [shape as given, mm]."""
        turned: NDArray[np.float64] = positions @ np.swapaxes(self.rotation, 1, 2)
        return turned + self.origin[:, None, :]


@dataclass(frozen=True, eq=False)
class RootGroup:
    """Markers that define a root frame, and the template they are aligned with.

    Attributes
    ----------
    markers : tuple of int
        Indices of the group's markers.
    template : ndarray [shape=(markers of the group, 3), mm]
        Their positions in a pose of heading 0.
    """

    markers: tuple[int, ...]
    template: NDArray[np.float64]

    def frames(self, positions: NDArray[np.floating]) -> RootFrames:
        """Return the heading frames of poses [shape=(frames, all markers, 3), mm]."""
        points = np.asarray(positions[:, list(self.markers)], dtype=np.float64)
        return heading_frames(points, self.template)

    def among(self, markers: NDArray[np.intp]) -> RootGroup:
        """Return the group for poses with a subset of markers, ascending, that contains its own."""
        columns = np.searchsorted(markers, self.markers)
        return RootGroup(tuple(int(c) for c in columns), self.template)


def _moments(
    points: NDArray[np.float64],
    template: NDArray[np.float64],
    weights: NDArray[np.float64] | None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the weighted centroids of poses, and their covariances with a template.

    Returns
    -------
    origin : ndarray [shape=(frames, 3), mm]
    covariance : ndarray [shape=(frames, 3, 3), mm²]
        Sums of products of a coordinate of the pose (row) and one of the template (column).
    """
    from priorfill.geometry.alignment_kernels import centroids_and_covariances

    if weights is None:
        weights = np.ones(len(template))
    share = weights / weights.sum()
    shape = np.ascontiguousarray(template - share @ template)
    both = np.empty((len(points), 4, 3))
    given = np.ascontiguousarray(points, dtype=np.float64)
    centroids_and_covariances(given, shape, np.ascontiguousarray(weights), share, both)
    return both[:, 0].copy(), both[:, 1:].copy()


def about_vertical(cosine: NDArray[np.float64], sine: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotations of root frames with given headings.

    Parameters
    ----------
    cosine, sine : ndarray [shape=(frames,)]
        Of the headings, up to a common factor above 0; heading 0 where both are 0.

    Returns
    -------
    ndarray [shape=(frames, 3, 3)]
        ``world = local @ rotation.T``.
    """
    size = np.sqrt(cosine**2 + sine**2)
    turned = size != 0.0
    size = np.where(turned, size, 1.0)
    rotation = np.zeros((len(size), 3, 3))
    rotation[:, 0, 0] = rotation[:, 1, 1] = np.where(turned, cosine, 1.0) / size
    rotation[:, 1, 0] = sine / size
    rotation[:, 0, 1] = -sine / size
    rotation[:, 2, 2] = 1.0
    return rotation


def heading_frames(
    points: NDArray[np.float64],
    template: NDArray[np.float64],
    weights: NDArray[np.float64] | None = None,
) -> RootFrames:
    """Estimate root frames by position and heading.

    The heading is the rotation about the vertical that best aligns the group's horizontal
    coordinates with the template's, in closed form.

    Parameters
    ----------
    points : ndarray [shape=(frames, group, 3), mm]
        Upright positions of the group's markers, none missing.
    template : ndarray [shape=(group, 3), mm]
        Their positions at heading 0.
    weights : ndarray [shape=(group,)], optional
        Weight of each marker; equal by default.

    Returns
    -------
    RootFrames
        The origin is the weighted centroid.

    See Also
    --------
    rigid_frames : Root frames with the complete rotation.

    Examples
    --------
    >>> template = np.array([[-100.0, 0.0, 0.0], [100.0, 0.0, 0.0]])
    >>> points = np.array([[[0.0, -100.0, 900.0], [0.0, 100.0, 900.0]]])  # turned by 90 degrees
    >>> frames = heading_frames(points, template)
    >>> frames.origin
    array([[  0.,   0., 900.]])
    >>> np.round(frames.to_local(points), 6) + 0.0
    array([[[-100.,    0.,    0.],
            [ 100.,    0.,    0.]]])
    """
    origin, covariance = _moments(points, template, weights)
    sine = covariance[:, 1, 0] - covariance[:, 0, 1]
    cosine = covariance[:, 0, 0] + covariance[:, 1, 1]
    return RootFrames(origin, about_vertical(cosine, sine))


def rigid_frames(
    points: NDArray[np.float64],
    template: NDArray[np.float64],
    weights: NDArray[np.float64] | None = None,
) -> RootFrames:
    """Estimate root frames by position and complete rotation, by weighted Kabsch [K76]_.

    Parameters, return value and conventions are those of `heading_frames`. Reflections are
    excluded. Fewer than three markers, or markers on a line, do not determine the rotation; it is
    then arbitrary about that line.
    """
    # slow to import; LAPACK's singular vectors differ between its builds in the last bits
    from priorfill.geometry.rotation_kernels import nearest_rotations

    origin, covariance = _moments(points, template, weights)
    rotation = np.empty(covariance.shape)
    nearest_rotations(covariance, rotation)
    return RootFrames(origin, rotation)


def root_group(positions: NDArray[np.float64], markers: Sequence[int]) -> RootGroup | None:
    """Return a root group with a template from the poses in which all its markers are valid.

    Parameters
    ----------
    positions : ndarray [shape=(frames, all markers, 3), mm]
        Upright positions of a clip.
    markers : sequence of int
        The group's markers.

    Returns
    -------
    RootGroup or None
        None if no pose has all markers. The template is the mean of the poses after each was
        turned to the heading of the first; heading 0 is therefore arbitrary.

    See Also
    --------
    heading_frames : Aligns poses with the template.
    priorfill.markers.root_choice.choose_root : Chooses the markers.
    """
    points = positions[:, list(markers)]
    points = points[~np.isnan(points[..., 0]).any(axis=1)]
    if len(points) == 0:
        return None
    template = points[0] - points[0].mean(axis=0)
    turned = heading_frames(points, template).to_local(points)
    return RootGroup(tuple(int(m) for m in markers), turned.mean(axis=0))
