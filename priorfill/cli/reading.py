"""The options that say how a file is to be understood, shared by the commands that read one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from priorfill.clip import Clip
    from priorfill.markerset import MarkerSet

__all__ = ["read_clip", "reading_options"]

_OPTIONS = (
    click.option("--up", metavar="AXIS", help="Which axis points up: +X -X +Y -Y +Z -Z."),
    click.option(
        "--rate", metavar="HZ", type=float, help="Frames per second, instead of the file's."
    ),
    click.option(
        "--unit", metavar="UNIT", help="Unit of length (mm, cm, m), instead of the file's."
    ),
    click.option(
        "--subject", metavar="NAME", help="Whose markers, where a file has several people."
    ),
    click.option("--marker-set", metavar="NAME", help="Marker set, or the path of its definition."),
    click.option(
        "--keep-zeros", is_flag=True, help="Take samples that are exactly (0, 0, 0) as measured."
    ),
)


def reading_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options ``up rate unit subject marker_set keep_zeros``."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def read_clip(
    file: Path,
    *,
    up: str | None,
    rate: float | None,
    unit: str | None,
    subject: str | None,
    marker_set: str | None,
    keep_zeros: bool,
) -> tuple[Clip, MarkerSet | None]:
    """Read a clip as the options say; also the marker set that was asked for."""
    from priorfill import formats, markerset

    definition = markerset.load(marker_set) if marker_set else None
    clip = formats.read(
        file, zeros_missing=not keep_zeros, up=up, rate=rate, unit=unit, subject=subject
    )
    return clip, definition
