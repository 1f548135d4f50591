"""Takes: the recordings that a fill may learn from, in the clip's own order of markers.

A take is a recording of the prior database, a companion of the clip that is being filled (another
recording of the same body), or that clip itself. Every one is brought into the same shape: upright,
mm, one column for each marker of the clip, NaN where the take does not have it. Positions are read
when they are asked for: a database may be larger than the memory.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from priorfill.clip import Clip
from priorfill.errors import ClipError, DatabaseCorruptError
from priorfill.geometry.axes import to_upright
from priorfill.markers.marker_set import MarkerSet, same_markers
from priorfill.signal.resample import Level, resample

if TYPE_CHECKING:
    from priorfill.database import ClipRecord, PriorDatabase

__all__ = ["Take", "own_take", "same_subject_take", "takes_from"]

COARSER_RATES = (30.0, 15.0, 7.5)
"""Hz. Resolutions of a companion beside its own: those of a database."""


Reader = Callable[[int, NDArray[np.intp]], NDArray[np.floating]]


@dataclass(frozen=True, eq=False)
class Take:
    """A recording that a fill may learn from.

    Attributes
    ----------
    name : str
        What it is called in reports.
    subject : str
        Whose motion it is; empty if unknown.
    rates : tuple of float
        Frames per second of its resolutions (Hz), finest first.
    lengths : tuple of int
        Frames of each.
    shown : ndarray of int [shape=(markers,)]
        In how many frames of the finest resolution each marker of the clip can be learnt from.
    read : callable
        Gives the positions of a resolution for some markers; see `positions`.
    own : bool
        Whether it is the clip that is being filled.
    companion : bool
        Whether it is known to be of the clip's own body, with the same markers on it.
    synthesised : bool
        Whether its markers were placed on a skeleton: about a centimetre beside where markers
        would be, and rigid where skin would move.
    """

    name: str
    subject: str
    rates: tuple[float, ...]
    lengths: tuple[int, ...]
    shown: NDArray[np.intp] = field(repr=False)
    read: Reader = field(repr=False)
    own: bool = False
    same_subject: bool = False
    virtual_markers: bool = False

    def nearest_level(self, rate: float) -> int:
        """Return the number of the resolution whose rate is nearest to ``rate`` (Hz) as a ratio."""
        return int(np.argmin(np.abs(np.log(np.array(self.rates) / rate))))

    def positions(
        self, level: int, markers: NDArray[np.intp] | None = None
    ) -> NDArray[np.floating]:
        """Return the positions of a resolution.

        Parameters
        ----------
        level : int
            Its number.
        markers : ndarray of int, optional
            Which markers of the clip; all by default.

        Returns
        -------
        ndarray [shape=(frames, markers, 3), mm]
            Upright; NaN where there is nothing to learn from.
        """
        return self.read(level, np.arange(len(self.shown)) if markers is None else markers)


def own_take(levels: Sequence[Level], name: str, subject: str) -> Take:
    """Make a take of the clip itself; its gaps stay missing.

    Parameters
    ----------
    levels : sequence of Level
        The clip's resolutions, upright, finest first.
    name, subject : str
        Of the clip.
    """
    return Take(
        name,
        subject,
        tuple(level.rate for level in levels),
        tuple(len(level.positions) for level in levels),
        (~np.isnan(levels[0].positions[..., 0])).sum(axis=0),
        lambda number, markers: levels[number].positions[:, markers],
        own=True,
    )


def same_subject_take(
    same_subject: Clip,
    labels: Sequence[str],
    marker_set: MarkerSet | None = None,
    subject: str = "",
) -> Take:
    """Make a take of another clip of the same body with the same markers on it.

    Parameters
    ----------
    companion : Clip
        At any rate, with any axis up, of any length: a static pose will do.
    labels : sequence of str
        The labels of the clip that is to be filled, in its order.
    marker_set : MarkerSet, optional
        Definition whose other spellings count too.
    subject : str
        Of the clip that is to be filled.

    Raises
    ------
    ClipError
        Where it shows none of the clip's markers.
    """
    here, there = same_markers(labels, same_subject.labels, marker_set)
    positions = np.full((same_subject.frames, len(labels), 3), np.nan)
    positions[:, here] = to_upright(same_subject.positions, same_subject.up)[:, there]
    shown = (~np.isnan(positions[..., 0])).sum(axis=0)
    if not shown.any():
        raise ClipError(
            f"{same_subject.name}: has no marker in common with the clip "
            f"({', '.join(labels[:6])}, ...); its markers are "
            f"{', '.join(same_subject.labels[:6])}, ...; give a clip of the same markers"
        )
    rates = [same_subject.rate, *(rate for rate in COARSER_RATES if rate < same_subject.rate)]
    levels = [positions, *(resample(positions, same_subject.rate, rate) for rate in rates[1:])]
    return Take(
        same_subject.name,
        subject,
        tuple(rates),
        tuple(len(level) for level in levels),
        shown,
        lambda number, markers: levels[number][:, markers],
        same_subject=True,
    )


def takes_from(
    database: PriorDatabase,
    records: Iterable[ClipRecord],
    labels: Sequence[str],
    marker_set: MarkerSet | None = None,
    *,
    trust_filled: bool = False,
    refused: Callable[[DatabaseCorruptError], None] | None = None,
    withdrawn: Callable[[str, DatabaseCorruptError], None] | None = None,
) -> tuple[Take, ...]:
    """Make a take of each clip of a database that shows at least one of a clip's markers.

    Parameters
    ----------
    database : PriorDatabase
        Opened.
    records : iterable of ClipRecord
        Which of its clips.
    labels : sequence of str
        The clip's labels, in its order.
    marker_set : MarkerSet, optional
        Definition whose other spellings count too.
    trust_filled : bool
        Learn from samples that were synthesised too, as if they were measured.
    refused : callable, optional
        Called when a clip turns out to be damaged: no more is then read of it. Without this the
        error is raised.
    withdrawn : callable, optional
        Called with the clip's content hash too, when something of it had been read already: what
        was learnt from it is not to be used, and to check all of it at once would be to read all
        resolutions of a large database. Without this, `refused` is called.

    Returns
    -------
    tuple of Take
        In the order of the records. Positions are float32.
    """
    takes = []
    known: dict[tuple[str, ...], NDArray[np.intp]] = {}  # thousands of clips share a few lists
    for record in records:
        if record.labels not in known:
            here, there = same_markers(labels, record.labels, marker_set)
            known[record.labels] = np.full(len(labels), -1, dtype=np.intp)
            known[record.labels][here] = there
        columns = known[record.labels]
        counts = np.array(record.present if trust_filled else record.measured, dtype=np.intp)
        shown = np.where(columns >= 0, counts[columns], 0)
        if not shown.any():
            continue
        takes.append(
            Take(
                record.name,
                record.subject,
                tuple(database.rate / 2**level for level in range(database.levels)),
                record.frames,
                shown,
                _reader(database, record, columns, trust_filled, refused, withdrawn),
                virtual_markers=record.virtual_markers,
            )
        )
    return tuple(takes)


def _reader(
    database: PriorDatabase,
    record: ClipRecord,
    columns: NDArray[np.intp],
    trust_filled: bool,
    refused: Callable[[DatabaseCorruptError], None] | None,
    withdrawn: Callable[[str, DatabaseCorruptError], None] | None,
) -> Reader:
    """Return what reads a clip; ``columns`` has its column of each marker, -1 where it has none."""
    filled = None
    try:
        # now, because the catalogue answers only the thread that opened it
        if record.has_filled and not trust_filled:
            filled = database.filled(record)
    except DatabaseCorruptError as error:
        if refused is None:
            raise
        refused(error)
        columns = np.full_like(columns, -1)
    given = False
    damage: DatabaseCorruptError | None = None

    def read(level: int, markers: NDArray[np.intp]) -> NDArray[np.floating]:
        nonlocal given, damage
        wanted = columns[markers]
        here = np.flatnonzero(wanted >= 0)
        stored = None
        try:
            if damage is None:
                stored = database.sound_positions(record, level)
                given = True
        except DatabaseCorruptError as error:
            if refused is None:
                raise
            damage = error
            if not given:
                refused(error)
        # another thread may have used the clip just before this one found out, or the other way
        if given and damage is not None:
            stored = None
            if withdrawn is not None:
                withdrawn(record.content, damage)
            elif refused is not None:
                refused(damage)
        if stored is not None and filled is None and len(here) == len(markers):
            return np.take(stored, wanted, axis=1)
        positions = np.full((record.frames[level], len(markers), 3), np.nan, dtype=np.float32)
        if stored is None:
            return positions
        positions[:, here] = stored[:, wanted[here]]
        if filled is not None:
            hidden = np.zeros(positions.shape[:2], dtype=bool)
            hidden[:, here] = filled[:: 2**level, wanted[here]]
            positions[hidden] = np.nan
        return positions

    return read
