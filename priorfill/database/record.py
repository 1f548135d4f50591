"""What a database returns about a clip, and about itself."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

__all__ = ["AcceptResult", "ClipOrigin", "ClipRecord", "DatabaseInfo", "MergeResult"]


@dataclass(frozen=True)
class ClipOrigin:
    """Where a clip comes from, as stated by the user who adds it.

    Attributes
    ----------
    subject : str or None
        The person recorded; None: the clip's own subject.
    session : str
        Recording session.
    licence : str
        Terms of use.
    credit : str
        Whom to name.
    source : str or None
        Name of the source file; None: the clip's own source.
    synthetic : bool
        Whether the motion was computed, not recorded.
    virtual_markers : bool
        Whether the motion was recorded, but the markers were computed from a skeleton.

    See Also
    --------
    PriorDatabase.add, PriorDatabase.accept

    Examples
    --------
    >>> ClipOrigin(subject="anna", licence="CC0-1.0").session
    ''
    """

    subject: str | None = None
    session: str = ""
    licence: str = ""
    credit: str = ""
    source: str | None = None
    synthetic: bool = False
    virtual_markers: bool = False


@dataclass(frozen=True)
class ClipRecord:
    """A clip in a prior database.

    Attributes
    ----------
    content : str
        SHA-256 of the labels, rate and positions that were added. It identifies the clip.
    name : str
        Name of the clip.
    subject : str
        The person recorded; empty if unknown.
    session : str
        Recording session; empty if unknown.
    source : str
        Name of the file it was read from, without its folder; empty for a clip made in memory.
    licence : str
        Terms of use; empty if not given.
    credit : str
        Whom to name; empty if not given.
    original_rate : float
        Frames per second of the recording (Hz).
    original_frames : int
        Number of frames of the recording.
    rate : float
        Frames per second of level 0 in the database (Hz).
    frames : tuple of int
        Number of frames at each level.
    labels : tuple of str
        The markers, as the clip labels them.
    marker_set : str
        Name of the recognised marker set; empty if none.
    filled_by : str
        Method that filled samples (`PriorDatabase.filled` returns which); empty if all were
        measured.
    present, measured : tuple of int
        For each marker, the number of frames of level 0 with a position, and with a measured one.
    added : str
        Time of adding, UTC, ISO 8601.
    version : str
        Version of priorfill that added it.
    synthetic : bool
        Whether the motion was computed, not recorded.
    virtual_markers : bool
        Whether the motion was recorded, but the markers were computed from a skeleton.
    segment : int
        Number of the segment file that holds its positions.
    offset : int
        Position of its first byte in that file; its levels follow each other.
    checksums : tuple of int
        CRC-32 of the bytes of each level.
    """

    content: str
    name: str
    subject: str
    session: str
    source: str
    licence: str
    credit: str
    original_rate: float
    original_frames: int
    rate: float
    frames: tuple[int, ...]
    labels: tuple[str, ...]
    marker_set: str
    filled_by: str
    present: tuple[int, ...]
    measured: tuple[int, ...]
    added: str
    version: str
    synthetic: bool
    virtual_markers: bool
    segment: int
    offset: int
    checksums: tuple[int, ...]

    @property
    def duration(self) -> float:
        """Length in seconds."""
        return self.frames[0] / self.rate

    @property
    def nbytes(self) -> int:
        """Bytes of its positions at all levels."""
        return sum(self.frames) * len(self.labels) * 12

    @property
    def has_filled(self) -> bool:
        """Whether some samples were filled."""
        return bool(self.filled_by)


@dataclass(frozen=True)
class AcceptResult:
    """The result of `PriorDatabase.accept`.

    Attributes
    ----------
    record : ClipRecord
        The new clip.
    replaced : tuple of ClipRecord
        The versions of the recording that it replaced.
    """

    record: ClipRecord
    replaced: tuple[ClipRecord, ...] = ()


@dataclass(frozen=True)
class MergeResult:
    """The result of `PriorDatabase.merge`.

    Attributes
    ----------
    added : tuple of ClipRecord
        The new clips.
    skipped : tuple of ClipRecord
        Clips of the other database that this one has in some version.
    damaged : tuple of str
        One message for each clip that is damaged in the other database and was not added.
    """

    added: tuple[ClipRecord, ...]
    skipped: tuple[ClipRecord, ...]
    damaged: tuple[str, ...] = ()


@dataclass(frozen=True)
class DatabaseInfo:
    """Figures of a prior database.

    Attributes
    ----------
    path : Path
        The directory.
    version : int
        Format version.
    rate : float
        Frames per second of level 0 (Hz).
    levels : int
        Number of levels, each at half the rate of the previous one.
    clips : int
        Number of clips.
    synthetic : int
        Number of clips whose motion was computed.
    virtual_markers : int
        Number of clips whose markers were computed from a skeleton.
    subjects : int
        Number of different subjects named.
    frames : int
        Total number of frames at level 0.
    seconds : float
        Total length.
    bytes : int
        Size of the files.
    removed_bytes : int
        Bytes that compacting would free.
    leftover_bytes : int
        Bytes that wait to be removed: replaced by a compaction while Windows refused to remove
        them, because a process had them open, or left by a writer that was killed. The next writer
        removes them.
    marker_sets : dict of str to int
        Number of clips by marker set; the empty name counts those of no known set.
    licences, credits : dict of str to int
        Number of clips by licence and by credit; the empty text counts those without.
    """

    path: Path
    version: int
    rate: float
    levels: int
    clips: int
    synthetic: int
    virtual_markers: int
    subjects: int
    frames: int
    seconds: float
    bytes: int
    removed_bytes: int
    leftover_bytes: int
    marker_sets: dict[str, int]
    licences: dict[str, int]
    credits: dict[str, int]
