"""What the catalogue says of a clip, and of the whole database."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

__all__ = ["ClipRecord", "DatabaseInfo"]


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
    rate : float
        Frames per second of level 0 in the database (Hz).
    frames : tuple of int
        Number of frames at each level.
    labels : tuple of str
        The markers, as the clip calls them.
    marker_set : str
        Name of the marker set recognised; empty if none.
    has_filled : bool
        Whether some samples were synthesised (`PriorDatabase.filled` says which).
    added : str
        When it was added, UTC, ISO 8601.
    version : str
        Version of priorfill that added it.
    synthetic : bool
        Whether the motion is computed, not recorded.
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
    rate: float
    frames: tuple[int, ...]
    labels: tuple[str, ...]
    marker_set: str
    has_filled: bool
    added: str
    version: str
    synthetic: bool
    segment: int
    offset: int
    checksums: tuple[int, ...]

    @property
    def duration(self) -> float:
        """Length in seconds."""
        return self.frames[0] / self.rate

    @property
    def nbytes(self) -> int:
        """Bytes of its positions, all levels together."""
        return sum(self.frames) * len(self.labels) * 12


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
    subjects : int
        Number of different subjects that are named.
    frames : int
        Frames at level 0, all clips together.
    seconds : float
        Length of all clips together.
    bytes : int
        Size of the database's files.
    marker_sets : dict of str to int
        Number of clips of each marker set; under the empty name those of no known set.
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
    marker_sets: dict[str, int]
