"""Provenance: what a result was computed from and how, enough to compute it again."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from priorfill.clip import Clip
from priorfill.database.content_hash import content_hash
from priorfill.database.manifest import read_manifest
from priorfill.database.selection import Selection
from priorfill.errors import FormatError, MarkerSetError
from priorfill.filling.fill_options import FillOptions
from priorfill.filling.gap_filter import GapFilter
from priorfill.filling.overrides import GapOverride, MadeFor, Overrides
from priorfill.filling.plausibility_options import PlausibilityOptions
from priorfill.markers.definitions import load
from priorfill.markers.marker_set import MarkerSet
from priorfill.runtime.field_types import check_field_types
from priorfill.runtime.option_texts import Duration

if TYPE_CHECKING:
    from priorfill.database import ClipRecord, PriorDatabase

__all__ = [
    "ClipIdentity",
    "DatabaseState",
    "Provenance",
    "SourceClip",
    "database_state",
    "identify",
    "marker_set_content",
    "merge_provenance",
    "package_versions",
    "source_clips",
]

PACKAGES = ("priorfill", "numpy", "scipy", "numba")
"""Packages whose version results can depend on."""


@dataclass(frozen=True)
class ClipIdentity:
    """Which recording a clip is.

    Attributes
    ----------
    name, subject : str
        Of the clip.
    file : str
        Name of its file, without the folder; empty for a clip made in memory.
    sha256 : str
        Hash of the file's bytes; empty likewise.
    content : str
        Hash of labels, rate and positions, as prior databases use it.
    """

    name: str
    subject: str
    file: str
    sha256: str
    content: str


@dataclass(frozen=True)
class SourceClip:
    """A clip of a prior database that was learnt from, with its terms of use.

    Attributes
    ----------
    name, subject : str
        As in the database.
    content : str
        Content hash: the clip's identity in the database.
    licence, credit : str
        As in the database; empty where it has none.
    """

    name: str
    subject: str
    content: str
    licence: str = ""
    credit: str = ""


@dataclass(frozen=True)
class DatabaseState:
    """A prior database as it was when a fill read it.

    Attributes
    ----------
    path : str
        Its folder.
    version : int
        Version of its format.
    rate : float
        Frame rate of its finest level (Hz).
    levels : int
        Number of levels.
    clips : int
        Number of clips.
    content : str
        Hash of the clips' content hashes and numbers of measured samples. It does not depend on
        the path, nor on the order in which clips were added.
    """

    path: str
    version: int
    rate: float
    levels: int
    clips: int
    content: str


@dataclass(frozen=True)
class Provenance:
    """What a result was computed from, and how.

    Attributes
    ----------
    versions : mapping of str to str
        Versions of Python and of the packages that results can depend on.
    method : str
        The method for gaps without an override.
    options : mapping of str to object
        Its options that differ from the defaults, by dotted name.
    clips : tuple of ClipIdentity
        The clips that were filled: one, or one for each subject of a file.
    same_subject : tuple of ClipIdentity
        Other recordings of the same subjects.
    database : DatabaseState or None
        The prior database.
    source_clips : tuple of SourceClip
        Clips of the database named by `FilledGap.source_clips`.
    selection : Selection
        Which clips of the database might be learnt from.
    trust_filled : bool
        Whether filled samples of the database were learnt from.
    marker_set : str or None
        Name of the marker set if one was given; None: recognised, or found from the data.
    gap_filter : GapFilter
        Which gaps were to be filled.
    overrides : Overrides or None
        What was to be done with single gaps.
    reject_artefacts : bool
        Whether artefacts were treated as missing.
    reading : mapping of str to object
        How the file was read, as keyword arguments of `priorfill.read`; empty for clips.
    marker_set_content : str or None
        Hash of the definition of that marker set.
    extrapolate, max_error, estimate_errors
        As in `FillOptions`.
    plausibility : mapping of str to object
        Limits of the check of fills that differ from the defaults.

    See Also
    --------
    priorfill.fill : Fill the gaps of a clip; its result has a provenance.

    Examples
    --------
    >>> import priorfill as pf
    >>> from priorfill.synthetic.demo import make_demo_clip
    >>> clip = make_demo_clip()[1]
    >>> provenance = pf.fill(clip, method="linear").provenance
    >>> provenance.method, provenance.clips[0].name
    ('linear', 'synthetic_demo')
    >>> again = pf.fill(clip, **provenance.fill_arguments())
    >>> again.provenance == Provenance.from_dict(provenance.to_dict())
    True
    """

    versions: Mapping[str, str]
    method: str
    options: Mapping[str, Any] = field(default_factory=dict)
    clips: tuple[ClipIdentity, ...] = ()
    same_subject: tuple[ClipIdentity, ...] = ()
    database: DatabaseState | None = None
    source_clips: tuple[SourceClip, ...] = ()
    selection: Selection = field(default_factory=Selection)
    trust_filled: bool = False
    marker_set: str | None = None
    gap_filter: GapFilter = field(default_factory=GapFilter)
    overrides: Overrides | None = None
    reject_artefacts: bool = False
    reading: Mapping[str, Any] = field(default_factory=dict)
    marker_set_content: str | None = None
    extrapolate: Duration = 0.0
    max_error: float | None = None
    estimate_errors: bool = True
    plausibility: Mapping[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        from priorfill.report.result_text import provenance_line

        return provenance_line(self)

    @property
    def made_for(self) -> MadeFor:
        """What overrides are made for that decide on the gaps of this fill."""
        clip, database = self.clips[0], self.database
        name = clip.file or clip.name
        return MadeFor(
            # bytes of a name that are no UTF-8 as escape sequences: TOML cannot hold them
            name.encode("utf-8", "backslashreplace").decode("utf-8"),
            clip.sha256,
            self.method,
            "" if database is None else database.content,
        )

    def fill_arguments(self, marker_set: MarkerSet | None = None) -> dict[str, Any]:
        """Return the keyword arguments of `priorfill.fill` that give the same result again.

        The clips themselves, and those of `same_subject`, have to be read again. Results are the
        same bit for bit with the same `versions`, clips and state of the database.

        Parameters
        ----------
        marker_set : MarkerSet, optional
            The marker set that was given, if it is not found by its name.

        Raises
        ------
        MarkerSetError
            Where the marker set is not found, or its definition is another.
        """
        if marker_set is None and self.marker_set is not None:
            marker_set = load(self.marker_set)
        if self.marker_set_content not in (None, marker_set_content(marker_set)):
            raise MarkerSetError(
                f"marker set {self.marker_set} differs from that of the fill; give the one of the "
                "fill as marker_set"
            )
        return {
            "database": None if self.database is None else self.database.path,
            "method": self.method,
            "gap_filter": self.gap_filter,
            "overrides": self.overrides,
            "reject_artefacts": self.reject_artefacts,
            "options": FillOptions(
                method_options=self.options,
                selection=self.selection,
                trust_filled=self.trust_filled,
                marker_set=marker_set,
                extrapolate=self.extrapolate,
                max_error=self.max_error,
                estimate_errors=self.estimate_errors,
                plausibility=PlausibilityOptions.from_json(self.plausibility),
            ),
        }

    def to_dict(self) -> dict[str, Any]:
        """Return the provenance as numbers, strings, lists and dictionaries, for JSON."""
        content = {one.name: _plain(getattr(self, one.name)) for one in fields(self)}
        content["gap_filter"].pop("strict")
        if self.overrides is not None:
            content["overrides"].pop("strict")
        return content

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Provenance:
        """Return the provenance that `to_dict` described.

        Parameters
        ----------
        content : mapping
            As from `to_dict`, or read from JSON.

        Raises
        ------
        FormatError
            If it is not the content of a provenance, or that of another version.
        """
        try:
            provenance = cls._from_plain(content)
            check_field_types(provenance)
            PlausibilityOptions.from_json(provenance.plausibility)
            if not provenance.clips:
                raise ValueError("it names no clip")
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            reason = f"it lacks {error}" if isinstance(error, KeyError) else str(error)
            raise FormatError(
                f"the provenance cannot be used ({reason}); give one that `to_dict` returned"
            ) from None
        return provenance

    @classmethod
    def _from_plain(cls, content: Mapping[str, Any]) -> Provenance:
        """Return the provenance of a dictionary, with fields of unchecked types."""
        given = dict(content)
        database, overrides = given["database"], given["overrides"]
        given |= {
            "options": {name: _frozen(value) for name, value in given["options"].items()},
            "clips": tuple(ClipIdentity(**one) for one in given["clips"]),
            "same_subject": tuple(ClipIdentity(**one) for one in given["same_subject"]),
            "database": None if database is None else DatabaseState(**database),
            "source_clips": tuple(SourceClip(**one) for one in given["source_clips"]),
            "selection": Selection(**_tuples(given["selection"])),
            "gap_filter": GapFilter(**_tuples(given["gap_filter"])),
        }
        if overrides is not None:
            path, made_for = overrides["path"], overrides.get("made_for")
            given["overrides"] = Overrides(
                tuple(GapOverride(**_tuples(entry)) for entry in overrides["entries"]),
                None if path is None else Path(path),
                made_for=None if made_for is None else MadeFor(**made_for),
            )
        return cls(**given)


def identify(clip: Clip) -> ClipIdentity:
    """Return which recording a clip is.

    Parameters
    ----------
    clip : Clip
        The clip as it was read, before anything is treated as missing.
    """
    source = clip.source
    return ClipIdentity(
        clip.name,
        clip.subject,
        "" if source is None else source.path.name,
        "" if source is None else source.sha256,
        content_hash(clip),
    )


def database_state(database: PriorDatabase) -> DatabaseState:
    """Return the state of an open database.

    Parameters
    ----------
    database : PriorDatabase
        The database.
    """
    digest = hashlib.sha256()
    records = database.clips()
    for record in sorted(records, key=lambda record: record.content):
        digest.update(f"{record.content} {sum(record.measured)}\n".encode())
    return DatabaseState(
        str(database.path),
        read_manifest(database.path).version,
        database.rate,
        database.levels,
        len(records),
        digest.hexdigest(),
    )


def source_clips(records: Iterable[ClipRecord], names: Iterable[str]) -> tuple[SourceClip, ...]:
    """Return the clips of a database that have one of some names.

    Parameters
    ----------
    records : iterable of ClipRecord
        The clips that could be learnt from.
    names : iterable of str
        Names of those that were.
    """
    wanted = set(names)
    return tuple(
        SourceClip(record.name, record.subject, record.content, record.licence, record.credit)
        for record in records
        if record.name in wanted
    )


def marker_set_content(marker_set: MarkerSet | None) -> str | None:
    """Return a hash of the definition of a marker set, without title and source.

    Parameters
    ----------
    marker_set : MarkerSet or None
        The set; None has no hash.
    """
    if marker_set is None:
        return None
    content = asdict(replace(marker_set, title="", source=""))
    content["optional"] = sorted(marker_set.optional)
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def merge_provenance(parts: Sequence[Provenance]) -> Provenance:
    """Return the provenance of a result merged from those of several subjects.

    Parameters
    ----------
    parts : sequence of Provenance
        They differ in clips only.
    """
    return replace(
        parts[0],
        clips=tuple(clip for part in parts for clip in part.clips),
        same_subject=tuple(clip for part in parts for clip in part.same_subject),
        source_clips=tuple(dict.fromkeys(clip for part in parts for clip in part.source_clips)),
    )


@lru_cache(maxsize=1)
def package_versions() -> Mapping[str, str]:
    """Return the versions of Python and of the packages that results can depend on."""
    versions = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = ""
    return MappingProxyType(versions)


def _plain(value: Any) -> Any:
    """Return a value as JSON can hold it."""
    if hasattr(value, "__dataclass_fields__"):
        value = asdict(value)
    if isinstance(value, Mapping):
        return {str(name): _plain(inner) for name, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(inner) for inner in value]
    return value if value is None or isinstance(value, (bool, int, float, str)) else str(value)


def _frozen(value: Any) -> Any:
    """Return a value with tuples in place of the lists of JSON."""
    return tuple(_frozen(inner) for inner in value) if isinstance(value, list) else value


def _tuples(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return fields with tuples in place of the lists of JSON."""
    return {name: _frozen(value) for name, value in content.items()}
