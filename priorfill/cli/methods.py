"""``priorfill methods``: list the methods of ``fill``."""

from __future__ import annotations

import click

from priorfill.cli.output import print_json, print_table

__all__ = ["methods"]


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def methods(as_json: bool) -> None:
    """List the methods that `fill --method` and `evaluate --methods` know."""
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
    click.echo(f"auto is {DEFAULT_METHOD}.")
