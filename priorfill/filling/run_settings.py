"""How each override fills: method, options, markers that the method sees, and sources."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import partial
from typing import Any

from priorfill.clip import Clip
from priorfill.errors import OptionError
from priorfill.filling.gap_filter import matching_markers
from priorfill.filling.override_entries import (
    CLIP,
    DATABASE,
    SAME_SUBJECT,
    shown_value,
    unknown_marker,
)
from priorfill.filling.overrides import ACCEPT, GapOverride, Overrides
from priorfill.methods import METHODS, get_method, get_options
from priorfill.methods.options import with_values
from priorfill.methods.task import Estimate
from priorfill.methods.task_parts import seeing_only
from priorfill.runtime.option_texts import close_or_all
from priorfill.search.takes import Take

__all__ = ["RunSettings", "changed_options", "check_sources", "settings_of_overrides"]


@dataclass(frozen=True)
class RunSettings:
    """How gaps are filled.

    Attributes
    ----------
    method : str
        The method.
    options : object or None
        Its options; None for the defaults.
    filled : tuple of int or None
        The markers that are filled, where the method does not see all; None: all.
    seen : tuple of int
        The markers that it sees in addition.
    sources : tuple of str
        What it learns from; empty: everything.
    """

    method: str
    options: Any = None
    filled: tuple[int, ...] | None = None
    seen: tuple[int, ...] = ()
    sources: tuple[str, ...] = ()

    @property
    def learn_from_clip(self) -> bool:
        """Whether the method may learn from the clip's own frames."""
        return not self.sources or CLIP in self.sources

    def may_use(self, take: Take) -> bool:
        """Whether a recording is among the sources.

        Parameters
        ----------
        take : Take
            Of the database, or of the same subject.
        """
        if not self.sources:
            return True
        if take.same_subject:
            return SAME_SUBJECT in self.sources
        return any(_matches(source, take.name) for source in self.sources)

    def function(self) -> Callable[..., Estimate]:
        """Return the method as a function of a task and a progress callback."""
        method: Callable[..., Estimate] = get_method(self.method)
        if self.filled is not None:
            method = seeing_only(method, self.filled, self.seen)
        return method if self.options is None else partial(method, options=self.options)


def settings_of_overrides(
    overrides: Overrides | None, clip: Clip, default: RunSettings, available: Set[str]
) -> list[RunSettings | None]:
    """Return how each override fills the gaps of a clip.

    Parameters
    ----------
    overrides : Overrides or None
        The overrides.
    clip : Clip
        The clip.
    default : RunSettings
        For gaps without an override.
    available : set of str
        The sources that there are; naming them all is the same as naming none.

    Returns
    -------
    list of (RunSettings or None)
        The default first, then those of the overrides in their order; None for one that does not
        fill, or is meant for another subject.

    Raises
    ------
    OptionError
        Where a donor or an option is unknown.
    """
    settings: list[RunSettings | None] = [default]
    for number, entry in enumerate(() if overrides is None else overrides.entries, start=1):
        assert overrides is not None
        where = f"{overrides.name}: gap {number}"
        meant = entry.is_for(clip)
        if meant and entry.is_method:
            settings.append(_settings_of(entry, clip, default, available, where))
        else:
            settings.append(default if meant and entry.do == ACCEPT else None)
    return settings


def _settings_of(
    entry: GapOverride, clip: Clip, default: RunSettings, available: Set[str], where: str
) -> RunSettings | None:
    """Return how an override fills; None where the clip has none of its markers."""
    own = [marker for name in entry.markers for marker in matching_markers(clip, name)]
    if not own:
        return None
    seen = []
    for name in entry.donors:
        found = matching_markers(clip, name)
        if not found:
            whose = f"{clip.name} ({clip.subject})" if clip.subject else clip.name
            raise unknown_marker(where, name, whose, clip.labels)
        seen += found
    if entry.sources and CLIP not in entry.sources and not METHODS[entry.do].without_clip:
        able = ", ".join(name for name, one in METHODS.items() if one.without_clip)
        raise OptionError(
            f"{where}: {entry.do} learns from the clip; add it to the sources, or use one of {able}"
        )
    options = default.options if entry.do == default.method else None
    if entry.options:
        try:
            options = changed_options(entry.do, entry.options, options)
        except OptionError as error:
            raise OptionError(f"{where}: {error}") from None
    return RunSettings(
        entry.do,
        options,
        tuple(sorted(set(own))) if entry.donors else None,
        tuple(sorted(set(seen))),
        () if available <= set(entry.sources) else tuple(sorted(set(entry.sources))),
    )


def changed_options(method: str, values: Mapping[str, Any], options: Any = None) -> Any:
    """Return the options of a method with other values; None for the defaults.

    Parameters
    ----------
    method : str
        The method.
    values : mapping of str to object
        Values by dotted name.
    options : object, optional
        Where other options are taken from; None: the defaults.

    Raises
    ------
    OptionError
        Where the method has no such option.
    """
    default = get_options(method)
    if default is None:
        if values:
            raise OptionError(f"method {method} has no option {next(iter(values))!r}; it has none")
        return None
    changed = with_values(default if options is None else options, values)
    return None if changed == default else changed


def check_sources(overrides: Overrides, names: Iterable[str] | None, *, same_subject: bool) -> None:
    """Check that the sources that overrides name are there.

    Parameters
    ----------
    overrides : Overrides
        The overrides.
    names : iterable of str or None
        Names of the clips of the database; None: there is no database.
    same_subject : bool
        Whether there are other recordings of the same subject.

    Raises
    ------
    OptionError
        Where there is no database or no such recording, or no clip has such a name.
    """
    known = None if names is None else list(dict.fromkeys(names))
    for number, entry in enumerate(overrides.entries, start=1):
        where = f"{overrides.name}: gap {number}"
        for source in entry.sources:
            _check_source(source, known, where, same_subject=same_subject)


def _check_source(
    source: str, known: Sequence[str] | None, where: str, *, same_subject: bool
) -> None:
    """Raise OptionError where a source is not there."""
    if source == SAME_SUBJECT and not same_subject:
        raise OptionError(
            f"{where}: sources has {source}, but there is no other recording of the subject; give "
            "one (`same_subject`)"
        )
    if source in (CLIP, SAME_SUBJECT):
        return
    if known is None:
        raise OptionError(
            f"{where}: sources has {source}, but there is no database; give one (`database`)"
        )
    if source != DATABASE and not any(_matches(source, name) for name in known):
        pattern = source.partition(":")[2]
        raise OptionError(
            f"{where}: no clip of the database is called {shown_value(pattern)}; "
            f"{close_or_all(pattern, known) if known else 'it is empty'}"
        )


def _matches(source: str, name: str) -> bool:
    """Whether a source is the database, or the clips of it that a name belongs to."""
    kind, _, pattern = source.partition(":")
    return kind == DATABASE and (not pattern or pattern == name or fnmatchcase(name, pattern))
