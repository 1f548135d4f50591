"""Options of the fills of a study, which travel to child processes as JSON."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

from priorfill.database import Selection
from priorfill.errors import OptionError
from priorfill.filling.fill_file import FileOptions
from priorfill.filling.fill_options import FillOptions
from priorfill.filling.gap_filter import GapFilter
from priorfill.filling.plausibility_options import PlausibilityOptions
from priorfill.filling.run_settings import changed_options
from priorfill.markers.marker_set import MarkerSet
from priorfill.methods import resolve
from priorfill.methods.options import differing

__all__ = ["FillSettings"]

_OF_FILES = (
    *("subject", "up", "rate", "unit", "zeros_missing", "ignore_residuals", "rewrite", "program"),
)
"""Fields of `FileOptions` that apply to many files."""

_OF_ONE_FILE = {
    "uncertainty": "; use StudyOptions(uncertainty=True)",
    "report": "; use StudyOptions(report=True)",
    "overwrite": "; use StudyOptions(overwrite=True)",
    "add_to_database": "; use StudyOptions(grow=True)",
    "write_overrides": "",
    "plot": "",
}
"""Fields of `FileOptions` that apply to one file only, and what there is for many."""


@dataclass(frozen=True)
class FillSettings:
    """Options of `priorfill.fill_file` that all files of a study share.

    Attributes
    ----------
    method : str
        The method.
    gap_filter : GapFilter
        Which gaps are filled.
    reject_artefacts : bool
        Whether artefacts count as missing.
    files : FileOptions
        How files are read and written.
    options : FillOptions
        Options that few fills need.

    Raises
    ------
    OptionError
        Where the method or one of its options is unknown, or an option is for one file only.

    Examples
    --------
    >>> settings = FillSettings("linear", GapFilter(max_gap="10f"))
    >>> FillSettings.from_json(settings.to_json()) == settings
    True
    """

    method: str = "auto"
    gap_filter: GapFilter = field(default_factory=GapFilter)
    reject_artefacts: bool = False
    files: FileOptions = field(default_factory=FileOptions)
    options: FillOptions = field(default_factory=FillOptions)

    def __post_init__(self) -> None:
        """Check the options."""
        default = FileOptions()
        for name, instead in _OF_ONE_FILE.items():
            if getattr(self.files, name) != getattr(default, name):
                raise OptionError(f"`{name}` is an option of one file, not of a study{instead}")
        self._method_options()

    def _method_options(self) -> dict[str, Any]:
        """Return the options of the method that differ from its defaults, by dotted name."""
        given = self.options.method_options
        if isinstance(given, Mapping):
            given = changed_options(resolve(self.method), given)
        return {} if given is None else differing(given)

    def to_json(self) -> dict[str, Any]:
        """Return the settings as JSON values; the same options give the same values."""
        options = self.options
        return {
            "method": resolve(self.method),
            "gap_filter": asdict(self.gap_filter),
            "reject_artefacts": self.reject_artefacts,
            "files": {name: getattr(self.files, name) for name in _OF_FILES},
            "method_options": self._method_options(),
            "selection": asdict(options.selection),
            "trust_filled": options.trust_filled,
            "marker_set": _marker_set_as_json(options.marker_set),
            "extrapolate": options.extrapolate,
            "max_error": options.max_error,
            "estimate_errors": options.estimate_errors,
            "plausibility": options.plausibility.to_json(),
        }

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> FillSettings:
        """Return the settings of `to_json`; names that are unknown are left out.

        Parameters
        ----------
        values : mapping of str to object
            As from `to_json`, or read from JSON.
        """
        marker_set = values["marker_set"]
        return cls(
            values["method"],
            GapFilter(**_with_tuples(values["gap_filter"])),
            values["reject_artefacts"],
            FileOptions(**values["files"]),
            FillOptions(
                {name: _as_tuple(value) for name, value in values["method_options"].items()},
                Selection(**_with_tuples(values["selection"])),
                values["trust_filled"],
                None if marker_set is None else _marker_set_from_json(marker_set),
                extrapolate=values["extrapolate"],
                max_error=values["max_error"],
                plausibility=PlausibilityOptions.from_json(values["plausibility"]),
                estimate_errors=values["estimate_errors"],
            ),
        )

    def fill_arguments(self, database_state: str) -> dict[str, Any]:
        """Return the keyword arguments of `priorfill.fill_file` but ``files``.

        Parameters
        ----------
        database_state : str
            State of the database to learn from; empty: the latest.
        """
        return {
            "method": self.method,
            "gap_filter": self.gap_filter,
            "reject_artefacts": self.reject_artefacts,
            "options": replace(self.options, database_state=database_state),
        }


def _marker_set_as_json(marker_set: MarkerSet | None) -> dict[str, Any] | None:
    if marker_set is None:
        return None
    return asdict(marker_set) | {"optional": sorted(marker_set.optional)}


def _marker_set_from_json(values: Mapping[str, Any]) -> MarkerSet:
    given = _with_tuples(values)
    given["optional"] = frozenset(given["optional"])
    given["joints"] = {name: _as_tuple(points) for name, points in values["joints"].items()}
    known = {one.name for one in fields(MarkerSet)}
    return MarkerSet(**{name: value for name, value in given.items() if name in known})


def _with_tuples(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return fields with tuples in place of the lists of JSON."""
    return {name: _as_tuple(value) for name, value in values.items()}


def _as_tuple(value: Any) -> Any:
    return tuple(_as_tuple(inner) for inner in value) if isinstance(value, list) else value
