"""Messages of the library in the words of the command line.

The library writes arguments in backquotes (```rate```). What is printed has the options of the
command that runs in their place (``--rate``).
"""

from __future__ import annotations

import re

import click

__all__ = ["with_options"]

_ARGUMENT = re.compile(r"(?<![^\s(])`([a-z][a-z_]*)`(?![^\s.,:;)])")
"""A word by itself, so that labels with backquotes are left alone."""

_SPELT_ALIKE = (
    *("database", "ignore_residuals", "marker_set", "markers", "overrides", "overwrite", "rate"),
    *("reject_artefacts", "rewrite", "same_subject", "subject", "uncertainty", "unit", "up"),
)
"""Arguments that messages name also where the command that runs lacks the option."""

_SPELT_OTHERWISE = {"pattern": "--like", "zeros_missing": "--keep-zeros"}
"""Arguments whose options are named after something else."""


def with_options(text: str) -> str:
    """Return a text with options in place of arguments in backquotes.

    Parameters
    ----------
    text : str
        A message or note of the library.

    Returns
    -------
    str
        Names that are no arguments keep their backquotes.

    Examples
    --------
    >>> with_options("give the frame rate (`rate`)")
    'give the frame rate (--rate)'
    """
    if "`" not in text:
        return text
    names = _options()
    return _ARGUMENT.sub(lambda found: names.get(found[1], found[0]), text)


def _options() -> dict[str, str]:
    """Return the options of the command that runs, by the names of arguments."""
    names = {name: f"--{name.replace('_', '-')}" for name in _SPELT_ALIKE} | _SPELT_OTHERWISE
    context = click.get_current_context(silent=True)
    if context is None:
        return names
    # an error is printed where the context of the command is gone, so the root is asked
    root = context.find_root()
    command = root.command
    if isinstance(command, click.Group) and root.invoked_subcommand:
        command = command.get_command(root, root.invoked_subcommand) or command
    commands = [command]
    if isinstance(command, click.Group):
        commands += command.commands.values()
    for one in commands:
        for parameter in one.params:
            if isinstance(parameter, click.Option) and parameter.name:
                names[parameter.name] = max(parameter.opts, key=len)
    return names
