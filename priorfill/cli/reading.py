"""Options that commands share: how to interpret a file, and which clips not to learn from."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from priorfill.cli.completion import complete_clips, complete_marker_sets, complete_subjects
from priorfill.cli.option_names import with_options
from priorfill.errors import OptionError

if TYPE_CHECKING:
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


def _checked_up(ctx: click.Context, param: click.Parameter, value: str | None) -> str | None:
    """Refuse what is no axis before any file is read."""
    if value is not None:
        from priorfill.formats.up_axis import check_up

        _as_usage(lambda: check_up(value), ctx, param)
    return value


def _checked_rate(ctx: click.Context, param: click.Parameter, value: float | None) -> float | None:
    """Refuse what is no frame rate before any file is read."""
    if value is not None:
        from priorfill.formats.recording import ReadOptions

        _as_usage(lambda: ReadOptions(rate=value), ctx, param)
    return value


def _as_usage(check: Callable[[], object], ctx: click.Context, param: click.Parameter) -> None:
    """Run a check of the library; its error becomes one about an option."""
    try:
        check()
    except OptionError as error:
        raise click.BadParameter(with_options(str(error)), ctx, param) from None


_UP = click.option(
    "--up",
    metavar="AXIS",
    callback=_checked_up,
    help="The axis that points up: +X -X +Y -Y +Z -Z.",
)
_RATE = click.option(
    "--rate",
    metavar="HZ",
    type=float,
    callback=_checked_rate,
    help="Frame rate, instead of the file's.",
)
_UNIT = click.option(
    "--unit", metavar="UNIT", help="Unit of length (mm, cm, m), instead of the file's."
)
_SUBJECT = click.option("--subject", metavar="NAME", help="The subject, in a file of several.")
_MARKER_SET = click.option(
    "--marker-set",
    metavar="NAME",
    shell_complete=complete_marker_sets,
    help="Name of the marker set, or path of its definition.",
)
_KEEP_ZEROS = click.option(
    "--keep-zeros", is_flag=True, help="Treat samples at exactly (0, 0, 0) as measured."
)
_IGNORE_RESIDUALS = click.option(
    "--ignore-residuals",
    is_flag=True,
    help="Treat samples with a negative residual as measured.",
)

_NOT_NAMES = click.option(
    "--exclude-motion",
    "not_names",
    metavar="PATTERN",
    multiple=True,
    shell_complete=complete_clips,
    help='Do not learn from clips with these names ("walk*"). Can be repeated.',
)
_NOT_SUBJECTS = click.option(
    "--exclude-subject",
    "not_subjects",
    metavar="PATTERN",
    multiple=True,
    shell_complete=complete_subjects,
    help="Do not learn from clips of these subjects. Can be repeated.",
)


def excluding_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options ``not_names not_subjects``."""
    return _with((_NOT_NAMES, _NOT_SUBJECTS), command)


def reading_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command all options of this kind, for `read_clip`."""
    options = (_UP, _RATE, _UNIT, _SUBJECT, _MARKER_SET, _KEEP_ZEROS, _IGNORE_RESIDUALS)
    return _with(options, command)


def file_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options ``up rate unit keep_zeros ignore_residuals``, for `as_reading`."""
    return _with((_UP, _RATE, _UNIT, _KEEP_ZEROS, _IGNORE_RESIDUALS), command)


def as_reading(
    *,
    up: str | None,
    rate: float | None,
    unit: str | None,
    keep_zeros: bool,
    ignore_residuals: bool = False,
) -> dict[str, Any]:
    """Return `file_options` as the arguments of `priorfill.formats.read`."""
    return {
        "zeros_missing": not keep_zeros,
        "up": up,
        "rate": rate,
        "unit": unit,
        "ignore_residuals": ignore_residuals,
    }


def read_clip(
    file: Path,
    *,
    subject: str | None,
    marker_set: str | None,
    read: Callable[..., Clip] | None = None,
    **reading: Any,
) -> tuple[Clip, MarkerSet | None]:
    """Read a clip, and load the marker set if one is named.

    Parameters
    ----------
    file : Path
        The file.
    subject, marker_set
        The values of `reading_options`.
    read : callable, optional
        Used in place of `priorfill.formats.read`.
    **reading
        The other values of `reading_options`, as for `as_reading`.

    Returns
    -------
    tuple of Clip and MarkerSet or None
        The clip, and the marker set that was named.
    """
    from priorfill import formats
    from priorfill.markers import definitions

    definition = definitions.load(marker_set) if marker_set else None
    clip = (read or formats.read)(file, subject=subject, **as_reading(**reading))
    return clip, definition


def read_clips(
    file: Path, *, subject: str | None, marker_set: str | None, **reading: Any
) -> tuple[tuple[Clip, ...], MarkerSet | None]:
    """Read the clip of each subject of a file, and load the marker set if one is named.

    Parameters
    ----------
    file : Path
        The file.
    subject : str or None
        The only subject to read.
    marker_set : str or None
        Name of the marker set, or path of its definition.
    **reading
        The other values of `reading_options`.
    """
    from priorfill.filling.multi_subject import read_subjects
    from priorfill.markers import definitions

    definition = definitions.load(marker_set) if marker_set else None
    return read_subjects(file, subject=subject, **as_reading(**reading)), definition


def _with(
    options: tuple[Callable[[Callable[..., Any]], Callable[..., Any]], ...],
    command: Callable[..., Any],
) -> Callable[..., Any]:
    for option in reversed(options):
        command = option(command)
    return command
