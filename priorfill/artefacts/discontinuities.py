"""Breaks: discontinuities of a marker's path that its reference markers do not share.

Between two consecutive frames, the path extrapolated from the frames before by half a frame should
meet the path extrapolated back from the frames after. The vector by which they miss is the step

    s(t) = v(t) - (v(t-1) + v(t+1)) / 2,    v(t) = x(t+1) - x(t),

half of a third difference: almost zero for the motion of a body, and the whole jump for a jump.
The step that the reference markers make at the same time, for example when a foot hits the floor,
is subtracted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priorfill.artefacts.reference_markers import ReferenceMarkers
from priorfill.geometry.distances import norms
from priorfill.runtime.option_checks import check_at_least, check_between
from priorfill.runtime.threads import map_in_threads

__all__ = ["BreakOptions", "PathBreaks", "find_breaks", "path_steps", "relative_step_sizes"]

BATCH_SAMPLES = 30_000
"""Samples whose steps are computed at once: in a long clip all of them take several times its
memory, and these stay in the processor's cache."""


@dataclass(frozen=True)
class BreakOptions:
    """Which steps count as breaks.

    Attributes
    ----------
    min_size : float
        mm. Smaller steps are noise or soft tissue; this is half of a marker's width. In a minute
        and a half of HDM05 recordings at 120 Hz no step relative to the reference markers is above
        2 mm.
    max_acceleration : float
        mm/s². One frame of it makes a step that is still no break: 24 mm at 50 Hz, 4 mm at 120 Hz.
        Except in hits, markers of one segment accelerate less relative to each other.
    noise_factor : float
        Multiple of the marker's noise (see ``noise_quantile``) that a break exceeds, for clips
        with jitter or bad measurements throughout.
    noise_quantile : float
        Quantile of a marker's own steps taken as its noise.
    noise_frames : int
        Frames used to measure the noise, evenly spaced.
    gap_edge_factor : float
        Factor on the required size next to a gap, where the velocity is known on one side only.
    echo_ratio : float
        A jump also causes half a step in the frames before and after. A step that is smaller than
        its neighbour by more than this factor is such an echo.
    """

    min_size: float = 10.0
    max_acceleration: float = 60e3
    noise_factor: float = 8.0
    noise_quantile: float = 0.9
    noise_frames: int = 500
    gap_edge_factor: float = 3.0
    echo_ratio: float = 1.5

    def __post_init__(self) -> None:
        check_at_least(self, 0.0, "min_size", "max_acceleration", "noise_factor")
        check_between(self, 0.0, 1.0, "noise_quantile")
        check_at_least(self, 1, "noise_frames", "gap_edge_factor", "echo_ratio")


@dataclass(frozen=True)
class PathBreaks:
    """The breaks of all paths of a clip.

    Attributes
    ----------
    broken : ndarray of bool [shape=(frames - 1, markers)]
        Whether a path breaks between a frame and the next.
    size : ndarray [shape=(frames - 1, markers), mm]
        Size of the step relative to the reference markers where the path breaks; 0 elsewhere.
    """

    broken: NDArray[np.bool_]
    size: NDArray[np.float64]


def path_steps(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return by how far the paths before and after each pair of frames miss each other.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.

    Returns
    -------
    ndarray [shape=(frames - 1, markers, 3), mm]
        Between each frame and the next. Where the velocity is known on one side only, it is used
        alone; NaN where it is known on neither side, or one of the two frames is missing.
    """
    velocity = positions[1:] - positions[:-1]
    outside = np.full((1, *velocity.shape[1:]), np.nan)
    padded = np.concatenate([outside, velocity, outside])
    return _misses(padded[:-2], velocity, padded[2:])


def _misses(
    before: NDArray[np.float64], here: NDArray[np.float64], after: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the steps from three velocities in a row [each of shape=(..., markers, 3), mm]."""
    step: NDArray[np.float64] = here - 0.5 * (before + after)
    one_sided = np.isnan(step[..., 0]) & ~np.isnan(here[..., 0])
    if one_sided.any():
        earlier, later = before[one_sided], after[one_sided]
        step[one_sided] = here[one_sided] - np.where(np.isnan(earlier), later, earlier)
    return step


def relative_step_sizes(
    step: NDArray[np.float64],
    references: ReferenceMarkers,
    frame: NDArray[np.intp],
    marker: NDArray[np.intp],
) -> NDArray[np.float64]:
    """Return the sizes of some steps relative to the reference markers.

    Parameters
    ----------
    step : ndarray [shape=(frames - 1, markers, 3), mm]
        As returned by `path_steps`.
    references : ReferenceMarkers
    frame, marker : ndarray of int [shape=(steps,)]
        Which steps.

    Returns
    -------
    ndarray [shape=(steps,), mm]
        The smallest of the step's own size and its sizes relative to each reference marker; NaN
        where there is no step.
    """
    own = step[frame, marker]
    smallest: NDArray[np.float64] = np.sqrt((own**2).sum(axis=1))
    other = step[frame[:, None], references.others[marker]]
    relative = norms(own[:, None] - other)
    relative[~references.known[marker]] = np.nan
    for column in range(relative.shape[1]):
        smallest = np.fmin(smallest, relative[:, column])
    return smallest


def find_breaks(
    positions: NDArray[np.float64],
    references: ReferenceMarkers,
    rate: float,
    options: BreakOptions = BreakOptions(),
) -> PathBreaks:
    """Find where paths break.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    references : ReferenceMarkers
    rate : float
        Hz.
    options : BreakOptions

    Returns
    -------
    PathBreaks

    See Also
    --------
    priorfill.artefacts.find_artefacts : Calls all detectors.
    path_steps : The steps, before the reference markers are considered.
    """
    steps = max(len(positions) - 1, 0)
    size = np.zeros((steps, positions.shape[1]))
    if steps == 0:
        return PathBreaks(size > 0, size)
    min_size = np.maximum(
        max(options.min_size, options.max_acceleration / rate**2),
        options.noise_factor * _noise(positions, references, options),
    )
    batch = max(BATCH_SAMPLES // positions.shape[1], 1)

    def find(start: int) -> None:
        stop = min(start + batch, steps)
        # the steps before and after these count as well, and depend on a frame more each
        first, last = max(start - 2, 0), min(stop + 2, steps)
        part = positions[first : last + 1]
        step = path_steps(part)
        inner = slice(start - first, stop - first)
        # a relative step is never larger than the step itself, which rules out most at once
        square = np.einsum("fmc,fmc->fm", step[inner], step[inner])
        with np.errstate(invalid="ignore"):
            frame, marker = np.nonzero(square > min_size**2)
        if len(frame):
            frame += inner.start
            found = _break_sizes(part, step, references, (frame, marker), min_size[marker], options)
            size[frame + first, marker] = found

    with map_in_threads(positions.size) as mapped:
        for _ in mapped(find, range(0, steps, batch)):
            pass
    return PathBreaks(size > 0, size)


def _break_sizes(
    positions: NDArray[np.float64],
    step: NDArray[np.float64],
    references: ReferenceMarkers,
    at: tuple[NDArray[np.intp], NDArray[np.intp]],
    min_size: NDArray[np.float64],
    options: BreakOptions,
) -> NDArray[np.float64]:
    """Return the sizes of some steps that are breaks, and 0 for those that are none (mm)."""
    frame, marker = at
    last = len(step) - 1
    earlier, later = np.maximum(frame - 1, 0), np.minimum(frame + 1, last)
    here, before, after = (
        np.nan_to_num(relative_step_sizes(step, references, some, marker))
        for some in (frame, earlier, later)
    )
    missing = np.isnan(positions[:, :, 0])
    edge = (frame == 0) | (frame == last)
    edge |= missing[earlier, marker] | missing[np.minimum(frame + 2, last + 1), marker]
    breaks = here > min_size * np.where(edge, options.gap_edge_factor, 1.0)
    breaks &= np.maximum(before, after) <= options.echo_ratio * here
    return np.where(breaks, here, 0.0)


def _noise(
    positions: NDArray[np.float64], references: ReferenceMarkers, options: BreakOptions
) -> NDArray[np.float64]:
    """Return the ``noise_quantile`` of each marker's steps [shape=(markers,), mm]."""
    steps, markers = len(positions) - 1, positions.shape[1]
    sample = np.linspace(0, steps - 1, min(steps, options.noise_frames)).astype(np.intp)
    around = sample + np.arange(-1, 3)[:, None]
    velocity = np.diff(positions[np.clip(around, 0, steps)], axis=0)
    velocity[0, around[0] < 0] = velocity[2, around[3] > steps] = np.nan
    step = _misses(*velocity)
    frame, marker = np.divmod(np.arange(len(sample) * markers), markers)
    size = relative_step_sizes(step, references, frame, marker).reshape(len(sample), markers)
    size = np.sort(size, axis=0)  # NaN last
    count = (~np.isnan(size)).sum(axis=0)
    rank = (options.noise_quantile * np.maximum(count - 1, 0)).astype(np.intp)
    return np.where(count > 0, size[rank, np.arange(markers)], 0.0)
