"""Windows of a blackout: spans of recordings of the same length that show all markers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from priorfill.geometry.mirror import reflected
from priorfill.geometry.poses import evenly_spaced
from priorfill.geometry.root_frames import RootGroup
from priorfill.methods.gpr.blackout.context_noise import match_noise
from priorfill.methods.gpr.blackout.database_windows import DatabaseWindows
from priorfill.methods.gpr.blackout.edge_features import edge_features
from priorfill.methods.gpr.blackout.options import BlackoutOptions
from priorfill.methods.gpr.blackout.window_layout import WindowLayout

__all__ = ["BlackoutWindows", "MirrorImage", "WindowSources", "collect_windows"]

_Floats = NDArray[np.float64]
_Ints = NDArray[np.intp]

OWN, IMAGE, FIRST_TAKE = 0, 1, 2
"""Numbers of recordings: the clip, its mirror image, and the first take of the database."""

OWN_SUBJECT, IMAGE_SUBJECT = -1, -2
"""Numbers of the clip's subject and of its mirror image, as in `priorfill.methods.task`."""


@dataclass(frozen=True, eq=False)
class WindowSources:
    """The recordings that windows are taken from.

    Attributes
    ----------
    clip : ndarray [shape=(frames, markers, 3), mm]
        Positions of the clip, upright; NaN where missing.
    database : sequence of DatabaseWindows
        Windows of other recordings.
    """

    clip: _Floats
    database: Sequence[DatabaseWindows] = ()


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
        Number of the recording: `OWN`, `IMAGE`, or from `FIRST_TAKE`.
    subject : ndarray of int [shape=(windows,)]
        Number of its subject; `OWN_SUBJECT` for that of the clip.
    correlation : ndarray [shape=(windows,)]
        Of its subject's movements with those of the clip's; 1 for the clip's own.
    """

    context: _Floats
    inside: _Floats
    edges: _Floats
    rotation: _Floats
    start: _Ints
    source: _Ints
    subject: _Ints
    correlation: _Floats

    @property
    def own(self) -> NDArray[np.bool_]:
        """Whether a window is of the clip [shape=(windows,)]."""
        own: NDArray[np.bool_] = self.source == OWN
        return own

    @property
    def own_image(self) -> NDArray[np.bool_]:
        """Whether a window is of the clip's mirror image [shape=(windows,)]."""
        image: NDArray[np.bool_] = self.source == IMAGE
        return image

    def __len__(self) -> int:
        """Return the number of windows, without the blackout."""
        return len(self.start) - 1

    def nearness(self, options: BlackoutOptions) -> _Floats:
        """Return how similar each window's edges are to the blackout's, 0 to 1 [shape=(windows,)].

        Without windows of a database, all count alike: the clip's own are few.
        """
        if not self.of_takes.any():
            return np.ones(len(self))
        square = self._square_distance
        usual = np.sort(square)[min(options.similar_windows, len(square)) - 1]
        nearness: _Floats = 1.0 / (1.0 + (square / (usual + np.finfo(float).eps)) ** 2)
        return nearness

    def trained(self, options: BlackoutOptions) -> _Ints:
        """Return the windows, without the blackout, by whose errors the curves are combined."""
        chosen = (self.own | self.own_image)[1:]
        chosen[self._nearest_of_takes(options.max_stacked_windows)] = True
        return np.flatnonzero(chosen)

    def scored(self, options: BlackoutOptions) -> _Ints:
        """Return the windows, without the blackout, on which errors are estimated."""
        chosen = self.own[1:].copy()
        if chosen.sum() < options.min_windows:
            chosen |= self.own_image[1:]
        chosen[self._nearest_of_takes(options.max_scored_windows)] = True
        return np.flatnonzero(chosen)

    @property
    def of_takes(self) -> NDArray[np.bool_]:
        """Whether a window is of a take [shape=(windows,)], without the blackout."""
        of_takes: NDArray[np.bool_] = self.source[1:] >= FIRST_TAKE
        return of_takes

    @property
    def _square_distance(self) -> _Floats:
        """Of the edge features from the blackout's [shape=(windows,), mm²]."""
        square: _Floats = ((self.edges[1:] - self.edges[0]) ** 2).sum(axis=1)
        return square

    def _nearest_of_takes(self, count: int) -> _Ints:
        """Return up to ``count`` windows of takes with the most similar edges."""
        takes = np.flatnonzero(self.of_takes)
        nearest = np.argsort(self._square_distance[takes], kind="stable")[:count]
        return np.asarray(takes[nearest])

    def source_correlation(self) -> _Floats:
        """Return the correlation of each pair of windows by their recordings.

        Two recordings share what either has in common with the clip.
        """
        same = self.source[:, None] == self.source
        correlation: _Floats = np.where(same, 1.0, self.correlation[:, None] * self.correlation)
        return correlation


@dataclass(frozen=True, eq=False)
class _WindowBlock:
    """Some windows; attributes as of `BlackoutWindows`."""

    context: _Floats
    inside: _Floats
    edge_poses: _Floats
    start: _Ints
    source: _Ints
    subject: _Ints
    correlation: _Floats

    @classmethod
    def of_clip(
        cls, clip: _Floats, start: _Ints, markers: _Ints, layout: WindowLayout
    ) -> _WindowBlock:
        """Read the windows of the clip that begin in some frames."""

        def positions(frames: _Ints) -> _Floats:
            found: _Floats = clip[start[:, None] + frames][:, :, markers]
            return found

        context, inside, poses = (positions(f) for f in _frames_read(layout))
        return cls(context, inside, poses, start, *_numbers(len(start), OWN, OWN_SUBJECT, 1.0))

    @classmethod
    def of_database(
        cls, windows: DatabaseWindows, markers: _Ints, layout: WindowLayout
    ) -> _WindowBlock:
        """Read windows of a database."""
        context, inside, poses = (windows.positions(f, markers) for f in _frames_read(layout))
        take = FIRST_TAKE + windows.take
        numbers = take, windows.subject, windows.correlation
        return cls(context, inside, poses, windows.rows, *numbers)

    def mirrored(self, image: MirrorImage) -> _WindowBlock:
        """Return the mirror image of all windows but the first, which is the blackout."""
        context, inside, poses = (
            reflected(part[1:, :, image.contralateral])
            for part in (self.context, self.inside, self.edge_poses)
        )
        numbers = _numbers(len(inside), IMAGE, IMAGE_SUBJECT, image.correlation)
        return _WindowBlock(context, inside, poses, self.start[1:], *numbers)


def _numbers(
    count: int, source: int, subject: int, correlation: float
) -> tuple[_Ints, _Ints, _Floats]:
    """Return the recording, subject and correlation of windows that have these in common."""
    return (
        np.full(count, source, dtype=np.intp),
        np.full(count, subject, dtype=np.intp),
        np.full(count, correlation),
    )


def collect_windows(
    sources: WindowSources,
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
    sources : WindowSources
        The clip, and windows of other recordings.
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
    clip = sources.clip
    counts = [len(edge) for edge in layout.edge_frames()]
    at = np.concatenate([[start], _window_starts(clip, markers, layout, options)])
    poses = clip[at[:, None] + _edge_frames(layout)][:, :, markers]
    chosen = _nearest_and_spaced(edge_features(poses, counts, root, options)[0], options)
    blocks = [_WindowBlock.of_clip(clip, at[chosen], markers, layout)]
    if image is not None:
        blocks.append(blocks[0].mirrored(image))
    blocks += [_WindowBlock.of_database(found, markers, layout) for found in sources.database]

    def joined(name: str) -> NDArray[Any]:
        return np.concatenate([getattr(block, name) for block in blocks])

    edges, rotation = edge_features(joined("edge_poses"), counts, root, options)
    source = joined("source")
    return BlackoutWindows(
        match_noise(joined("context"), source >= FIRST_TAKE, layout),
        joined("inside"),
        edges,
        rotation,
        joined("start"),
        source,
        joined("subject"),
        joined("correlation"),
    )


def _frames_read(layout: WindowLayout) -> tuple[_Ints, _Ints, _Ints]:
    """Return the frames of a window's context, inside, and edges."""
    return layout.context, layout.inside, _edge_frames(layout)


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
    clip: _Floats, markers: _Ints, layout: WindowLayout, options: BlackoutOptions
) -> _Ints:
    """Return where windows begin in the clip: complete ones, evenly spaced."""
    first, last = -layout.first, len(clip) - layout.last
    possible: _Ints = np.arange(first, last + 1, dtype=np.intp)
    if not len(possible):
        return possible
    incomplete = np.isnan(clip[:, markers, 0]).any(axis=1)
    total = np.concatenate([[0], np.cumsum(incomplete)])
    possible = possible[total[possible + layout.last] == total[possible + layout.first]]
    if not len(possible):
        return possible
    spacing = max(1, int(options.window_spacing * layout.frames))
    count = min(options.max_candidates, -(-len(possible) // spacing))
    return np.asarray(possible[evenly_spaced(len(possible), count)])
