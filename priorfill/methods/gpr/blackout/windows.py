"""Windows: stretches of recordings as long as a blackout, and what their edges tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.mirror import reflected
from priorfill.geometry.poses import evenly_spaced
from priorfill.geometry.root_frames import RootGroup, about_vertical
from priorfill.methods.gpr.blackout.window_layout import EDGE_STEP, Stencil
from priorfill.methods.gpr.training.subject_correlation import MIRROR_KINSHIP

__all__ = ["FEWEST_WINDOWS", "OVERLAP", "Recording", "Windows", "contralateral_among", "gather"]

_Floats = NDArray[np.float64]

MOST_WINDOWS = 100
"""Windows of the clip, and of its mirror image, that are learnt from; more gain little."""

NEAREST = 0.5
"""Part of them whose edges are the most like the blackout's; the others are spread evenly."""

CANDIDATES = 600
"""Windows of the clip that they are chosen from."""

OVERLAP = 0.25
"""Windows follow each other by this part of their length."""

FEWEST_WINDOWS = 3
"""With fewer windows nothing is learnt from them."""

PAIRED = 0.5
"""Part of the markers that must have a partner for the mirror image to be of use."""

SECONDS_OF_SPEED = 0.15
"""s. A velocity counts in the regression as the distance covered in this time."""

SECONDS_OF_ACCELERATION = 0.1
"""s. An acceleration counts as the distance covered in half the square of this, times two."""


@dataclass(frozen=True, eq=False)
class Recording:
    """A recording whose stretches tell what came between.

    Attributes
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        Upright, at the clip's rate; NaN where not seen.
    kinship : float
        How far it agrees with the clip's body; 1 for its own.
    starts : ndarray of int, optional
        Where windows may start; everywhere by default.
    """

    positions: _Floats
    kinship: float = 1.0
    starts: NDArray[np.intp] | None = None


@dataclass(frozen=True, eq=False)
class Windows:
    """Stretches of recordings as long as the blackout; the first is the blackout itself.

    Attributes
    ----------
    beside : ndarray [shape=(windows, frames beside, markers, 3), mm]
    inside : ndarray [shape=(windows, frames inside, markers, 3), mm]
        NaN for the blackout.
    edges : ndarray [shape=(windows, features), mm]
        Poses, velocities and accelerations at the edges, in the window's root frame.
    rotation : ndarray [shape=(windows, 3, 3)]
        Of the root frames: ``local = world @ rotation``.
    start : ndarray of int
        First frame of each.
    source : ndarray of int
        Which recording each is of; 0 is the clip, 1 its mirror image.
    kinship : ndarray
        Of the recordings.
    """

    beside: _Floats
    inside: _Floats
    edges: _Floats
    rotation: _Floats
    start: NDArray[np.intp]
    source: NDArray[np.intp]
    kinship: _Floats


def gather(
    recordings: Sequence[Recording],
    markers: NDArray[np.intp],
    contralateral: NDArray[np.intp] | None,
    start: int,
    stencil: Stencil,
    root: RootGroup,
) -> Windows:
    """Gather the windows of recordings, the clip first, and of the blackout itself.

    Parameters
    ----------
    recordings : sequence of Recording
        The clip and others.
    markers : ndarray of int
        The columns that are looked at.
    partner : ndarray of int or None
        Each of these markers' partner on the other side of the body, among these.
    start : int
        First frame of the blackout in the first recording.
    stencil : Stencil
        Of the blackout.
    root : RootGroup
        Its markers count among these columns.
    """
    edges = stencil.edges()
    flat = np.array([frame for edge in edges for frame in edge], dtype=np.intp)
    counts = [len(edge) for edge in edges]
    layers = [stencil.beside, stencil.inside, flat]
    parts: list[list[_Floats]] = [[], [], []]
    starts, source, kinship = [], [], []

    def add(found: Sequence[_Floats], at: NDArray[np.intp], number: int, kin: float) -> None:
        for part, more in zip(parts, found, strict=True):
            part.append(more)
        starts.append(at)
        source.append(np.full(len(at), number, dtype=np.intp))
        kinship.append(np.full(len(at), kin))

    for number, recording in enumerate(recordings):
        at = _starts(recording, markers, stencil)
        if number == 0:
            at = np.concatenate([[start], at])
            pose = recording.positions[at[:, None] + flat][:, :, markers]
            at = at[_nearest_and_even(_features(pose, counts, root)[0])]
        found = [recording.positions[at[:, None] + layer][:, :, markers] for layer in layers]
        add(found, at, number if number == 0 else number + 1, recording.kinship)
        if number == 0 and contralateral is not None:
            image = [reflected(windows[1:, :, contralateral]) for windows in found]
            add(image, at[1:], 1, MIRROR_KINSHIP)
    beside, inside, poses = (np.concatenate(part) for part in parts)
    features, rotation = _features(poses, counts, root)
    return Windows(
        beside,
        inside,
        features,
        rotation,
        np.concatenate(starts),
        np.concatenate(source),
        np.concatenate(kinship),
    )


def _nearest_and_even(features: _Floats) -> NDArray[np.intp]:
    """Choose windows whose edges are like the first one's, and others evenly; the first first."""
    count = len(features) - 1
    if count <= MOST_WINDOWS:
        return np.arange(count + 1)
    near = int(NEAREST * MOST_WINDOWS)
    away = ((features[1:] - features[0]) ** 2).sum(axis=1)
    chosen = 1 + np.argsort(away, kind="stable")[:near]
    rest = np.setdiff1d(np.arange(1, count + 1), chosen)
    even = rest[evenly_spaced(len(rest), MOST_WINDOWS - near)]
    return np.concatenate([[0], np.sort(np.concatenate([chosen, even]))])


def _starts(recording: Recording, markers: NDArray[np.intp], stencil: Stencil) -> NDArray[np.intp]:
    """Return where windows start of which all is seen, evenly spread over a recording."""
    positions = recording.positions
    first, last = -stencil.first, len(positions) - stencil.last
    if recording.starts is not None:
        given = recording.starts
        possible = given[(given >= first) & (given <= last)]
    else:
        possible = np.arange(first, last + 1, dtype=np.intp)
    if not len(possible):
        return np.empty(0, dtype=np.intp)
    # a window is of use if every frame from its first to its last is seen
    unseen = np.isnan(positions[:, markers, 0]).any(axis=1)
    total = np.concatenate([[0], np.cumsum(unseen)])
    possible = possible[total[possible + stencil.last] == total[possible + stencil.first]]
    if recording.starts is not None or not len(possible):
        return np.asarray(possible)
    apart = max(1, int(OVERLAP * stencil.frames))
    count = min(CANDIDATES, -(-len(possible) // apart))
    return np.asarray(possible[evenly_spaced(len(possible), count)])


def _features(poses: _Floats, counts: Sequence[int], root: RootGroup) -> tuple[_Floats, _Floats]:
    """Return what the edges of windows tell, and the rotations of their root frames.

    Parameters
    ----------
    poses : ndarray [shape=(windows, frames, markers, 3), mm]
        One edge after the other, the frame nearest to the blackout first.
    counts : sequence of int
        How many frames each edge has: 3 tell an acceleration, 2 a velocity.
    root : RootGroup
        Gives position and heading at each edge; the window's are between them.
    """
    at = np.cumsum([0, *counts[:-1]])
    nearest = poses[:, at]
    windows, edges, markers, _ = nearest.shape
    frames = root.frames(nearest.reshape(-1, markers, 3))
    origin = frames.origin.reshape(windows, edges, 3).mean(axis=1)
    turn = frames.rotation.reshape(windows, edges, 3, 3).sum(axis=1)
    rotation = about_vertical(np.arctan2(turn[:, 1, 0], turn[:, 0, 0]))
    local = np.einsum("wfmi,wij->wfmj", poses - origin[:, None, None], rotation)
    parts = []
    per_step = SECONDS_OF_SPEED / EDGE_STEP, (SECONDS_OF_ACCELERATION / EDGE_STEP) ** 2
    for first, count in zip(at, counts, strict=True):
        edge = local[:, first : first + count]
        parts.append(edge[:, 0])
        if count > 1:
            parts.append(per_step[0] * (edge[:, 0] - edge[:, 1]))
        if count > 2:
            parts.append(per_step[1] * (edge[:, 0] - 2.0 * edge[:, 1] + edge[:, 2]))
    return np.concatenate([p.reshape(windows, -1) for p in parts], axis=1), rotation


def contralateral_among(
    contralateral: NDArray[np.intp], markers: NDArray[np.intp]
) -> NDArray[np.intp] | None:
    """Return the partners of some markers, counted among these; None where most have none.

    One without a partner is its own: what is learnt is how it moves, not where it is.
    """
    partners = contralateral[markers]
    paired = np.isin(partners, markers)
    if paired.mean() < PAIRED:
        return None
    return np.searchsorted(markers, np.where(paired, partners, markers)).astype(np.intp)
