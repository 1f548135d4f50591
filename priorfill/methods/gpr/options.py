"""GPROptions of the method ``prior``."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["GPROptions"]


@dataclass(frozen=True)
class GPROptions:
    """GPROptions of the predictions.

    Attributes
    ----------
    rows : int
        Poses learnt from: evenly spread ones, and all right beside the gap. More gain nothing.
    beside : float
        s; what "right beside the gap" is.
    mirrored_rows : int
        As many of these come from the clip's mirror image in the lessons that it is part of.
    shared_rows : tuple of int
        In the lessons that the database adds to: rows of the clip, of its mirror image, of the
        database near the gap, of the database near the clip's rows. About as many as in a lesson
        without the database, so that its lessons take no longer.
    fewest_rows : int
        With fewer poses of its own, a clip learns from other recordings alone.
    wished_rows : int
        Far visible markers are given up until this many frames, or half of those that show
        the missing markers, show the visible ones too.
    rereading : float
        A piece is predicted a second time, its rows completed with the first fill, when the
        first time used less than this part of the frames in which its markers are seen.
    queries, neighbours, visible : int
        Database rows are the ``neighbours`` nearest poses of up to ``queries`` frames by the
        ``visible`` nearest markers.
    movements : int
        Stretches of the database that a blackout is learnt from.
    """

    rows: int = 250
    mirrored_rows: int = 90
    shared_rows: tuple[int, int, int, int] = (60, 30, 120, 60)
    beside: float = 0.03
    fewest_rows: int = 12
    wished_rows: int = 150
    rereading: float = 0.7
    queries: int = 100
    neighbours: int = 12
    visible: int = 12
    movements: int = 60
