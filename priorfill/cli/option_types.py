"""Types of options: frame ranges, durations, and names separated by commas; and ``--all``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

from priorfill.errors import OptionError
from priorfill.runtime.option_texts import parse_duration, parse_frames, parse_names

__all__ = ["DURATION", "FRAMES", "as_names", "every_row_option"]


class _ParsedText(click.ParamType[Any]):
    """An option whose value is text for a function of the library."""

    def __init__(self, name: str, parse: Callable[[str], Any]) -> None:
        self.name = name
        self._parse = parse

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if not isinstance(value, str):
            return value
        try:
            return self._parse(value)
        except OptionError as error:
            self.fail(str(error), param, ctx)


FRAMES = _ParsedText("frames", parse_frames)
"""``92-116``: first and last frame; None where omitted."""

DURATION = _ParsedText("duration", parse_duration)
"""``0.25`` or ``0.25s``: a float (s); ``10f``: text."""


every_row_option = click.option(
    "--all", "every_row", is_flag=True, help="Print all rows of long tables, not only the first."
)


def as_names(
    ctx: click.Context, param: click.Parameter, value: str | tuple[str, ...] | None
) -> tuple[str, ...] | None:
    """Read names, for options that can be repeated and take several separated by commas.

    A callback of click: None if the option is not given and has no default.
    """
    if value is None:
        return None
    try:
        return parse_names(value)
    except OptionError as error:
        raise click.BadParameter(str(error), ctx, param) from None
