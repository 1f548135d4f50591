"""The derivative dataset of BIDS that a filled recording is in: its root and its description."""

from __future__ import annotations

import json
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

from priorfill.errors import OptionError
from priorfill.filling.provenance import package_versions
from priorfill.formats.bids.create_motion import json_bytes
from priorfill.formats.bids.names import DESCRIPTION, BidsName, dataset_root
from priorfill.runtime.atomic_file import check_writable, replace_file

__all__ = ["check_dataset", "describe_dataset", "source_address"]

_BIDS_VERSION = "1.10.0"

_LINK = "raw"
"""Name of the source dataset in BIDS addresses."""

_IGNORED = "# files for which the BIDS validator has no rules\n" + "".join(
    f"{pattern}\n"
    for pattern in (
        "*_motion.tsv",
        "*_motion.json",
        "*_mask.tsv",
        "*_error.tsv",
        "desc-*_mask.json",
        "desc-*_error.json",
        "*.html",
        "*.npz",
        "*.toml",
        "summary.*",
        ".priorfill/",
    )
)
"""Contents of ``.bidsignore``: the validator knows no derivatives of motion, and a study adds
pages."""

_README = """\
Filled recordings of motion capture
===================================

priorfill has estimated samples that were missing. For each recording:

* ..._motion.tsv: all samples, measured ones unchanged; those that could not be filled are n/a.
* ..._mask.tsv: the same rows and columns; 1 where the sample is filled, 0 elsewhere.
* ..._error.tsv: a row for each row of the recording; for each tracked point the expected mean error
  of a filled sample, and the bound below which 90 % of the errors are expected, both in mm;
  n/a where the sample is not filled.
"""

_MASK = {
    "Description": (
        "The rows and columns of the recording: 1 where the sample is filled, 0 where it is "
        "measured or missing."
    )
}

_ERROR = {
    "Description": (
        "A row for each row of the recording. NAME_expected_mean_error_mm: expected mean distance "
        "of a filled sample of the tracked point NAME from the true position. "
        "NAME_error_bound_90_mm: distance below which 90 % of the errors are expected. "
        "n/a: not filled, or unknown."
    ),
    "Units": "mm",
}


def check_dataset(output: Path) -> None:
    """Check before a fill whether a dataset may hold a filled recording.

    Parameters
    ----------
    output : Path
        The filled recording; nothing is checked if it is in no dataset.

    Raises
    ------
    OptionError
        If the dataset is one of raw recordings.
    OutputError
        If the dataset cannot be written.
    """
    root = _root(output)
    if root is None:
        return
    if (root / DESCRIPTION).exists():
        kind = _fields_of(root / DESCRIPTION).get("DatasetType", "raw")
        if kind != "derivative":
            raise OptionError(
                f"{output}: {root} is a dataset of the type {kind}, in which BIDS permits no "
                f"filled recordings; write to {root / 'derivatives' / 'priorfill'}"
            )
    check_writable(root / DESCRIPTION, 0)


def source_address(output: Path, source: Path) -> str:
    """Return the BIDS address of the source of a filled recording; empty if unknown.

    Parameters
    ----------
    output : Path
        The filled recording.
    source : Path
        The recording that is filled.
    """
    link, root, raw = _raw_dataset(output, source), _root(output), dataset_root(source)
    if not link or root is None or raw is None:
        return ""
    if (root / DESCRIPTION).exists():
        links = _fields_of(root / DESCRIPTION).get("DatasetLinks")
        if not isinstance(links, dict) or links.get(_LINK) != link:
            return ""
    place = Path(os.path.abspath(source)).relative_to(raw)  # noqa: PTH100, keeps links
    return f"bids:{_LINK}:{place.as_posix()}"


def describe_dataset(output: Path, source: Path | None) -> None:
    """Write the files at the root of a derivative dataset that are not there yet.

    Parameters
    ----------
    output : Path
        A filled recording; nothing is done if it is in no dataset.
    source : Path or None
        The recording that is filled, if it is of a BIDS dataset.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    root = _root(output)
    if root is None:
        return
    desc = "desc-" + BidsName.parse(output.name).label("desc")
    described: dict[str, Any] = {
        "Name": "Filled recordings of motion capture",
        "BIDSVersion": _BIDS_VERSION,
        "DatasetType": "derivative",
        "GeneratedBy": [{"Name": "priorfill", "Version": package_versions()["priorfill"]}],
    }
    link = "" if source is None else _raw_dataset(output, source)
    if link:
        described |= {"SourceDatasets": [{"URL": link}], "DatasetLinks": {_LINK: link}}
    table = f"desc_id\tdescription\n{desc}\tgaps filled; see _mask.tsv and _error.tsv\n"
    contents = {
        DESCRIPTION: json_bytes(described),
        "README": _README.encode(),
        "descriptions.tsv": table.encode(),
        ".bidsignore": _IGNORED.encode(),
        f"{desc}_mask.json": json_bytes(_MASK),
        f"{desc}_error.json": json_bytes(_ERROR),
    }
    for name, content in contents.items():
        if not (root / name).exists():
            # another job of a study may write it at the same time, with the same contents
            with replace_file(root / name, overwrite=True) as temporary:
                temporary.write_bytes(content)


def _root(output: Path) -> Path | None:
    """Return the root of the dataset that a recording is written to; None outside of one.

    Its folders are those of BIDS: ROOT/sub-01/ses-a/motion.
    """
    name = BidsName.parse(output.name)
    folder = Path(os.path.abspath(output)).parent  # noqa: PTH100, does not resolve links
    inside = ["motion"]
    inside += [f"{key}-{name.label(key)}" for key in ("ses", "sub") if name.label(key)]
    for one in inside:
        if folder.name != one:
            return None
        folder = folder.parent
    return folder


def _raw_dataset(output: Path, source: Path) -> str:
    """Return the path from a derivative dataset to that of the source; empty if unknown."""
    root, raw = _root(output), dataset_root(source)
    if root is None or raw is None or raw == root:
        return ""
    with suppress(ValueError):  # on another drive
        return Path(os.path.relpath(raw, root)).as_posix()
    return ""


def _fields_of(path: Path) -> dict[str, Any]:
    """Return the fields of a JSON file; none if it is damaged."""
    with suppress(OSError, ValueError, RecursionError):
        fields = json.loads(path.read_text(encoding="utf-8-sig"))
        if isinstance(fields, dict):
            return fields
    return {}
