"""Windows of a blackout: spans of recordings of the same length that show all markers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.mirror import reflected
from priorfill.geometry.poses import evenly_spaced
from priorfill.geometry.root_frames import RootGroup, about_vertical
from priorfill.methods.gpr.blackout.options import BlackoutOptions
from priorfill.methods.gpr.blackout.window_layout import WindowLayout

__all__ = ["BlackoutWindows", "MirrorImage", "WindowSource", "collect_windows"]

_Floats = NDArray[np.float64]
_Ints = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class WindowSource:
    """A recording that windows are taken from.

    Attributes
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        Upright, at the clip's rate; NaN where missing.
    correlation : float
        Correlation of its subject's movements with those of the clip's; 1 for the clip's own.
    starts : ndarray of int, optional
        Frames in which a blackout of the window may begin; any by default.
    """

    positions: _Floats
    correlation: float = 1.0
    starts: _Ints | None = None


@dataclass(frozen=True, eq=False)
class MirrorImage:
    """The mirror image of the clip.

    Attributes
    ----------
    contralateral : ndarray of int [shape=(markers,)]
        Each marker's counterpart on the other side of the body; -1 where it has none.
    correlation : float
        Correlation of its movements with those of the clip's own subject.
    """

    contralateral: _Ints
    correlation: float

    def among(self, markers: _Ints, min_share: float) -> MirrorImage | None:
        """Return the mirror image of some markers, with indices into these.

        A marker without a counterpart is its own: the image shows how it moves, though not where it
        is.

        Parameters
        ----------
        markers : ndarray of int
            The markers, ascending.
        min_share : float
            Share of them that must have a counterpart among them; else the result is None.
        """
        counterpart = self.contralateral[markers]
        paired = np.isin(counterpart, markers)
        if paired.mean() < min_share:
            return None
        among = np.searchsorted(markers, np.where(paired, counterpart, markers))
        return MirrorImage(among.astype(np.intp), self.correlation)


@dataclass(frozen=True, eq=False)
class BlackoutWindows:
    """The blackout, which comes first, and windows of recordings.

    Attributes
    ----------
    context : ndarray [shape=(windows, context frames, markers, 3), mm]
        Samples on either side.
    inside : ndarray [shape=(windows, frames inside, markers, 3), mm]
        NaN for the blackout.
    edges : ndarray [shape=(windows, features), mm]
        Poses, velocities and accelerations at the edges, in the window's root frame.
    rotation : ndarray [shape=(windows, 3, 3)]
        Of the root frames: ``local = world @ rotation``.
    start : ndarray of int [shape=(windows,)]
        Frame of its recording that corresponds to the first missing one.
    source : ndarray of int [shape=(windows,)]
        Number of the recording; the clip's mirror image has a number of its own.
    correlation : ndarray [shape=(windows,)]
        Of the recording, see `WindowSource`.
    own, own_image : ndarray of bool [shape=(windows,)]
        Whether it is of the clip, or of the clip's mirror image.
    """

    context: _Floats
    inside: _Floats
    edges: _Floats
    rotation: _Floats
    start: _Ints
    source: _Ints
    correlation: _Floats
    own: NDArray[np.bool_]
    own_image: NDArray[np.bool_]

    def __len__(self) -> int:
        """Return the number of windows, without the blackout."""
        return len(self.start) - 1

    def scored(self, min_windows: int) -> NDArray[np.bool_]:
        """Return on which windows errors are estimated [shape=(windows,)], without the blackout.

        Those of the clip, or all if these are fewer than ``min_windows``.
        """
        own = self.own[1:]
        return own if own.sum() >= min_windows else np.ones_like(own)

    def source_correlation(self) -> _Floats:
        """Return the correlation of each pair of windows by their recordings.

        Two recordings share what either has in common with the clip.
        """
        same = self.source[:, None] == self.source
        correlation: _Floats = np.where(same, 1.0, self.correlation[:, None] * self.correlation)
        return correlation


@dataclass(frozen=True, eq=False)
class _WindowBlock:
    """The windows of one recording."""

    context: _Floats
    inside: _Floats
    edge_poses: _Floats
    start: _Ints
    correlation: float

    @classmethod
    def of(
        cls, source: WindowSource, start: _Ints, markers: _Ints, layout: WindowLayout
    ) -> _WindowBlock:
        """Read the windows that begin in some frames."""

        def positions(frames: _Ints) -> _Floats:
            found: _Floats = source.positions[start[:, None] + frames][:, :, markers]
            return found

        return cls(
            positions(layout.context),
            positions(layout.inside),
            positions(_edge_frames(layout)),
            start,
            source.correlation,
        )

    def mirrored(self, image: MirrorImage) -> _WindowBlock:
        """Return the mirror image of all windows but the first, which is the blackout."""
        context, inside, poses = (
            reflected(part[1:, :, image.contralateral])
            for part in (self.context, self.inside, self.edge_poses)
        )
        return _WindowBlock(context, inside, poses, self.start[1:], image.correlation)


def collect_windows(
    sources: Sequence[WindowSource],
    markers: _Ints,
    image: MirrorImage | None,
    start: int,
    layout: WindowLayout,
    root: RootGroup,
    options: BlackoutOptions,
) -> BlackoutWindows:
    """Collect the windows of recordings, of the clip's mirror image, and of the blackout itself.

    Parameters
    ----------
    sources : sequence of WindowSource
        The clip, and other recordings.
    markers : ndarray of int
        Columns of the positions that are used.
    image : MirrorImage or None
        The clip's mirror image, with indices into ``markers``; None to leave it out.
    start : int
        First frame of the blackout in the clip.
    layout : WindowLayout
        Of the blackout.
    root : RootGroup
        Indices into ``markers``.
    options : BlackoutOptions
        Numbers of windows.
    """
    clip = sources[0]
    at = np.concatenate([[start], _window_starts(clip, markers, layout, options)])
    poses = clip.positions[at[:, None] + _edge_frames(layout)][:, :, markers]
    chosen = _nearest_and_spaced(_edge_features(poses, layout, root, options)[0], options)
    blocks = [_WindowBlock.of(clip, at[chosen], markers, layout)]
    if image is not None:
        blocks.append(blocks[0].mirrored(image))
    for source in sources[1:]:
        starts = _window_starts(source, markers, layout, options)
        blocks.append(_WindowBlock.of(source, starts, markers, layout))
    edges, rotation = _edge_features(
        np.concatenate([block.edge_poses for block in blocks]), layout, root, options
    )
    counts = [len(block.start) for block in blocks]
    number = np.repeat(np.arange(len(blocks)), counts)
    return BlackoutWindows(
        np.concatenate([block.context for block in blocks]),
        np.concatenate([block.inside for block in blocks]),
        edges,
        rotation,
        np.concatenate([block.start for block in blocks]),
        number,
        np.repeat([block.correlation for block in blocks], counts),
        number == 0,
        (number == 1) & (image is not None),
    )


def _edge_frames(layout: WindowLayout) -> _Ints:
    """Return the frames of all edges, see `WindowLayout.edge_frames`."""
    return np.array([frame for edge in layout.edge_frames() for frame in edge], dtype=np.intp)


def _nearest_and_spaced(features: _Floats, options: BlackoutOptions) -> _Ints:
    """Choose windows by their edge features: the most similar, and others evenly spaced.

    The first one is the blackout, which stays the first.
    """
    count, max_count = len(features) - 1, options.max_windows
    if count <= max_count:
        return np.arange(count + 1)
    near = int(options.nearest_share * max_count)
    square = ((features[1:] - features[0]) ** 2).sum(axis=1)
    nearest = 1 + np.argsort(square, kind="stable")[:near]
    rest = np.setdiff1d(np.arange(1, count + 1), nearest)
    spaced = rest[evenly_spaced(len(rest), max_count - near)]
    return np.concatenate([[0], np.sort(np.concatenate([nearest, spaced]))])


def _window_starts(
    source: WindowSource, markers: _Ints, layout: WindowLayout, options: BlackoutOptions
) -> _Ints:
    """Return where windows begin in a recording: complete ones, evenly spaced."""
    positions = source.positions
    first, last = -layout.first, len(positions) - layout.last
    if source.starts is not None:
        possible = source.starts[(source.starts >= first) & (source.starts <= last)]
    else:
        possible = np.arange(first, last + 1, dtype=np.intp)
    if not len(possible):
        return np.empty(0, dtype=np.intp)
    incomplete = np.isnan(positions[:, markers, 0]).any(axis=1)
    total = np.concatenate([[0], np.cumsum(incomplete)])
    possible = possible[total[possible + layout.last] == total[possible + layout.first]]
    if source.starts is not None or not len(possible):
        return np.asarray(possible)
    spacing = max(1, int(options.window_spacing * layout.frames))
    count = min(options.max_candidates, -(-len(possible) // spacing))
    return np.asarray(possible[evenly_spaced(len(possible), count)])


def _edge_features(
    poses: _Floats, layout: WindowLayout, root: RootGroup, options: BlackoutOptions
) -> tuple[_Floats, _Floats]:
    """Return the edge features of windows and the rotations of their root frames.

    Parameters
    ----------
    poses : ndarray [shape=(windows, frames, markers, 3), mm]
        In the frames of `WindowLayout.edge_frames`: of three the acceleration is computed, of two
        the velocity.
    layout : WindowLayout
        Of the windows.
    root : RootGroup
        Gives position and heading at each edge; the window's are between them.
    options : BlackoutOptions
        Weights of velocities and accelerations.

    Returns
    -------
    features : ndarray [shape=(windows, features), mm]
    rotation : ndarray [shape=(windows, 3, 3)]
    """
    counts = [len(edge) for edge in layout.edge_frames()]
    at = np.cumsum([0, *counts[:-1]])
    nearest = poses[:, at]
    windows, edges, markers, _ = nearest.shape
    frames = root.frames(nearest.reshape(-1, markers, 3))
    origin = frames.origin.reshape(windows, edges, 3).mean(axis=1)
    turn = frames.rotation.reshape(windows, edges, 3, 3).sum(axis=1)
    rotation = about_vertical(turn[:, 0, 0], turn[:, 1, 0])
    local = np.einsum("wfmi,wij->wfmj", poses - origin[:, None, None], rotation)
    velocity_steps = options.velocity_seconds / options.difference_seconds
    acceleration_steps = (options.acceleration_seconds / options.difference_seconds) ** 2
    parts = []
    for first, count in zip(at, counts, strict=True):
        edge = local[:, first : first + count]
        parts.append(edge[:, 0])
        if count > 1:
            parts.append(velocity_steps * (edge[:, 0] - edge[:, 1]))
        if count > 2:
            parts.append(acceleration_steps * (edge[:, 0] - 2.0 * edge[:, 1] + edge[:, 2]))
    return np.concatenate([p.reshape(windows, -1) for p in parts], axis=1), rotation
