"""``priorfill methods``: list the methods of ``fill``, or the options of one."""

from __future__ import annotations

from typing import Any

import click

from priorfill.cli.completion import complete_methods
from priorfill.cli.output import print_json, print_line, print_table

__all__ = ["methods"]


@click.command()
@click.argument("method", required=False, shell_complete=complete_methods)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def methods(method: str | None, as_json: bool) -> None:
    """List the methods for `fill --method` and `evaluate --methods`.

    With METHOD, list the options of that method for `fill --set`, with their defaults.
    """
    if method is not None:
        _list_options(method, as_json)
        return
    from priorfill.methods import DEFAULT_METHOD, METHODS

    if as_json:
        print_json(
            {
                name: {"summary": entry.summary, "source": entry.source}
                for name, entry in METHODS.items()
            }
        )
        return
    rows = [(name, entry.summary, entry.source) for name, entry in METHODS.items()]
    print_table(("method", "what it does", "source"), rows)
    print_line(f"auto is {DEFAULT_METHOD}.")


def _list_options(method: str, as_json: bool) -> None:
    """Print the options of a method that can be set, with their defaults."""
    from priorfill.methods import get_options, resolve
    from priorfill.methods.options import flattened

    options = get_options(method)
    values = {} if options is None else flattened(options)
    values = {name: value for name, value in values.items() if _is_plain(value)}
    if as_json:
        print_json(values)
    elif values:
        print_table(("option", "default"), [(name, _text(v)) for name, v in values.items()])
    else:
        print_line(f"{resolve(method)} has no options.")


def _is_plain(value: Any) -> bool:
    """Return whether a value can be given as text."""
    if isinstance(value, (tuple, list)):
        return all(_is_plain(inner) for inner in value)
    return value is None or isinstance(value, (bool, int, float, str))


def _text(value: Any) -> str:
    """Return a value in the form that ``--set`` accepts."""
    if isinstance(value, (tuple, list)):
        return ",".join(_text(inner) for inner in value)
    if value is None or isinstance(value, bool):
        return str(value).lower()
    return repr(value).removesuffix(".0") if isinstance(value, float) else str(value)
