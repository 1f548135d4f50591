"""Takes: the recordings that a fill may learn from, with the markers in the clip's order.

A take is a recording of the prior database, another recording of the same subject, or the clip that
is being filled. All have the same form: upright, in mm, one column for each marker of the clip, NaN
where the take does not have it. Positions are read on demand, since a database may be larger than
the memory.
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
"""Hz. Coarser resolutions of another recording of the subject, the same as in a database."""

PositionReader = Callable[[int, NDArray[np.intp]], NDArray[np.floating]]
"""Reads a level's positions of some markers [shape=(frames, markers, 3), mm]."""


@dataclass(frozen=True, eq=False)
class Take:
    """A recording that a fill may learn from.

    Attributes
    ----------
    name : str
        Name in reports.
    subject : str
        The subject; empty if unknown.
    rates : tuple of float
        Rates of its levels, in Hz, finest first.
    lengths : tuple of int
        Number of frames of each level.
    shown : ndarray of int [shape=(markers,)]
        Number of usable frames at the finest level, for each marker of the clip.
    read : callable
        Reads the positions of a level for some markers; see `positions`.
    own : bool
        Whether it is the clip that is being filled.
    same_subject : bool
        Whether it is known to be of the clip's subject, with the markers in the same places.
    virtual_markers : bool
        Whether its markers were computed from a skeleton: they are about a centimetre off real
        ones, and do not move with the skin.
    """

    name: str
    subject: str
    rates: tuple[float, ...]
    lengths: tuple[int, ...]
    shown: NDArray[np.intp] = field(repr=False)
    read: PositionReader = field(repr=False)
    own: bool = False
    same_subject: bool = False
    virtual_markers: bool = False

    def nearest_level(self, rate: float) -> int:
        """Return the level whose rate is nearest to ``rate`` (Hz) as a ratio."""
        return int(np.argmin(np.abs(np.log(np.array(self.rates) / rate))))

    def positions(
        self, level: int, markers: NDArray[np.intp] | None = None
    ) -> NDArray[np.floating]:
        """Return the positions of a level.

        Parameters
        ----------
        level : int
            Index into ``rates``.
        markers : ndarray of int, optional
            Markers of the clip; all by default.

        Returns
        -------
        ndarray [shape=(frames, markers, 3), mm]
            Upright; NaN where missing or not usable.
        """
        return self.read(level, np.arange(len(self.shown)) if markers is None else markers)


def own_take(levels: Sequence[Level], name: str, subject: str) -> Take:
    """Return a take of the clip itself; its gaps stay missing.

    Parameters
    ----------
    levels : sequence of Level
        The clip's levels, upright, finest first.
    name, subject : str
        The clip's name and subject.
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
    other: Clip,
    labels: Sequence[str],
    marker_set: MarkerSet | None = None,
    subject: str = "",
) -> Take:
    """Return a take of another recording of the clip's subject with the same markers.

    Parameters
    ----------
    other : Clip
        The other recording, of any rate, up axis and length: a static trial is enough.
    labels : sequence of str
        Labels of the clip to be filled.
    marker_set : MarkerSet, optional
        Definition with alternative labels.
    subject : str
        Subject of the clip to be filled.

    Returns
    -------
    Take

    Raises
    ------
    ClipError
        If the recordings have no marker in common.

    See Also
    --------
    own_take : The clip itself.
    takes_from : Recordings of a database.
    """
    here, there = same_markers(labels, other.labels, marker_set)
    positions = np.full((other.frames, len(labels), 3), np.nan)
    positions[:, here] = to_upright(other.positions, other.up)[:, there]
    shown = (~np.isnan(positions[..., 0])).sum(axis=0)
    if not shown.any():
        raise ClipError(
            f"{other.name}: no marker in common with the clip "
            f"({', '.join(labels[:6])}, ...); its markers are "
            f"{', '.join(other.labels[:6])}, ...; give a clip with the same markers"
        )
    rates = [other.rate, *(rate for rate in COARSER_RATES if rate < other.rate)]
    levels = [positions, *(resample(positions, other.rate, rate) for rate in rates[1:])]
    return Take(
        other.name,
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
    on_damaged: Callable[[DatabaseCorruptError], None] | None = None,
    on_damaged_after_use: Callable[[str, DatabaseCorruptError], None] | None = None,
) -> tuple[Take, ...]:
    """Return a take of each clip of a database that shows at least one marker of the clip.

    Parameters
    ----------
    database : PriorDatabase
        An open database.
    records : iterable of ClipRecord
        The clips to use.
    labels : sequence of str
        Labels of the clip to be filled.
    marker_set : MarkerSet, optional
        Definition with alternative labels.
    trust_filled : bool
        Use filled samples as if they were measured.
    on_damaged : callable, optional
        Called when a clip turns out to be damaged before any of its data was used; all of it is
        then missing. By default the error is raised.
    on_damaged_after_use : callable, optional
        Called with the content hash if data from the clip was already used; results based on it
        must be discarded. A clip is not checked completely in advance, because that would mean
        reading all levels of a large database. By default ``on_damaged`` is called.

    Returns
    -------
    tuple of Take
        In the order of the records. Positions are float32.

    See Also
    --------
    own_take, same_subject_take : Takes of the clip itself, and of others of its subject.

    Raises
    ------
    DatabaseCorruptError
        If a clip is damaged and ``on_damaged`` is not given, here or when positions are read.
    """
    takes = []
    columns_of: dict[tuple[str, ...], NDArray[np.intp]] = {}  # many clips share a few label lists
    for record in records:
        if record.labels not in columns_of:
            here, there = same_markers(labels, record.labels, marker_set)
            columns_of[record.labels] = np.full(len(labels), -1, dtype=np.intp)
            columns_of[record.labels][here] = there
        columns = columns_of[record.labels]
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
                _DatabaseReader(
                    database, record, columns, trust_filled, on_damaged, on_damaged_after_use
                ),
                virtual_markers=record.virtual_markers,
            )
        )
    return tuple(takes)


class _DatabaseReader:
    """Reads the positions of one clip of a database, until it turns out to be damaged.

    A clip is *unused*, then *used* once positions of it were returned, and from either state
    becomes *damaged* for good; from then on everything is missing.

    Parameters
    ----------
    database, record, trust_filled, on_damaged, on_damaged_after_use
        As for `takes_from`.
    columns : ndarray of int [shape=(markers,)]
        The record's column of each marker of the clip to be filled; -1 where it has none.
    """

    def __init__(
        self,
        database: PriorDatabase,
        record: ClipRecord,
        columns: NDArray[np.intp],
        trust_filled: bool,
        on_damaged: Callable[[DatabaseCorruptError], None] | None,
        on_damaged_after_use: Callable[[str, DatabaseCorruptError], None] | None,
    ) -> None:
        self._database = database
        self._record = record
        self._columns = columns
        self._on_damaged = on_damaged
        self._on_damaged_after_use = on_damaged_after_use
        self._used = False
        self._damage: DatabaseCorruptError | None = None
        self._filled: NDArray[np.bool_] | None = None
        try:
            # read here, because the catalogue can be used only in the thread that opened it
            if record.has_filled and not trust_filled:
                self._filled = database.filled(record)
        except DatabaseCorruptError as error:
            self._set_damaged(error)

    def __call__(self, level: int, markers: NDArray[np.intp]) -> NDArray[np.floating]:
        """Return positions as `Take.positions` does."""
        stored = self._read(level)
        wanted = self._columns[markers]
        here = np.flatnonzero(wanted >= 0)
        if stored is not None and self._filled is None and len(here) == len(markers):
            return np.take(stored, wanted, axis=1)
        shape = (self._record.frames[level], len(markers), 3)
        positions = np.full(shape, np.nan, dtype=np.float32)
        if stored is None:
            return positions
        positions[:, here] = stored[:, wanted[here]]
        if self._filled is not None:
            hidden = np.zeros(positions.shape[:2], dtype=bool)
            hidden[:, here] = self._filled[:: 2**level, wanted[here]]
            positions[hidden] = np.nan
        return positions

    def _read(self, level: int) -> NDArray[np.float32] | None:
        """Return the stored positions of a level; None if the clip is damaged."""
        stored = None
        if self._damage is None:
            try:
                stored = self._database.checked_positions(self._record, level)
                self._used = True
            except DatabaseCorruptError as error:
                self._set_damaged(error)
        # another thread may have used the clip, or found it damaged, in the meantime
        if self._damage is None:
            return stored
        if self._used:
            self._report_damage_after_use(self._damage)
        return None

    def _set_damaged(self, error: DatabaseCorruptError) -> None:
        """Record the damage, and report it if no data was used."""
        if self._on_damaged is None:
            raise error
        self._damage = error
        if not self._used:
            self._on_damaged(error)

    def _report_damage_after_use(self, error: DatabaseCorruptError) -> None:
        if self._on_damaged_after_use is not None:
            self._on_damaged_after_use(self._record.content, error)
        elif self._on_damaged is not None:
            self._on_damaged(error)
