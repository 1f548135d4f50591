"""What the catalogue says of a clip, and of the whole database."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

__all__ = ["Accepted", "ClipRecord", "DatabaseInfo", "Merged"]


@dataclass(frozen=True)
class ClipRecord:
    """A clip in a prior database.

    Attributes
    ----------
    content : str
        SHA-256 of labels, rate and positions as they were read: the clip's identity.
    name : str
        What the clip is called.
    subject : str
        Whose motion it is; empty if unknown.
    session : str
        Recording session; empty if unknown.
    source : str
        Name of the file it was read from, without its folder; empty for a clip made in memory.
    licence : str
        Under which terms it may be used; empty if not given.
    credit : str
        Whom to name; empty if not given.
    original_rate : float
        Frames per second of the recording (Hz).
    original_frames : int
        Frames of the recording; 0 where format version 1 did not keep it.
    rate : float
        Frames per second of level 0 in the database (Hz).
    frames : tuple of int
        Number of frames at each level.
    labels : tuple of str
        The markers, as the clip calls them.
    marker_set : str
        Name of the marker set recognised; empty if none.
    filled_by : str
        What synthesised samples, where some were (`PriorDatabase.filled` says which); empty
        where all were measured.
    present, measured : tuple of int
        In how many frames of level 0 each marker has a position, and a measured one.
    added : str
        When it was added, UTC, ISO 8601.
    version : str
        Version of priorfill that added it.
    synthetic : bool
        Whether the motion is computed, not recorded.
    synthesised : bool
        Whether the motion was recorded, but the markers were placed on a skeleton.
    segment : int
        Number of the segment file that holds its positions.
    offset : int
        Where they begin in it, in bytes; the levels follow each other.
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
    segment: int
    offset: int
    checksums: tuple[int, ...]
    virtual_markers: bool = False

    @property
    def duration(self) -> float:
        """Length in seconds."""
        return self.frames[0] / self.rate

    @property
    def nbytes(self) -> int:
        """Bytes of its positions, all levels together."""
        return sum(self.frames) * len(self.labels) * 12

    @property
    def has_filled(self) -> bool:
        """Whether some samples were synthesised."""
        return bool(self.filled_by)


@dataclass(frozen=True)
class Accepted:
    """What became of a filled clip: its row, and the rows that it replaced."""

    record: ClipRecord
    replaced: tuple[ClipRecord, ...] = ()


@dataclass(frozen=True)
class Merged:
    """What became of another database's clips.

    Attributes
    ----------
    added : tuple of ClipRecord
        The new rows.
    skipped : tuple of ClipRecord
        Clips of the other database of which this one has a version.
    damaged : tuple of str
        What is damaged in the other database and was left there, a sentence a clip.
    """

    added: tuple[ClipRecord, ...]
    skipped: tuple[ClipRecord, ...]
    damaged: tuple[str, ...] = ()


@dataclass(frozen=True)
class DatabaseInfo:
    """A prior database in figures.

    Attributes
    ----------
    path : Path
        The directory.
    version : int
        Its format version.
    rate : float
        Frames per second of level 0 (Hz).
    levels : int
        Number of resolutions, each at half the rate of the one before.
    clips : int
        Number of clips.
    synthetic : int
        How many of them are computed, not recorded.
    synthesised : int
        How many have markers that were placed on a skeleton.
    subjects : int
        Number of different subjects that are named.
    frames : int
        Frames at level 0, all clips together.
    seconds : float
        Length of all clips together.
    bytes : int
        Size of the database's files.
    removed_bytes : int
        How many of them compacting would give back.
    marker_sets : dict of str to int
        Number of clips of each marker set; under the empty name those of no known set.
    licences, credits : dict of str to int
        Number of clips of each licence, and of each credit; under the empty text those of none.
    """

    path: Path
    version: int
    rate: float
    levels: int
    clips: int
    synthetic: int
    subjects: int
    frames: int
    seconds: float
    bytes: int
    removed_bytes: int
    marker_sets: dict[str, int]
    licences: dict[str, int]
    credits: dict[str, int]
    virtual_markers: int = 0
