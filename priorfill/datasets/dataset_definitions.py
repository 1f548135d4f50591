"""Known data sets: addresses, terms, credit, and the files that hold the recordings.

Each has a definition in ``database/datasets``; the README there describes the fields.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import urlsplit

from priorfill.datasets.local_names import leads_out, local_path, same_name
from priorfill.errors import DatasetDefinitionError, OptionError
from priorfill.runtime.option_texts import close_or_all
from priorfill.runtime.resources import resource_path
from priorfill.runtime.toml_file import read_toml

__all__ = ["Dataset", "DatasetFile", "check_address", "find_dataset", "known_datasets"]

_TEXT_FIELDS = ("name", "title", "home", "base", "licence", "terms", "credit", "marker_set")
"""Required fields of a definition that hold text."""

_SHA256 = re.compile("[0-9a-f]{64}")


@dataclass(frozen=True)
class DatasetFile:
    """A file of a data set.

    Attributes
    ----------
    path : str
        Relative to the data set's base address, and to the folder it is stored in.
    size : int or None
        Bytes; None if unknown.
    sha256 : str
        Hash of its contents; empty if unknown.
    """

    path: str
    size: int | None = None
    sha256: str = ""


@dataclass(frozen=True)
class Dataset:
    """A data set of recordings.

    Attributes
    ----------
    name : str
        Its name on the command line.
    title, home : str
        Its full name, and its web page.
    base : str
        Address that the paths of its files are relative to.
    licence : str
        Short name of its terms of use, as a database records it for each clip.
    terms : str
        The terms in a sentence.
    credit : str
        Whom to name.
    marker_set : str
        Name of the marker set of its recordings; empty if they have several.
    subject_pattern, subject_name : str
        Regular expression (RE2) that finds the subject at the start of a recording's name, and the
        name to give the subject: ``{}`` stands for its first group.
    files : tuple of DatasetFile
        The files to download.
    """

    name: str
    title: str
    home: str
    base: str
    licence: str
    terms: str
    credit: str
    marker_set: str
    subject_pattern: str
    subject_name: str
    files: tuple[DatasetFile, ...]

    def subject(self, recording: str) -> str:
        """Return the subject of a recording by its name; empty if the name does not contain it."""
        if not self.subject_pattern:
            return ""
        text = recording.encode("utf-8", "replace").decode("utf-8")  # names of no encoding
        found = _compiled(self.subject_pattern).match(text)
        return self.subject_name.replace("{}", found[1]) if found and found[1] else ""


def known_datasets() -> tuple[Dataset, ...]:
    """Return the data sets whose definitions are shipped with priorfill, ordered by name.

    Raises
    ------
    DatasetDefinitionError
        If a definition is invalid.

    Examples
    --------
    >>> [dataset.name for dataset in known_datasets()]
    ['cmu', 'hdm05']
    """
    return tuple(_read(path) for path in sorted(resource_path("datasets").glob("*.toml")))


def find_dataset(name: str) -> Dataset:
    """Return a data set.

    Parameters
    ----------
    name : str
        The name of a known one, or the path of a definition (``.toml``).

    Raises
    ------
    OptionError
        If there is none of this name.
    DatasetDefinitionError
        If the definition is invalid.

    See Also
    --------
    known_datasets
    """
    if name.lower().endswith(".toml"):
        return _read(Path(name))
    datasets = {dataset.name: dataset for dataset in known_datasets()}
    if name not in datasets:
        raise OptionError(
            f"data set {name!r} is unknown; {close_or_all(name, [*datasets])} "
            "(or give the path of a definition, NAME.toml)"
        )
    return datasets[name]


def check_address(address: str) -> str:
    """Return a base address with a slash at its end.

    Raises
    ------
    OptionError
        If it is not an http or https address.
    """
    parts = urlsplit(address)
    if parts.scheme not in ("http", "https") or not parts.netloc:
        raise OptionError(f"{address!r} is not a web address; give one like https://host/folder")
    return address.rstrip("/") + "/"


def _read(path: Path) -> Dataset:
    """Read a definition."""
    content = read_toml(path, DatasetDefinitionError)
    texts = {key: _text(content, key, path) for key in _TEXT_FIELDS}
    subject = content.pop("subject", {"pattern": "", "name": ""})
    if not isinstance(subject, dict):
        raise DatasetDefinitionError(f"{path}: subject is not a table; it needs pattern and name")
    pattern, name = (_text(subject, key, path) for key in ("pattern", "name"))
    files = content.pop("files", None)
    if not isinstance(files, list) or not files:
        raise DatasetDefinitionError(f"{path}: has no files; add a [[files]] with a path")
    if content or subject:
        unknown = next(iter([*content, *subject]))
        raise DatasetDefinitionError(f"{path}: field {unknown!r} is unknown; remove it")
    try:
        texts["base"] = check_address(texts["base"])
    except OptionError as error:
        raise DatasetDefinitionError(f"{path}: base {error}") from None
    listed = tuple(_file(one, path) for one in files)
    if len({same_name(local_path(file.path)) for file in listed}) < len(listed):
        raise DatasetDefinitionError(
            f"{path}: two files have one name on some systems; correct their paths"
        )
    groups = _groups(pattern, path)
    if pattern and (groups != 1 or name.count("{}") != 1):
        raise DatasetDefinitionError(
            f"{path}: subject.pattern needs one group, and subject.name one {{}} for it"
        )
    return Dataset(
        **texts,
        subject_pattern=pattern,
        subject_name=name,
        files=listed,
    )


@cache
def _compiled(pattern: str) -> Any:
    """Return a regular expression of RE2, which matches in a time linear in the text."""
    import re2  # used by few commands

    options = re2.Options()
    options.log_errors = False  # on stderr
    return re2.compile(pattern, options)


def _groups(pattern: str, path: Path) -> int:
    """Return the number of groups of a regular expression."""
    try:
        return int(_compiled(pattern).groups)
    except Exception as error:  # of re2 or of the encoding
        reason = error.args[0] if error.args else error
        text = reason.decode("utf-8", "replace") if isinstance(reason, bytes) else str(error)
        raise DatasetDefinitionError(
            f"{path}: subject.pattern is invalid ({text}); correct it"
        ) from error


def _text(content: dict[str, Any], key: str, path: Path) -> str:
    """Remove a text from a table and return it."""
    value = content.pop(key, None)
    if not isinstance(value, str):
        raise DatasetDefinitionError(f"{path}: {key} is {value!r}; give a text")
    return value


def _file(content: Any, path: Path) -> DatasetFile:
    """Read one of the files."""
    if not isinstance(content, dict):
        raise DatasetDefinitionError(f"{path}: an entry of files is not a table; write [[files]]")
    content = dict(content)
    name = _text(content, "path", path)
    if not PurePosixPath(name).parts or leads_out(name) or "\\" in name or ":" in name:
        raise DatasetDefinitionError(f"{path}: {name!r} is not a relative path; correct it")
    size, sha256 = content.pop("bytes", None), content.pop("sha256", "")
    if size is not None and not (type(size) is int and size > 0):
        raise DatasetDefinitionError(f"{path}: bytes of {name} are {size!r}; give a number above 0")
    if sha256 and not (isinstance(sha256, str) and _SHA256.fullmatch(sha256)):
        raise DatasetDefinitionError(
            f"{path}: sha256 of {name} is not a hash of 64 hexadecimal digits"
        )
    if content:
        raise DatasetDefinitionError(
            f"{path}: field {next(iter(content))!r} of {name} is unknown; remove it"
        )
    return DatasetFile(name, size, sha256)
