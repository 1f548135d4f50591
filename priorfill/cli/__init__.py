"""The command line: a thin layer over the library.

No module of this package imports slow packages (numba, scipy, ezc3d) at its top, so that
``priorfill --help`` answers at once.
"""

from __future__ import annotations

import importlib
import os
import sys
from typing import Any

import click

from priorfill.cli.completion import register_shells
from priorfill.cli.encoding import encodable, replace_what_is_lacking
from priorfill.cli.exit_status import EXIT_BROKEN_PIPE, EXIT_FAILED, exit_status
from priorfill.cli.output import ended_by_reader, print_line
from priorfill.cli.system import (
    check_memory_limit,
    end_on_signals,
    finish_stdout,
    open_closed_streams,
)
from priorfill.runtime.display import escaped
from priorfill.runtime.error_line import DEBUG, error_line
from priorfill.runtime.option_texts import close_or_all

__all__ = ["DEBUG", "main"]

_COMMANDS = {
    "fill": ("priorfill.cli.fill:fill", "Fill the gaps of a file."),
    "batch": ("priorfill.cli.batch:batch", "Fill the gaps of all files of a study."),
    "review": (
        "priorfill.cli.review:review",
        "Accept, refuse or repeat the fill of each gap in the browser.",
    ),
    "report": (
        "priorfill.cli.report:report",
        "Show in the browser what filled files have in the gaps of a file.",
    ),
    "inspect": ("priorfill.cli.inspect:inspect", "Show the contents of a file and its gaps."),
    "db": ("priorfill.cli.db:db", "Build and maintain prior databases."),
    "evaluate": (
        "priorfill.cli.evaluate:evaluate",
        "Compare the methods on artificial gaps in your files.",
    ),
    "nexus": ("priorfill.cli.programs:nexus", "Fill the trial that is open in Vicon Nexus."),
    "qtm": ("priorfill.cli.programs:qtm", "Fill the measurement that is open in QTM."),
    "methods": ("priorfill.cli.methods:methods", "List the methods, or the options of one."),
    "demo": (
        "priorfill.cli.demo:demo",
        "Make a clip with gaps, fill it, and compare with the ground truth.",
    ),
}
"""``module:function`` and help line of each command, so that none is imported before it is used."""

_HIDDEN = {
    "batch-job": "priorfill.cli.batch_job:batch_job",
    "batch-survey": "priorfill.cli.batch_survey:batch_survey",
}
"""Likewise for commands that other commands start as child processes."""


class _Main(click.Group):
    """A group that imports a command when it is called, and prints errors in one line."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        place = _COMMANDS[name][0] if name in _COMMANDS else _HIDDEN.get(name)
        if place is None:
            return None
        module, attribute = place.split(":")
        command = getattr(importlib.import_module(module), attribute)
        assert isinstance(command, click.Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        try:
            return super().resolve_command(ctx, args)
        except click.NoSuchOption:
            raise
        except click.UsageError:
            raise click.UsageError(
                f"there is no command {args[0]!r}; {close_or_all(args[0], list(_COMMANDS))}", ctx
            ) from None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in _COMMANDS.items()])

    def main(self, *args: Any, **extra: Any) -> Any:
        open_closed_streams()
        replace_what_is_lacking()
        register_shells()
        try:
            with end_on_signals():
                # paths expand themselves (path_types.py); patterns must stay as they are
                return super().main(*args, windows_expand_args=False, **extra)
        except OSError as error:  # while printing a help page
            if ended_by_reader(error):
                sys.exit(EXIT_BROKEN_PIPE)
            if os.environ.get(DEBUG):
                raise
            print_line(f"priorfill: {error_line(error)}", err=True)
            sys.exit(EXIT_FAILED)
        finally:
            finish_stdout()

    def make_context(
        self,
        info_name: str | None,
        args: list[str],
        parent: click.Context | None = None,
        **extra: Any,
    ) -> click.Context:
        try:
            return super().make_context(info_name, args, parent, **extra)
        except click.ClickException as error:
            _escape(error)
            raise

    def invoke(self, ctx: click.Context) -> Any:
        try:
            check_memory_limit()
            result = super().invoke(ctx)
            _print_cache_problem()
            sys.stdout.flush()
        except click.ClickException as error:
            _escape(error)
            raise
        except (click.exceptions.Exit, click.Abort):
            _print_cache_problem()
            raise
        except (Exception, KeyboardInterrupt) as error:
            if ended_by_reader(error):
                ctx.exit(EXIT_BROKEN_PIPE)
            if os.environ.get(DEBUG):
                raise
            print_line(f"priorfill: {error_line(error)}", err=True)
            ctx.exit(exit_status(error))
        return result


@click.group(cls=_Main, name="priorfill", context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="priorfill", message="priorfill %(version)s")
def main() -> None:
    """Fill gaps in optical motion capture data."""


def _escape(error: click.ClickException) -> None:
    """Make a usage error printable, which can quote the name of a file."""
    vars(error)["message"] = encodable(escaped(error.message), sys.stderr)  # final for click


def _print_cache_problem() -> None:
    """Tell that compiled functions could not be kept, if any were compiled."""
    module = sys.modules.get("priorfill.runtime.compiled")
    problem = module.cache_problem() if module is not None else ""
    if problem:
        print_line(
            f"note: compiled functions cannot be kept on disk ({problem}), so each run compiles "
            "them again, for some seconds; name a folder for them in NUMBA_CACHE_DIR",
            err=True,
        )
