"""Options that commands share: how a file is to be understood, and what not to learn from."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from priorfill.cli.batch import Reader
    from priorfill.clip import Clip
    from priorfill.markers.marker_set import MarkerSet

__all__ = [
    "as_reading",
    "excluding_options",
    "file_options",
    "read_clip",
    "read_clips",
    "reading_options",
]

_UP = click.option("--up", metavar="AXIS", help="Which axis points up: +X -X +Y -Y +Z -Z.")
_RATE = click.option(
    "--rate", metavar="HZ", type=float, help="Frames per second, instead of the file's."
)
_UNIT = click.option(
    "--unit", metavar="UNIT", help="Unit of length (mm, cm, m), instead of the file's."
)
_SUBJECT = click.option(
    "--subject", metavar="NAME", help="Whose markers, where a file has several people."
)
_MARKER_SET = click.option(
    "--marker-set", metavar="NAME", help="Marker set, or the path of its definition."
)
_KEEP_ZEROS = click.option(
    "--keep-zeros", is_flag=True, help="Take samples that are exactly (0, 0, 0) as measured."
)

_NOT_NAMES = click.option(
    "--exclude-motion",
    "not_names",
    metavar="PATTERN",
    multiple=True,
    help="Do not learn from clips of these names ('walk*'); may be given again.",
)
_NOT_SUBJECTS = click.option(
    "--exclude-subject",
    "not_subjects",
    metavar="PATTERN",
    multiple=True,
    help="Do not learn from clips of these people; may be given again.",
)


def excluding_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options ``not_names not_subjects``."""
    return _with((_NOT_NAMES, _NOT_SUBJECTS), command)


def reading_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options ``up rate unit subject marker_set keep_zeros``."""
    return _with((_UP, _RATE, _UNIT, _SUBJECT, _MARKER_SET, _KEEP_ZEROS), command)


def file_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options ``up rate unit keep_zeros``, which `as_reading` understands."""
    return _with((_UP, _RATE, _UNIT, _KEEP_ZEROS), command)


def as_reading(
    *, up: str | None, rate: float | None, unit: str | None, keep_zeros: bool
) -> dict[str, Any]:
    """Return `file_options` as the arguments of `priorfill.formats.read`."""
    return {"zeros_missing": not keep_zeros, "up": up, "rate": rate, "unit": unit}


def read_clip(
    file: Path,
    *,
    up: str | None,
    rate: float | None,
    unit: str | None,
    subject: str | None,
    marker_set: str | None,
    keep_zeros: bool,
    reader: Reader | None = None,
) -> tuple[Clip, MarkerSet | None]:
    """Read a clip as the options say; also the marker set that was asked for."""
    from priorfill import formats
    from priorfill.markers import definitions

    definition = definitions.load(marker_set) if marker_set else None
    reading = as_reading(up=up, rate=rate, unit=unit, keep_zeros=keep_zeros)
    read = formats.read if reader is None else reader.read
    return read(file, subject=subject, **reading), definition


def read_clips(file: Path, **reading: Any) -> tuple[list[Clip], MarkerSet | None]:
    """Read a file as `read_clip` does; where it holds several people and none is chosen, all."""
    from priorfill.errors import SeveralSubjectsError

    try:
        clip, definition = read_clip(file, **reading)
    except SeveralSubjectsError as several:
        read = [read_clip(file, **reading | {"subject": name}) for name in several.subjects]
        return [clip for clip, _ in read], read[0][1]
    return [clip], definition


def _with(
    options: tuple[Callable[[Callable[..., Any]], Callable[..., Any]], ...],
    command: Callable[..., Any],
) -> Callable[..., Any]:
    for option in reversed(options):
        command = option(command)
    return command
