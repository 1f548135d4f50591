"""Pieces of a marker's path that are not the marker: spikes, phantoms, wrong labels.

A path is cut into pieces where it breaks and where the marker is missing. Short pieces that breaks
set off are spikes, if the path goes on after them where it was. Long ones are judged by how far the
marker is from its partners, compared with the main piece, whose distances most of the path keeps;
and of the two sides of a break, the one whose distances are more unusual is the wrong one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from priorfill.artefacts.reference_markers import distances
from priorfill.gaps import runs

__all__ = ["OutlierRun", "outlier_runs"]

SHORT = 0.1
"""s. A piece that breaks set off and that is not longer is a spike: no body has been anywhere so
briefly."""

LEAST_LONG = 25.0
"""mm. Longer pieces are set off by steps of this size and more: some cameras place a marker by a
centimetre or two off for a while as others lose it, which is no other marker."""

FIRM = 4.0
"""mm. Distances that vary by less are taken to vary by this: noise and soft tissue do so."""

OFF = 3.0
"""Times its spread a distance must be off, beside a break."""

OFF_GAP = 6.0
"""The same where a gap, not a break, sets a piece off: a posture may have changed meanwhile."""

FAR_GAP = 40.0
"""mm by which it must be off there, at least."""

MAIN_GAP = 1.0
"""s. The main piece must be so long there, to know how much distances vary."""

KINK = 8.0
"""mm. A spike of one frame is missed by so much, seen from the partners, by the straight lines that
lead to it. No hit turns a path by `LEAST_LONG` and more in a frame."""

TIP = 4.0
"""Times its spread, and that in the frames beside it, a distance must be off in a spike after which
the path does not go on where it was: so it is in the hand of a boxer."""

WRONG_SIDE = 1.5
"""Times as unusual as on the other side of a break must a distance be on the wrong one."""

WITNESSES = 2
"""Partners that must say so, one where there is no other: one may be in trouble itself."""

RIGID = 2.0
"""mm. Distances that vary by less are of one bone, or a bar: they tell where trouble begins and
ends."""

CANDIDATES = 4
"""The longest pieces, of which one is the main piece."""

TOLD = 2.0
"""Times its spread a distance must be off to be given as evidence."""

SAMPLES = 500
"""Frames that a median is taken of."""

MAD = 1.4826
"""Median absolute deviation to standard deviation, for normal errors."""


@dataclass(frozen=True)
class OutlierRun:
    """A stretch of a marker's path that is elsewhere than the marker.

    Attributes
    ----------
    marker, start, stop : int
        The marker, and frames ``start <= frame < stop``.
    short : bool
        Whether it is a spike.
    size : float
        mm by which the path breaks there.
    judge : int
        The partner whose distance is most unusual; the marker itself where there is none.
    distance, usual, spread : float
        mm. The distance to it there, its median elsewhere, and how much that varies; NaN if
        unknown.
    """

    marker: int
    start: int
    stop: int
    short: bool
    size: float
    judge: int
    distance: float
    usual: float
    spread: float


@dataclass(frozen=True)
class _Piece:
    """Frames ``start <= frame < stop``; mm of the breaks before and after them, 0: no break."""

    start: int
    stop: int
    before: float
    after: float

    @property
    def frames(self) -> int:
        return self.stop - self.start

    @property
    def broken(self) -> bool:
        return self.before > 0 or self.after > 0


def outlier_runs(
    positions: NDArray[np.float64],
    marker: int,
    others: NDArray[np.intp],
    size: NDArray[np.float64],
    far: NDArray[np.bool_] | None,
    rate: float,
) -> list[OutlierRun]:
    """Return the pieces of a marker's path that are elsewhere than the marker.

    Parameters
    ----------
    positions : ndarray [shape=(frames, markers, 3), mm]
        NaN where missing.
    marker : int
        The marker.
    others : ndarray of int [shape=(partners,)]
        Its partners.
    size : ndarray [shape=(frames - 1,), mm]
        Of the breaks of its path, 0 where there is none.
    far : ndarray of bool [shape=(frames,)] or None
        Where it is too far away from its partners.
    rate : float
        Hz.
    """
    seen = ~np.isnan(positions[:, marker, 0])
    pieces = _pieces(seen, size)
    if len(pieces) < 2 and far is None:
        return []
    length = distances(positions, marker, others)
    briefly = max(1, round(SHORT * rate))
    strays = _spikes(positions, marker, others, length, pieces, briefly)
    # a path goes on across a spike, and across steps too small for another marker
    taken = np.zeros(len(positions), dtype=bool)
    lasting = np.where(size >= LEAST_LONG, size, 0.0)
    for start, stop, _ in strays:
        taken[start:stop] = True
        lasting[max(start - 1, 0) : stop] = 0.0
    strays += _long_strays(
        _pieces(seen, lasting), np.where(taken[:, None], np.nan, length), briefly, rate
    )
    if far is not None:
        strays += [(start, stop, stop - start <= briefly) for start, stop in runs(far)]
    strays = _joined(sorted(strays))
    for start, stop, _ in strays:
        taken[start:stop] = True
    usual, spread = _usual(length[~taken], least=0.0)
    rigid = spread < RIGID
    ratio = np.nan_to_num(np.abs(length[:, rigid] - usual[rigid]) / FIRM)
    strays = _joined(
        sorted(
            (*_grown(ratio, taken, start, stop, briefly), short) for start, stop, short in strays
        )
    )
    return [
        _stray(marker, others, length, usual, spread, start, stop, short, size)
        for start, stop, short in strays
    ]


def _pieces(seen: NDArray[np.bool_], size: NDArray[np.float64]) -> list[_Piece]:
    """Cut a path where it breaks and where the marker is missing."""
    pieces = []
    for start, stop in runs(seen):
        cuts = start + np.flatnonzero(size[start : stop - 1])
        at = [start, *(cuts + 1).tolist(), stop]
        step = [0.0, *size[cuts].tolist(), 0.0]
        pieces += [_Piece(a, b, step[i], step[i + 1]) for i, (a, b) in enumerate(pairwise(at))]
    return pieces


def _spikes(
    positions: NDArray[np.float64],
    marker: int,
    others: NDArray[np.intp],
    length: NDArray[np.float64],
    pieces: list[_Piece],
    briefly: int,
) -> list[tuple[int, int, bool]]:
    """Return short pieces that breaks set off, those that touch as one."""
    spikes = []
    usual, spread = _usual(length)
    start = -1
    for i, piece in enumerate(pieces):
        if piece.frames > briefly or not piece.broken:
            continue
        if start < 0:
            start = piece.start
            free, step = not piece.before, 0.0
        step = max(step, piece.before, piece.after)
        if piece.after and pieces[i + 1].frames <= briefly:
            continue
        free |= not piece.after
        # a small step with an open end may be the turn of a hit
        sudden = step >= LEAST_LONG or (
            not free and (piece.stop - start > 1 or _is_no_kink(positions, marker, others, start))
        )
        if sudden and (
            free
            or _returns(positions, marker, others, start, piece.stop)
            or _unlike(length, usual, spread, start, piece.stop)
        ):
            spikes.append((start, piece.stop, True))
        start = -1
    return spikes


def _is_no_kink(
    positions: NDArray[np.float64], marker: int, others: NDArray[np.intp], frame: int
) -> bool:
    """Return whether neither the path before a frame nor the one after leads to it.

    Where a path turns from one frame to the next, as in a hit, both lead to the frame between.
    """
    for near, far in ((frame - 1, frame - 2), (frame + 1, frame + 2)):
        if far < 0 or far >= len(positions):
            continue
        part = positions[[frame, near, far]]
        seen = others[np.isfinite(part[:, others]).all(axis=(0, 2))]
        path = part[:, marker] - (part[:, seen].mean(axis=1) if len(seen) else 0.0)
        if np.linalg.norm(path[0] - 2.0 * path[1] + path[2]) < KINK:
            return False
    return True


def _returns(
    positions: NDArray[np.float64], marker: int, others: NDArray[np.intp], start: int, stop: int
) -> bool:
    """Return whether a path goes on after some frames where it was, seen from its partners."""
    part = positions[start - 1 : stop + 1]
    seen = others[np.isfinite(part[:, others]).all(axis=(0, 2))]
    path = part[:, marker] - (part[:, seen].mean(axis=1) if len(seen) else 0.0)
    share = np.linspace(0.0, 1.0, len(path))[:, None]
    off = np.linalg.norm(path - (1 - share) * path[0] - share * path[-1], axis=1)
    return bool(off.max() > np.linalg.norm(path[-1] - path[0]))


def _unlike(
    length: NDArray[np.float64],
    usual: NDArray[np.float64],
    spread: NDArray[np.float64],
    start: int,
    stop: int,
) -> bool:
    """Return whether a distance is unusual in some frames, but neither before nor after them."""
    off = np.nan_to_num(np.abs(length[start - 1 : stop + 1] - usual))
    inside = off[1:-1].max(axis=0)
    return bool(((inside > TIP * spread) & (inside > TIP * np.maximum(off[0], off[-1]))).any())


def _long_strays(
    pieces: list[_Piece], length: NDArray[np.float64], briefly: int, rate: float
) -> list[tuple[int, int, bool]]:
    """Return pieces whose distances are off, and short ones that touch them."""
    long = [piece for piece in pieces if piece.frames > briefly]
    if len(long) < 2:
        return []
    main, usual, spread = _main(long, length)
    strays = []
    for piece in pieces:
        if piece is main:
            continue
        off = np.abs(_some(length[piece.start : piece.stop]) - usual)
        ratio, far = _witnessed(off, spread)
        if piece.broken:
            wrong = ratio > OFF and all(
                _wrong_side(length, frame, way, briefly, usual, spread)
                for step, frame, way in (
                    (piece.before, piece.start, 1),
                    (piece.after, piece.stop, -1),
                )
                if step
            )
        else:
            wrong = ratio > OFF_GAP and far > FAR_GAP and main.frames > MAIN_GAP * rate
        if wrong:
            strays.append((piece.start, piece.stop, piece.frames <= briefly))
    return strays


def _wrong_side(
    length: NDArray[np.float64],
    frame: int,
    way: int,
    briefly: int,
    usual: NDArray[np.float64],
    spread: NDArray[np.float64],
) -> bool:
    """Return whether distances after a break (way 1) or before it (-1) are the more unusual."""
    sides = slice(frame, frame + briefly), slice(max(frame - briefly, 0), frame)
    inside, outside = (_medians(np.abs(length[side] - usual)) / spread for side in sides[::way])
    known = ~np.isnan(inside) & ~np.isnan(outside)
    says_so = int((known & (2 * inside > OFF) & (inside > WRONG_SIDE * outside)).sum())
    says_no = int((known & (2 * outside > OFF) & (outside > WRONG_SIDE * inside)).sum())
    return says_so >= max(1, min(WITNESSES, int(known.sum())), says_no)


def _main(
    pieces: list[_Piece], length: NDArray[np.float64]
) -> tuple[_Piece, NDArray[np.float64], NDArray[np.float64]]:
    """Return the piece whose distances most of the path keeps best, and what is usual in it.

    Its own distances count too: a phantom's vary so much that all others would agree with it.
    """
    best: tuple[_Piece, NDArray[np.float64], NDArray[np.float64]] | None = None
    least = np.inf
    for main in sorted(pieces, key=lambda piece: -piece.frames)[:CANDIDATES]:
        usual, spread = _usual(length[main.start : main.stop])
        cost = 0.0
        for piece in pieces:
            off = _medians(np.abs(_some(length[piece.start : piece.stop]) - usual))
            known = off[~np.isnan(off)]
            cost += piece.frames * (float(known.mean()) if len(known) else 0.0)
        if best is None or cost < least:
            best, least = (main, usual, spread), cost
    assert best is not None
    return best


def _some(length: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return distances in some frames, spread evenly: medians gain nothing from more."""
    return length[:: max(1, -(-len(length) // SAMPLES))]


def _usual(
    length: NDArray[np.float64], least: float = FIRM
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the median of each distance, and by how much it varies, at least so many mm."""
    some = _some(length)
    usual = _medians(some)
    return usual, np.fmax(least, MAD * _medians(np.abs(some - usual)))


def _witnessed(off: NDArray[np.float64], spread: NDArray[np.float64]) -> tuple[float, float]:
    """Return by how much distances are off, in spreads and mm, as enough partners say."""
    far = _medians(off)
    ratio = far / spread
    known = np.flatnonzero(~np.isnan(ratio))
    if not len(known):
        return 0.0, 0.0
    order = known[np.argsort(-ratio[known])]
    witness = order[min(WITNESSES, len(order)) - 1]
    return float(ratio[witness]), float(far[witness])


def _medians(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the median of each column's known values; NaN where there is none."""
    if not len(values):
        return np.full(values.shape[1], np.nan)
    ordered = np.sort(values, axis=0)  # NaN last
    count = (~np.isnan(ordered)).sum(axis=0)
    column = np.arange(values.shape[1])
    low = ordered[np.maximum(count - 1, 0) // 2, column]
    high = ordered[np.minimum(count // 2, len(values) - 1), column]
    return np.where(count > 0, 0.5 * (low + high), np.nan)


def _joined(strays: Sequence[tuple[int, int, bool]]) -> list[tuple[int, int, bool]]:
    """Join stretches that touch."""
    joined: list[tuple[int, int, bool]] = []
    for start, stop, short in strays:
        if joined and joined[-1][1] >= start:
            first, last, brief = joined[-1]
            joined[-1] = (first, max(last, stop), brief and short)
        else:
            joined.append((start, stop, short))
    return joined


def _grown(
    ratio: NDArray[np.float64], taken: NDArray[np.bool_], start: int, stop: int, briefly: int
) -> tuple[int, int]:
    """Return a stretch with the frames beside it in which a distance goes off and comes back.

    Only where that is over soon: else it is a posture.
    """
    if not ratio.shape[1]:
        return start, stop
    off = (ratio[:, ratio[start:stop].max(axis=0).argmax()] > TIP) & ~taken
    earlier, later = off[max(start - briefly, 0) : start][::-1], off[stop : stop + briefly]
    before, after = (0 if beside.all() else int(beside.argmin()) for beside in (earlier, later))
    return start - before, stop + after


def _stray(
    marker: int,
    others: NDArray[np.intp],
    length: NDArray[np.float64],
    usual: NDArray[np.float64],
    spread: NDArray[np.float64],
    start: int,
    stop: int,
    short: bool,
    size: NDArray[np.float64],
) -> OutlierRun:
    """Say by which distance a stretch is most unusual."""
    step = float(size[max(start - 1, 0) : stop].max(initial=0.0))
    off = np.abs(length[start:stop] - usual)
    ratio = np.nan_to_num(off / np.fmax(FIRM, spread))
    unknown = OutlierRun(marker, start, stop, short, step, marker, *(float("nan"),) * 3)
    if not (ratio > TOLD).any():
        return unknown
    # of a spike its tip, of a longer stretch what it is like for most of it
    judge = int((ratio.max(axis=0) if short else _medians(ratio)).argmax())
    here = length[start:stop, judge]
    distance = here[ratio[:, judge].argmax()] if short else _medians(here[:, None])[0]
    return OutlierRun(
        marker,
        start,
        stop,
        short,
        step,
        int(others[judge]),
        float(distance),
        float(usual[judge]),
        float(spread[judge]),
    )
