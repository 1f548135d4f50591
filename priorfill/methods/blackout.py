"""Fill a blackout: no marker is seen, or too few of them to tell the others.

What a body did while nobody looked is told by three things: how it moved before and after; how
this person moves over stretches of the same length, which the rest of the clip shows; and what
came between when others stood and moved alike at both edges, which the database shows. Hence

1. several *curves*, each a linear function of the samples beside the blackout: Gaussian processes
   in time of different smoothness where both sides are seen, velocities that die away where one
   side is (`priorfill.bridge`);
2. the same curves over *windows*: stretches of the clip, of its mirror image and of the database,
   of the same length and seen throughout. What comes out best there, marker by marker, mixes the
   curves, and least squares improve the mixture, frame by frame;
3. a Gaussian-process regression [R06]_ (section 2.2) from the poses, velocities and accelerations
   of the whole body at the edges to what the mixture got wrong. It counts as far as it helps in
   windows that are left out ([R06]_ Eq. 5.12, in blocks);
4. what is left wrong in the windows, in units of how far the curves disagree there, is the
   expected error.

References
----------
.. [R06] Rasmussen and Williams, Gaussian Processes for Machine Learning, MIT Press 2006.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from priorfill.bridge import Curve, dying_velocity, process_in_time
from priorfill.normalise import RootGroup

__all__ = ["REACH", "Blackout", "Recording", "Windows", "fill_blackout"]

_Floats = NDArray[np.float64]

REACH = 0.15
"""s. How far beside the blackout its edges reach: 0.1 to 0.3 s do as well."""

EDGE_SAMPLES = 9
"""Samples of an edge that are looked at, at most."""

EDGE_STEP = 0.05
"""s. Velocities and accelerations at an edge are differences over this."""

INSIDE_RATE = 20.0
"""Hz. Resolution in which what came between is learnt: what the curves get wrong is slow."""

FEWEST_INSIDE = 3
"""Frames inside at which it is learnt at least."""

MOST_INSIDE = 60
"""The same at most: of what a body did a second from either edge the coarse shape can be told."""

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

MIRROR = np.array([-1.0, 1.0, 1.0])
"""What turns a pose into its mirror image, left and right apart."""

MIRROR_KINSHIP = 0.95
"""How far a body agrees with its mirror image."""

PAIRED = 0.5
"""Part of the markers that must have a partner for the mirror image to be of use."""

SHARPNESS = 8.0
"""A curve or a regression counts as its error to the power of minus this."""

ALIKE = 0.4
"""Windows count less in the mixture the more the logarithm of their scale differs from the
blackout's; this is the standard deviation."""

ANYHOW = 0.05
"""How much they count however much it differs."""

RIDGE = 0.02
"""Ridge of the least squares, in units of each unknown's own square sum."""

SECONDS_OF_SPEED = 0.15
"""s. A velocity counts in the regression as the distance covered in this time."""

SECONDS_OF_ACCELERATION = 0.1
"""s. An acceleration counts as the distance covered in half the square of this, times two."""

LINEAR, CONSTANT = 0.1, 1.0
"""Parts of the kernel beside the radial one, which has 1."""

SCALES = (0.4, 0.7)
"""Length scales of the radial kernel, in units of the windows' rms distance from their mean."""

NOISES = (0.1, 0.5)
"""Variance of what the edges do not tell, in units of the kernel."""

POWERS = (0.5, 1.0)
"""What the curves get wrong grows with how far they disagree to about this power."""

PROFILE_POWER = 0.7
"""The same for the expected error; there it leaves a third of the logarithms' variation."""

LEAST_SCALE = 0.2
"""A window's scale is not far below this part of the median: at rest all that is left is noise."""

UNLEARNT = 1.5
"""Expected error where there are too few windows, in units of how far the curves disagree."""

PREDICTABLE = 0.25
"""s. So long a movement goes on as it began; where no window tells better, all its way from then on
is expected to be wrong."""

LEAST_SPEED = 100.0
"""mm/s. Someone who stands still is expected to go on at this speed."""

LEAST_DEVIATION = 0.1
"""mm. Least expected error."""


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
class Blackout:
    """What is found for a blackout.

    Attributes
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN for markers that are not known at the edges, which they are not if seen on one side
        while others are seen on both.
    deviation : ndarray [shape=(frames, markers), mm]
        Expected rms Euclidean error.
    windows : int
        How many windows taught something; 0 where it is bridged over time alone.
    """

    positions: _Floats
    deviation: _Floats
    windows: int


@dataclass(frozen=True, eq=False)
class _Stencil:
    """Frames of a window, counted from the first frame that is missing.

    Attributes
    ----------
    frames : int
        Length of the blackout.
    before, after : ndarray of int
        Frames beside it that the curves go by, in order of time; one of them may be empty.
    inside : ndarray of int
        Frames at which what came between is learnt.
    step : int
        Frames over which velocities are taken.
    """

    frames: int
    before: NDArray[np.intp]
    after: NDArray[np.intp]
    inside: NDArray[np.intp]
    step: int

    @property
    def beside(self) -> NDArray[np.intp]:
        """All frames beside it."""
        return np.concatenate([self.before, self.after])

    @property
    def first(self) -> int:
        """The first frame that a window needs."""
        return int(self.before[0]) if len(self.before) else 0

    @property
    def last(self) -> int:
        """The frame after the last one that a window needs."""
        return int(self.after[-1]) + 1 if len(self.after) else self.frames

    def edges(self) -> list[list[int]]:
        """Frames of each edge that tell its pose, velocity and acceleration, nearest first."""
        found = []
        if len(self.before):
            near = [-1, -1 - self.step, -1 - 2 * self.step]
            found.append([f for f in near if f >= self.before[0]])
        if len(self.after):
            near = [self.frames, self.frames + self.step, self.frames + 2 * self.step]
            found.append([f for f in near if f <= self.after[-1]])
        return found


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


def _side(known: NDArray[np.bool_], order: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the frames of one side, nearest first, up to the first one that shows too little."""
    shows = known[order].mean(axis=1) if len(order) else np.empty(0)
    # what is shown right beside the blackout must be shown throughout
    enough = (shows >= shows[0]) & (shows > 0.0) if len(order) else np.empty(0, dtype=bool)
    count = len(order) if enough.all() else int(np.argmin(enough))
    return np.asarray(order[:count])


def _stencil(known: NDArray[np.bool_], start: int, stop: int, rate: float) -> _Stencil | None:
    """Lay out the window of a blackout; None where neither side shows anything."""
    reach = max(2, round(REACH * rate))
    before = _side(known, np.arange(start - 1, max(start - 1 - reach, -1), -1))[::-1]
    after = _side(known, np.arange(stop, min(stop + reach, len(known))))
    if len(before) < 2 and len(after) < 2:
        return None
    frames = stop - start
    inside_count = int(np.clip(np.ceil(frames / rate * INSIDE_RATE), FEWEST_INSIDE, MOST_INSIDE))
    spread = np.linspace(-1, frames, inside_count + 2)[1:-1]
    inside = np.unique(np.clip(np.round(spread), 0, frames - 1).astype(np.intp))
    return _Stencil(
        frames,
        _thinned(before[::-1])[::-1] - start,
        _thinned(after) - start,
        inside,
        max(1, round(EDGE_STEP * rate)),
    )


def _thinned(frames: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return up to `EDGE_SAMPLES` of some frames, the first ones among them."""
    if len(frames) <= EDGE_SAMPLES:
        return frames
    return frames[np.round(np.linspace(0, len(frames) - 1, EDGE_SAMPLES)).astype(np.intp)]


def _curves(stencil: _Stencil, rate: float, asked: NDArray[np.intp]) -> list[Curve]:
    """Return the curves that lead through a blackout, at some of its frames."""
    both = len(stencil.before) and len(stencil.after)
    make = process_in_time if both else dying_velocity
    return make(stencil.beside / rate, asked / rate)


def _draw(curves: Sequence[Curve], beside: _Floats) -> _Floats:
    """Return the curves of windows [shape=(curves, windows, frames, markers, 3), mm]."""
    middle = beside.mean(axis=2, keepdims=True)
    drawn = []
    for curve in curves:
        line = np.tensordot(curve.each, beside, (1, 1)).transpose(1, 0, 2, 3)
        if curve.together is not None:
            line = line + np.tensordot(curve.together, middle, (1, 1)).transpose(1, 0, 2, 3)
        drawn.append(line)
    return np.array(drawn)


def _gather(
    recordings: Sequence[Recording],
    markers: NDArray[np.intp],
    partner: NDArray[np.intp] | None,
    start: int,
    stencil: _Stencil,
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
    stencil : _Stencil
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
        if number == 0 and partner is not None:
            image = [windows[1:, :, partner] * MIRROR for windows in found]
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
    even = rest[np.linspace(0, len(rest) - 1, MOST_WINDOWS - near).astype(np.intp)]
    return np.concatenate([[0], np.sort(np.concatenate([chosen, even]))])


def _starts(recording: Recording, markers: NDArray[np.intp], stencil: _Stencil) -> NDArray[np.intp]:
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
    some = np.unique(np.linspace(0, len(possible) - 1, count).astype(np.intp))
    return np.asarray(possible[some])


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
    angle = np.arctan2(turn[:, 1, 0], turn[:, 0, 0])
    rotation = np.zeros((windows, 3, 3))
    rotation[:, 0, 0] = rotation[:, 1, 1] = np.cos(angle)
    rotation[:, 1, 0] = np.sin(angle)
    rotation[:, 0, 1] = -np.sin(angle)
    rotation[:, 2, 2] = 1.0
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


def _mixture(curves: _Floats, truth: _Floats, weight: _Floats) -> _Floats:
    """Mix curves by what they get wrong in windows.

    Parameters
    ----------
    curves : ndarray [shape=(curves, 1 + windows, frames, markers, 3), mm]
        Of the blackout and the windows.
    truth : ndarray [shape=(windows, frames, markers, 3), mm]
        What the windows show.
    weight : ndarray [shape=(windows,)]
        How much each counts in the least squares.

    Returns
    -------
    ndarray [shape=(1 + windows, frames, markers, 3), mm]
        The mixture.
    """
    wrong = curves[:, 1:] - truth
    part = weight**2 / (weight**2).sum()
    error = np.sqrt(np.einsum("w,cwqm->cm", part, (wrong**2).sum(axis=-1)) / wrong.shape[2])
    error += np.finfo(float).eps
    share = (error.min(axis=0) / error) ** SHARPNESS
    share /= share.sum(axis=0)
    mixed: _Floats = np.einsum("cm,cwqmi->wqmi", share, curves)
    away = curves - mixed
    left = (truth - mixed[1:]) * weight[:, None, None, None]
    result = mixed.copy()
    # the vertical is another matter than the horizontal, whose two axes are alike
    for axes in ([0, 1], [2]):
        for frame in range(truth.shape[1]):
            directions = away[:, 1:, frame][..., axes] * weight[:, None, None]
            directions = directions.reshape(len(curves), -1)
            square = directions @ directions.T
            ridge = RIDGE * np.diag(square) + np.finfo(float).eps * (1.0 + np.trace(square))
            square[np.diag_indices_from(square)] += ridge
            step = np.linalg.solve(square, directions @ left[:, frame][..., axes].ravel())
            result[:, frame][..., axes] += np.tensordot(step, away[:, :, frame][..., axes], 1)
    return result


def _correct(
    windows: Windows, wrong: _Floats, scale: _Floats, weight: _Floats, apart: int
) -> tuple[_Floats, _Floats]:
    """Predict from the edges what the mixture gets wrong.

    Parameters
    ----------
    windows : Windows
        The blackout and the windows.
    wrong : ndarray [shape=(windows, values), mm]
        What is wrong in the windows, in root frames.
    scale : ndarray [shape=(1 + windows,)]
        How much is to be expected to be wrong.
    weight : ndarray [shape=(windows,)]
        How much each counts when it is judged.
    apart : int
        Windows of the clip and its mirror image that start nearer than this share frames.

    Returns
    -------
    correction : ndarray [shape=(values,), mm]
        For the blackout, in its root frame.
    left : ndarray [shape=(judged windows, values), mm]
        What would be left wrong in the clip's own windows, or in all if it has too few.
    """
    own = windows.source[1:] == 0
    judged = np.flatnonzero(own) if own.sum() >= FEWEST_WINDOWS else np.arange(len(own))
    here = windows.source[1:] <= 1
    time = windows.start[1:]
    blocks = []
    for window in judged:
        same = here if here[window] else windows.source[1:] == windows.source[1 + window]
        blocks.append(np.flatnonzero(same & (np.abs(time - time[window]) < apart)))
    features = windows.edges - windows.edges[1:].mean(axis=0)
    features /= np.sqrt((features[1:] ** 2).sum(axis=1).mean()) + np.finfo(float).eps
    product = features @ features.T
    square = np.diag(product)
    away = np.maximum(square[:, None] + square - 2.0 * product, 0.0)
    kin = windows.kinship[:, None] * windows.kinship
    kin = np.where(windows.source[:, None] == windows.source, 1.0, kin)
    predictions, residuals = [], []
    for length in SCALES:
        kernel = (LINEAR * product + np.exp(-away / (2.0 * length**2)) + CONSTANT) * kin
        for noise in NOISES:
            inverse = np.linalg.inv(kernel[1:, 1:] + noise * np.eye(len(own)))
            for power in POWERS:
                by = scale**power
                scaled = inverse @ (wrong / by[1:, None])
                predictions.append(by[0] * (kernel[0, 1:] @ scaled))
                left = np.empty((len(judged), wrong.shape[1]))
                for row, (window, block) in enumerate(zip(judged, blocks, strict=True)):
                    rest = np.linalg.solve(inverse[np.ix_(block, block)], scaled[block])
                    left[row] = by[1 + window] * rest[np.searchsorted(block, window)]
                residuals.append(left)
    predictions.append(np.zeros(wrong.shape[1]))
    residuals.append(wrong[judged])
    part = weight[judged, None] / np.sqrt((weight[judged] ** 2).sum())
    error = np.sqrt([((part * r) ** 2).sum() for r in residuals]) + np.finfo(float).eps
    share = (error.min() / error) ** SHARPNESS
    share /= share.sum()
    correction = share @ np.array(predictions)
    left = np.tensordot(share, np.array(residuals), 1)
    # as much of it as helps in the windows
    said = wrong[judged] - left
    explained = float((part**2 * said * wrong[judged]).sum())
    gain = explained / float(((part * said) ** 2).sum() + np.finfo(float).eps)
    gain = min(max(gain, 0.0), 1.0)
    return gain * correction, wrong[judged] - gain * said


def fill_blackout(
    recordings: Sequence[Recording],
    start: int,
    stop: int,
    rate: float,
    root: Callable[[NDArray[np.intp]], RootGroup | None],
    partner: NDArray[np.intp],
    wanted: NDArray[np.intp],
) -> Blackout | None:
    """Fill a blackout.

    Parameters
    ----------
    recordings : sequence of Recording
        The clip, in which nothing is known of the blackout, and others.
    start, stop : int
        Frames to find.
    rate : float
        Hz.
    root : callable
        Gives the root group among some markers.
    partner : ndarray of int [shape=(markers,)]
        Each marker's partner on the other side of the body; -1 where it has none.
    wanted : ndarray of int
        The markers to be found.

    Returns
    -------
    Blackout or None
        None where neither side shows two frames.
    """
    clip = recordings[0].positions
    known = ~np.isnan(clip[..., 0])
    stencil = _stencil(known[:, wanted], start, stop, rate)
    if stencil is None:
        return None
    whole = known[start + stencil.first : start].all(axis=0)
    whole &= known[stop : start + stencil.last].all(axis=0)
    markers = np.flatnonzero(whole)
    group = root(markers)
    windows = None
    if group is not None:
        columns = tuple(int(c) for c in np.searchsorted(markers, group.markers))
        here = RootGroup(columns, group.template)
        among = _partners(partner, markers)
        windows = _gather(recordings, markers, among, start, stencil, here)
    asked = np.arange(stencil.frames)
    inside = _curves(stencil, rate, stencil.inside)
    beside = clip[np.ix_(start + stencil.beside, markers)][None]
    plain = _draw(_curves(stencil, rate, asked)[:1], beside)[0, 0]
    count = 0 if windows is None else len(windows.start) - 1
    if windows is None or count < FEWEST_WINDOWS:
        count = 0
        curves = _draw(inside, beside)
        found = curves.mean(axis=0)[0]
        deviation = _unlearnt(curves, beside[0], stencil, rate)
    else:
        found, deviation = _learn(windows, _draw(inside, windows.beside), stencil)
    correction = found - plain[stencil.inside]
    positions = np.full((stencil.frames, clip.shape[1], 3), np.nan)
    positions[:, markers] = plain + _through(stencil, correction, asked)
    spread = np.full((stencil.frames, clip.shape[1]), np.nan)
    spread[:, markers] = _profile(stencil, deviation, asked)
    return Blackout(positions, spread, count)


def _partners(partner: NDArray[np.intp], markers: NDArray[np.intp]) -> NDArray[np.intp] | None:
    """Return the partners of some markers, counted among these; None where most have none.

    One without a partner is its own: what is learnt is how it moves, not where it is.
    """
    partners = partner[markers]
    paired = np.isin(partners, markers)
    if paired.mean() < PAIRED:
        return None
    return np.searchsorted(markers, np.where(paired, partners, markers)).astype(np.intp)


def _unlearnt(curves: _Floats, beside: _Floats, stencil: _Stencil, rate: float) -> _Floats:
    """Return an expected error [shape=(frames, markers), mm] where no window tells it.

    Parameters
    ----------
    curves : ndarray [shape=(curves, 1, frames, markers, 3), mm]
        Through the blackout.
    beside : ndarray [shape=(frames beside, markers, 3), mm]
        What is seen.
    stencil : _Stencil
        Of the blackout.
    rate : float
        Hz.
    """
    disagree = np.sqrt(curves.var(axis=0).sum(axis=-1))[0]
    away = np.full(len(stencil.inside), np.inf)
    steps = np.diff(beside, axis=0) * rate / np.diff(stencil.beside)[:, None, None]
    if len(stencil.before):
        away = np.minimum(away, stencil.inside + 1)
    if len(stencil.after):
        away = np.minimum(away, stencil.frames - stencil.inside)
    speed = np.hypot(np.sqrt((steps**2).sum(axis=-1).mean()), LEAST_SPEED)
    lost = speed * np.maximum(away / rate - PREDICTABLE, 0.0)
    expected: _Floats = np.hypot(UNLEARNT * disagree, lost[:, None])
    return expected


def _learn(windows: Windows, curves: _Floats, stencil: _Stencil) -> tuple[_Floats, _Floats]:
    """Return what is found at the frames inside a blackout, and its expected error.

    Parameters
    ----------
    windows : Windows
        The blackout and the windows.
    curves : ndarray [shape=(curves, 1 + windows, frames, markers, 3), mm]
        Theirs.
    stencil : _Stencil
        Of the blackout.
    """
    truth = windows.inside[1:]
    disagree = np.sqrt(curves.var(axis=0).sum(axis=-1).mean(axis=(1, 2)))
    usual = float(np.median(disagree)) + np.finfo(float).eps
    scale = np.hypot(disagree, LEAST_SCALE * usual) / usual
    # a person who stands still is told by stretches of standing still
    alike = np.exp(-0.5 * (np.log(scale[1:] / scale[0]) / ALIKE) ** 2) + ANYHOW
    own = windows.source[1:] == 0
    judged = own if own.sum() >= FEWEST_WINDOWS else np.ones_like(own)
    # a database's poses are smoothed: how smooth the clip is is for its own windows to say
    taught = windows.source[1:] <= 1 if own.sum() >= FEWEST_WINDOWS else judged
    weight = taught * alike / scale[1:]
    mixed = _mixture(curves, truth, weight)
    shape = truth.shape[1:]
    wrong = np.einsum("wqmi,wij->wqmj", truth - mixed[1:], windows.rotation[1:])
    correction, left = _correct(
        windows, wrong.reshape(len(wrong), -1), scale, weight, stencil.last - stencil.first
    )
    found: _Floats = mixed[0] + correction.reshape(shape) @ windows.rotation[0].T
    by = scale**PROFILE_POWER
    relative = left.reshape(-1, *shape) / by[1:][judged][:, None, None, None]
    part = alike[judged] / alike[judged].sum()
    square = np.tensordot(part, (relative**2).sum(axis=-1), 1)
    deviation: _Floats = by[0] * np.sqrt(square)
    return found, deviation


def _through(stencil: _Stencil, correction: _Floats, asked: NDArray[np.intp]) -> _Floats:
    """Carry a correction over to all frames; it begins and ends with nothing, without a kink."""
    nothing = np.zeros_like(correction[:1])
    time, values = [stencil.inside.astype(np.float64)], [correction]
    free: tuple[int, _Floats | float] = (2, nothing[0])
    ends = [free, free]
    if len(stencil.before):
        time.insert(0, np.array([-1.0]))
        values.insert(0, nothing)
        ends[0] = (1, nothing[0])
    if len(stencil.after):
        time.append(np.array([float(stencil.frames)]))
        values.append(nothing)
        ends[1] = (1, nothing[0])
    spline = CubicSpline(np.concatenate(time), np.concatenate(values), bc_type=tuple(ends))
    carried: _Floats = spline(asked)
    return carried


def _profile(stencil: _Stencil, deviation: _Floats, asked: NDArray[np.intp]) -> _Floats:
    """Carry an expected error [shape=(frames inside, markers)] over to all frames."""
    time, values = [stencil.inside], [deviation]
    if len(stencil.before):
        time.insert(0, np.array([-1]))
        values.insert(0, np.zeros_like(deviation[:1]))
    if len(stencil.after):
        time.append(np.array([stencil.frames]))
        values.append(np.zeros_like(deviation[:1]))
    at, known = np.concatenate(time), np.concatenate(values)
    carried = np.stack([np.interp(asked, at, column) for column in known.T], axis=1)
    floored: _Floats = np.maximum(carried, LEAST_DEVIATION)
    return floored
