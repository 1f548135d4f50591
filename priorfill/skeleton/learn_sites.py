"""Learn where markers sit from a recording that exists both as markers and as skeleton motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from priorfill.skeleton.marker_sites import MarkerSite
from priorfill.skeleton.part_names import NEIGHBOURS, TRUNK
from priorfill.skeleton.skeleton_body import PartFrame

__all__ = ["learn_sites"]

STRETCH = 20.0
"""mm. Standard deviation of a marker's displacement by a second part: skin slides over a joint by a
few centimetres."""

NOISE = 10.0
"""mm. Standard deviation of a marker from the mean of its sites, between independent frames."""

INDEPENDENT_SECONDS = 0.25
"""s. Time after which frames are about independent."""

MIN_SCALE = 1e-3
"""mm. Least scale of a column."""

MAX_ERROR_RATIO = 0.93
"""Maximum held-out error of two parts, relative to that of the best single part."""

_Floats = NDArray[np.float64]
_Frames = Mapping[str, PartFrame]


def learn_sites(
    frames: Mapping[str, PartFrame],
    positions: _Floats,
    segments: Sequence[str],
    contralateral: Sequence[int],
    rate: float,
) -> list[tuple[MarkerSite, ...]]:
    """Learn which parts markers sit on, and where.

    The parts of a marker and of its contralateral marker are those with the smallest error when
    each half of the recording is predicted from the other.

    Parameters
    ----------
    frames : mapping of str to PartFrame
        The frames of the skeleton's parts (`SkeletonBody.frames`).
    positions : ndarray [shape=(frames, markers, 3), mm]
        The markers in the same frames, in the skeleton's axes; NaN where missing.
    segments : sequence of str
        The body segment of each marker.
    contralateral : sequence of int
        The marker of the other side for each marker, or the marker itself.
    rate : float
        Frames per second (Hz).

    Returns
    -------
    list of tuple of MarkerSite
        The sites of each marker.
    """
    penalty = NOISE**2 * INDEPENDENT_SECONDS * rate
    learnt: list[tuple[MarkerSite, ...]] = []
    for marker, segment in enumerate(segments):
        pairs = [(marker, False)]
        if contralateral[marker] != marker:
            pairs.append((contralateral[marker], True))
        errors = {
            parts: sum(
                _held_out_error(
                    frames, positions[:, m], _other_side(parts) if is_other else parts, penalty
                )
                for m, is_other in pairs
            )
            for parts in _candidates(segment)
        }
        single = min((p for p in errors if len(p) == 1), key=errors.__getitem__)
        best = min(
            (p for p in errors if errors[p] < MAX_ERROR_RATIO**2 * errors[single]),
            key=errors.__getitem__,
            default=single,
        )
        learnt.append(_sites(frames, positions[:, marker], best, penalty))
    return learnt


def _candidates(segment: str) -> list[tuple[str, ...]]:
    """Return the parts that may carry a marker of a segment: one, or two adjacent ones.

    Markers of the trunk are carried by their own part alone: their relation to a limb depends too
    much on how the skeleton was fitted to the limb.
    """
    pairs = [pair for pair in NEIGHBOURS if segment in pair]
    if segment in TRUNK:
        return [(segment,)]
    singles = dict.fromkeys((part,) for pair in pairs for part in pair)
    return [*singles, *pairs, *(pair[::-1] for pair in pairs)]


def _other_side(parts: tuple[str, ...]) -> tuple[str, ...]:
    """Return the parts of the other side."""
    swapped = {"left_": "right_", "right_": "left_"}
    return tuple(
        next((new + p.removeprefix(old) for old, new in swapped.items() if p.startswith(old)), p)
        for p in parts
    )


def _held_out_error(
    frames: _Frames, marker: _Floats, parts: tuple[str, ...], penalty: float
) -> float:
    """Return the mean square error (mm²) when each half is predicted from the other."""
    seen = np.flatnonzero(~np.isnan(marker[:, 0]))
    halves = np.array_split(seen, 2)
    square = 0.0
    for train, test in (halves, halves[::-1]):
        train_frames = {part: frames[part].rows(train) for part in parts}
        design, base = _design(frames, parts, test)
        coefficients = _fit(train_frames, marker[train], parts, penalty)
        error = base + design @ coefficients - marker[test]
        square += float((error**2).sum())
    return square / len(seen)


def _design(
    frames: _Frames, parts: tuple[str, ...], rows: NDArray[np.intp] | slice = slice(None)
) -> tuple[_Floats, _Floats]:
    """Return the design matrix of a marker's positions and weight, and the constant term."""
    origin = frames[parts[0]].origin[rows]
    columns = [frames[parts[0]].axes[rows]]
    for part in parts[1:]:
        columns += [frames[part].axes[rows], (frames[part].origin[rows] - origin)[:, :, None]]
    return np.concatenate(columns, axis=2), origin


def _fit(frames: _Frames, marker: _Floats, parts: tuple[str, ...], penalty: float) -> _Floats:
    """Fit positions and weight: least squares for one part, ridge regression for a second."""
    seen = ~np.isnan(marker[:, 0])
    design, origin = _design(frames, parts)
    design, target = design[seen], marker[seen] - origin[seen]
    first = np.linalg.lstsq(design[:, :, :3].reshape(-1, 3), target.ravel(), rcond=None)[0]
    coefficients = np.zeros(design.shape[2])
    coefficients[:3] = first
    if len(parts) > 1:
        residual = (target - design[:, :, :3] @ first).ravel()
        flat = design.reshape(-1, design.shape[2])
        # the penalty is in mm, whatever the unit of a column
        scale = np.sqrt((design**2).sum(axis=1).mean(axis=0))
        # the origins of both parts may coincide
        scale = np.maximum(scale, MIN_SCALE)
        ridge = np.diag((scale / STRETCH) ** 2) * penalty
        coefficients += np.linalg.solve(flat.T @ flat + ridge, flat.T @ residual)
    return coefficients


def _sites(
    frames: _Frames, marker: _Floats, parts: tuple[str, ...], penalty: float
) -> tuple[MarkerSite, ...]:
    """Return a marker's sites on some parts."""
    coefficients = _fit(frames, marker, parts, penalty)
    weight = 0.0 if len(parts) == 1 else float(coefficients[6])
    x, y, z = coefficients[:3].tolist()
    sites = [MarkerSite(parts[0], 1.0 - weight, (x, y, z))]
    for part in parts[1:]:
        x, y, z = coefficients[3:6].tolist()
        sites.append(MarkerSite(part, weight, (x, y, z)))
    return tuple(sites)
