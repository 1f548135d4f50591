"""Learn where markers sit from a recording that exists as markers and as skeleton motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from priorfill.skeleton.body import Body, part_frames
from priorfill.skeleton.joints import Placed
from priorfill.skeleton.markers import Site
from priorfill.skeleton.part_names import MIDDLE, NEIGHBOURS, PARTS

__all__ = ["learn_sites"]

STRETCH = 20.0
"""mm. How far a second part moves a marker from where the first alone would have it, about: skin
over a joint slides by a few centimetres."""

NOISE = 10.0
"""mm. Deviation of a marker from its sites' mean, from one moment to a really different one."""

MOMENT = 0.25
"""s. Frames nearer than this say nearly the same."""

GAIN = 0.93
"""A second part must bring the left-out error below this share of that of the first alone."""

_Floats = NDArray[np.float64]
_Frames = Mapping[str, tuple[_Floats, _Floats]]


def learn_sites(
    body: Body,
    placed: Placed,
    mm_per_unit: float,
    positions: _Floats,
    segments: Sequence[str],
    partner: Sequence[int],
    rate: float,
) -> list[tuple[Site, ...]]:
    """Learn on which parts markers sit, and where.

    Which parts carry a marker and its mirror image is judged by halves of the recording: those
    with the least error when each half is predicted by the other.

    Parameters
    ----------
    body : Body
        The skeleton's body.
    placed : Placed
        Where its joints are.
    mm_per_unit : float
        Millimetres in the skeleton's unit of length.
    positions : ndarray [shape=(frames, markers, 3), mm]
        The markers at the same moments, in the skeleton's axes; NaN where missing.
    segments : sequence of str
        The body segment of each marker.
    partner : sequence of int
        The mirror image of each marker, or itself.
    rate : float
        Frames per second (Hz).

    Returns
    -------
    list of tuple of Site
        Of each marker.
    """
    frames = {part: part_frames(body.parts[part], placed, mm_per_unit) for part in PARTS}
    prior = NOISE**2 * MOMENT * rate
    learnt: list[tuple[Site, ...]] = []
    for marker, segment in enumerate(segments):
        pairs = [(marker, False)]
        if partner[marker] != marker:
            pairs.append((partner[marker], True))
        errors = {
            parts: sum(
                _left_out(frames, positions[:, m], _mirrored(parts) if image else parts, prior)
                for m, image in pairs
            )
            for parts in _candidates(segment)
        }
        single = min((p for p in errors if len(p) == 1), key=errors.__getitem__)
        best = min(
            (p for p in errors if errors[p] < GAIN**2 * errors[single]),
            key=errors.__getitem__,
            default=single,
        )
        learnt.append(_sites(frames, positions[:, marker], best, prior))
    return learnt


def _candidates(segment: str) -> list[tuple[str, ...]]:
    """Return parts that may carry a marker of a segment: one, or two that are neighbours.

    One of the middle of the body is carried by that alone: what a limb says of it depends too
    much on how the skeleton was fitted to the limb.
    """
    pairs = [pair for pair in NEIGHBOURS if segment in pair]
    if segment in MIDDLE:
        return [(segment,)]
    singles = dict.fromkeys((part,) for pair in pairs for part in pair)
    return [*singles, *pairs, *(pair[::-1] for pair in pairs)]


def _mirrored(parts: tuple[str, ...]) -> tuple[str, ...]:
    """Return the parts of the other side."""
    swapped = {"left_": "right_", "right_": "left_"}
    return tuple(
        next((new + p.removeprefix(old) for old, new in swapped.items() if p.startswith(old)), p)
        for p in parts
    )


def _left_out(frames: _Frames, marker: _Floats, parts: tuple[str, ...], prior: float) -> float:
    """Return the mean square error (mm²) when each half is predicted by the other."""
    seen = np.flatnonzero(~np.isnan(marker[:, 0]))
    halves = np.array_split(seen, 2)
    square = 0.0
    for here, there in (halves, halves[::-1]):
        some = {part: (frames[part][0][here], frames[part][1][here]) for part in parts}
        design, base = _design(frames, parts, there)
        missed = base + design @ _fit(some, marker[here], parts, prior) - marker[there]
        square += float((missed**2).sum())
    return square / len(seen)


def _design(
    frames: _Frames, parts: tuple[str, ...], rows: NDArray[np.intp] | slice = slice(None)
) -> tuple[_Floats, _Floats]:
    """Return by what a marker's places and weight are multiplied, and what is added to it."""
    origin = frames[parts[0]][0][rows]
    columns = [frames[parts[0]][1][rows]]
    for part in parts[1:]:
        columns += [frames[part][1][rows], (frames[part][0][rows] - origin)[:, :, None]]
    return np.concatenate(columns, axis=2), origin


def _fit(frames: _Frames, marker: _Floats, parts: tuple[str, ...], prior: float) -> _Floats:
    """Fit places and weights: least squares, where a second part must be worth its stretch."""
    seen = ~np.isnan(marker[:, 0])
    design, origin = _design(frames, parts)
    design, wanted = design[seen], marker[seen] - origin[seen]
    first = np.linalg.lstsq(design[:, :, :3].reshape(-1, 3), wanted.ravel(), rcond=None)[0]
    found = np.zeros(design.shape[2])
    found[:3] = first
    if len(parts) > 1:
        rest = (wanted - design[:, :, :3] @ first).ravel()
        flat = design.reshape(-1, design.shape[2])
        # in mm, whatever the size that a column counts in
        scale = np.sqrt((design**2).sum(axis=1).mean(axis=0))
        penalty = np.diag((scale / STRETCH) ** 2) * prior
        found += np.linalg.solve(flat.T @ flat + penalty, flat.T @ rest)
    return found


def _sites(
    frames: _Frames, marker: _Floats, parts: tuple[str, ...], prior: float
) -> tuple[Site, ...]:
    """Return where a marker sits on some parts."""
    found = _fit(frames, marker, parts, prior)
    weight = 0.0 if len(parts) == 1 else float(found[6])
    x, y, z = found[:3].tolist()
    sites = [Site(parts[0], 1.0 - weight, (x, y, z))]
    for part in parts[1:]:
        x, y, z = found[3:6].tolist()
        sites.append(Site(part, weight, (x, y, z)))
    return tuple(sites)
