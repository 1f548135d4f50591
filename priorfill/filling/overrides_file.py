"""Files of overrides: read and written."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from priorfill.errors import OptionError
from priorfill.filling.overrides import MadeFor, Overrides
from priorfill.runtime.argument_types import check_path, check_type
from priorfill.runtime.atomic_file import check_target, replace_file
from priorfill.runtime.toml_file import read_toml
from priorfill.runtime.toml_text import toml_line

__all__ = [
    "check_overrides_file",
    "overrides_file",
    "overrides_text",
    "read_overrides",
    "write_overrides",
]

MAX_BYTES = 1 << 22
"""Size limit of a file of overrides (4 MiB): some 20,000 entries."""


def read_overrides(path: Path | str) -> Overrides:
    r"""Read a file of overrides.

    Parameters
    ----------
    path : Path or str
        A TOML file; docs/cli.md describes its contents.

    Returns
    -------
    Overrides
        For `priorfill.fill`.

    Raises
    ------
    OptionError
        Where the file cannot be read or its contents are invalid.

    See Also
    --------
    priorfill.write_overrides : Write such a file.
    priorfill.fill : Fill the gaps of a clip.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder) / "gaps.toml"
    ...     _ = file.write_text('[[gap]]\nmarker = "LKNE"\ndo = "leave"')
    ...     read_overrides(file).entries[0].markers
    ('LKNE',)
    """
    check_path("path", path)
    path = Path(path)
    content = read_toml(path, OptionError, max_bytes=MAX_BYTES)
    entries = content.pop("gap", [])
    made_for = content.pop("made_for", None)
    if content:
        raise OptionError(
            f"{path}: unknown key {next(iter(content))!r}; write [[gap]] tables, and [made_for]"
        )
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise OptionError(f"{path}: gap is not a list of tables; write [[gap]] above each")
    return Overrides.from_entries(entries, path, _made_for(made_for, path))


def write_overrides(path: Path | str, overrides: Overrides, *, overwrite: bool = False) -> Path:
    """Write a file of overrides, completely or not at all.

    Parameters
    ----------
    path : Path or str
        The TOML file to write.
    overrides : Overrides
        The overrides; `priorfill.overrides_template` makes some of a result.
    overwrite : bool
        Replace an existing file.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    OutputError
        Where the file exists already or cannot be written.
    OptionError
        Where its suffix is not .toml, or the overrides have what `priorfill.read_overrides` would
        not read: a lone surrogate in a text, an integer of more than 64 bits, or over 4 MiB.

    See Also
    --------
    priorfill.read_overrides : Read such a file.

    Examples
    --------
    >>> import tempfile
    >>> import priorfill as pf
    >>> overrides = pf.Overrides((pf.GapOverride(("LKNE",), "leave"),))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = write_overrides(f"{folder}/gaps.toml", overrides)
    ...     read_overrides(file).entries == overrides.entries
    True
    """
    check_path("path", path)
    check_type("overrides", overrides, Overrides, "Overrides, after the path")
    with overrides_file(path, overrides, overwrite=overwrite) as written:
        return written


@contextmanager
def overrides_file(
    path: Path | str, overrides: Overrides, *, overwrite: bool = False
) -> Iterator[Path]:
    """Write a file of overrides that appears when the block ends without an error.

    Parameters
    ----------
    path, overrides, overwrite
        As for `write_overrides`.

    Yields
    ------
    Path
        The file.
    """
    target = Path(str(path))
    check_overrides_file(target, overwrite=overwrite)
    text = overrides_text(overrides)
    with replace_file(target, overwrite=overwrite) as temporary:
        temporary.write_bytes(text.encode("utf-8"))
        yield target


def check_overrides_file(
    path: Path | str, *, source: Path | None = None, overwrite: bool = False
) -> None:
    """Check before a fill whether a file of overrides can be written.

    Parameters
    ----------
    path : Path or str
        The file to write.
    source : Path, optional
        The file that is filled.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    OptionError
        Where its suffix is not .toml.
    OutputError
        Where the file exists already or cannot be written.
    """
    target = Path(str(path))
    if target.suffix.lower() != ".toml":
        raise OptionError(f"{target}: overrides are written as a TOML file; end its name in .toml")
    check_target(target, overwrite=overwrite, source=source)


def overrides_text(overrides: Overrides) -> str:
    """Return the contents of a file of overrides.

    Parameters
    ----------
    overrides : Overrides
        The overrides.

    Raises
    ------
    OptionError
        Where the overrides have what `read_overrides` would not read: a lone surrogate in a text,
        an integer of more than 64 bits, or more than `MAX_BYTES`.

    Examples
    --------
    >>> from priorfill.filling.overrides import GapOverride
    >>> print(overrides_text(Overrides((GapOverride(("LKNE",), "pchip", 120, 180),))), end="")
    [[gap]]
    marker = "LKNE"
    frames = "120-180"
    do = "pchip"
    """
    parts = []
    if overrides.made_for is not None:
        known = {
            key: value for key, value in asdict(overrides.made_for).items() if value is not None
        }
        parts.append("[made_for]\n" + "".join(toml_line(*item) for item in known.items()))
    for number, entry in enumerate(overrides.to_entries(), start=1):
        options = entry.pop("options", {})
        try:
            lines = ["[[gap]]\n", *(toml_line(*item) for item in entry.items())]
            if options:
                lines += ["[gap.options]\n", *(toml_line(*item) for item in options.items())]
        except OptionError as error:
            raise OptionError(f"{overrides.name}: gap {number}: {error}") from None
        parts.append("".join(lines))
    text = "\n".join(parts)
    if len(text.encode("utf-8")) > MAX_BYTES:  # which would not be read again
        raise OptionError(
            f"{overrides.name}: have more than {MAX_BYTES >> 10} KiB as a file; shorten notes, or "
            "use patterns of markers"
        )
    return text


def _made_for(content: Any, path: Path) -> MadeFor | None:
    """Read the table of what overrides were made for."""
    if content is None:
        return None
    names = [one.name for one in fields(MadeFor)]
    if not isinstance(content, Mapping):
        raise OptionError(f"{path}: made_for is not a table; write [made_for]")
    for key, value in content.items():
        if key not in names:
            raise OptionError(f"{path}: made_for: unknown key {key!r}; use {', '.join(names)}")
        if not isinstance(value, str):
            raise OptionError(f"{path}: made_for: {key} is {value!r}; give a text")
    return MadeFor(**content)
