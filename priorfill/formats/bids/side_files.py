"""What the side files of a recording state: its channels, sampling frequency and axes."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from priorfill.errors import FormatError
from priorfill.formats.bids.names import BidsName, mask_file, side_files
from priorfill.formats.file_bytes import read_bounded, read_bytes
from priorfill.formats.tables.cells import join_quoted, line_number, split_lines, texts_of
from priorfill.formats.tables.numbers import header_number, shown

__all__ = ["UP_AXIS", "Channel", "SideFiles", "number_of_field", "read_side_files"]

_MAX_BYTES = 1 << 24
"""Size limit of a side file: 200,000 channels of 80 bytes."""

_MAX_DIGITS = 1000
"""Digits of a number; Python converts 4300."""

_REQUIRED = ("type", "component", "tracked_point")
"""Columns of ``_channels.tsv`` without which a position has no place."""

_NOT_STATED = "n/a"
"""The word of BIDS for a value that is not there."""

_VERTICAL = {"S": "+", "U": "+", "I": "-", "D": "-"}
"""Letters of ``SpatialAxes`` for a vertical axis: superior and inferior; in drafts up and down."""

UP_AXIS = "UpAxis"
"""Field of priorfill for the axis that points up: BIDS describes three axes or none."""

_DELIMITER = b"\t"


@dataclass(frozen=True)
class Channel:
    """A column of a recording, by the columns of ``_channels.tsv``; empty where n/a.

    Attributes
    ----------
    kind : str
        Type in upper case, such as POS.
    component : str
        Axis in lower case.
    tracked_point : str
        Name of the marker.
    units : str
        Unit.
    frame : str
        Reference frame.
    status : str
        ``good`` or ``bad``.
    name : str
        Name of the channel.
    rate : float or None
        Sampling frequency (Hz).
    """

    kind: str
    component: str
    tracked_point: str
    units: str = ""
    frame: str = ""
    status: str = ""
    name: str = ""
    rate: float | None = None


@dataclass(frozen=True)
class SideFiles:
    """What the side files of a recording state.

    Attributes
    ----------
    channels : tuple of Channel
        The columns of the recording.
    channels_file : Path
        The ``_channels.tsv`` that describes them.
    motion : mapping
        Fields of ``_motion.json``.
    channel_fields : mapping
        Fields of ``_channels.json``.
    mask : bytes
        Contents of ``_mask.tsv`` of a derivative: 1 for filled samples; empty if absent.
    """

    channels: tuple[Channel, ...]
    channels_file: Path
    motion: Mapping[str, Any]
    channel_fields: Mapping[str, Any]
    mask: bytes = b""

    def up_axis(self, frame: str) -> str:
        """Return the axis that points up in a reference frame; empty if none is stated.

        Parameters
        ----------
        frame : str
            Name of the reference frame.
        """
        level: Any = self.channel_fields
        for key in ("reference_frame", "Levels", frame):
            level = level.get(key) if isinstance(level, dict) else None
        fields = level if isinstance(level, dict) else {}
        # drafts of Motion-BIDS had the axes in _motion.json
        axes = str(fields.get("SpatialAxes", self.motion.get("SpatialAxes", ""))).upper()
        for letter, sign in _VERTICAL.items():
            if len(axes) == len("XYZ") and letter in axes:
                return sign + "XYZ"[axes.index(letter)]
        return str(fields.get(UP_AXIS, ""))


def read_side_files(path: Path) -> SideFiles:
    """Read the side files of a recording.

    Parameters
    ----------
    path : Path
        The recording.

    Raises
    ------
    FormatError
        If there is no ``_channels.tsv``, or a side file is damaged.
    """
    found = side_files(path, "channels", ".tsv")
    if not found:
        name = BidsName.parse(path.name)
        wanted = "_".join((*name.entities, "channels.tsv"))
        raise FormatError(
            f"{path}: has no {wanted}, which names its columns, in its folder or in those of its "
            "dataset above; put it there"
        )
    mask = mask_file(path)
    return SideFiles(
        _read_channels(found[-1]),
        found[-1],
        _merged(side_files(path, "motion", ".json")),
        _merged(side_files(path, "channels", ".json")),
        b"" if mask is None else read_bounded(mask),
    )


def number_of_field(value: Any) -> float | None:
    """Return the finite number of a JSON field, also if it is a string; None if there is none."""
    if isinstance(value, str):
        return header_number(value)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def _merged(paths: list[Path]) -> dict[str, Any]:
    """Return the fields of JSON files; those of later ones replace those of earlier ones."""
    merged: dict[str, Any] = {}
    for path in paths:
        data = read_bytes(path, max_bytes=_MAX_BYTES)
        try:
            fields = json.loads(data.decode("utf-8-sig"), parse_int=_integer)
            json.dumps(fields, ensure_ascii=False).encode()
        except RecursionError:
            raise FormatError(f"{path}: is nested too deep; correct it") from None
        except UnicodeEncodeError:
            raise FormatError(f"{path}: has text that is not Unicode; correct it") from None
        except ValueError as error:
            raise FormatError(f"{path}: is not JSON ({error}); correct it") from None
        if not isinstance(fields, dict):
            raise FormatError(f"{path}: is not a JSON object ({{...}}); correct it")
        merged |= fields
    return merged


def _integer(digits: str) -> int:
    """Return an integer of JSON."""
    if len(digits) > _MAX_DIGITS:
        raise ValueError(f"a number of {len(digits)} digits")
    return int(digits)


def _read_channels(path: Path) -> tuple[Channel, ...]:
    """Return the channels of a ``_channels.tsv`` in order."""
    data = read_bytes(path, max_bytes=_MAX_BYTES)
    lines = join_quoted(split_lines(data, path.name), _DELIMITER, path.name)
    rows = [row for row, line in enumerate(lines) if line.strip()]
    titles = [title.lower() for title in texts_of(lines[rows[0]], _DELIMITER)]
    for title in _REQUIRED:
        if title not in titles:
            raise FormatError(
                f"{path}: has no column {title} (the first line is "
                f"{shown(lines[rows[0]].strip())}); add it"
            )
    channels = []
    for row in rows[1:]:
        texts = texts_of(lines[row], _DELIMITER)
        if any(texts[len(titles) :]):
            raise FormatError(
                f"{path}: line {line_number(lines, row)} has {len(texts)} cells, and the first "
                f"line has {len(titles)}; correct the line"
            )
        channels.append(_channel(dict(zip(titles, texts, strict=False))))
    if not channels:
        raise FormatError(f"{path}: names no channels; add a line for each column of the recording")
    return tuple(channels)


def _channel(texts: dict[str, str]) -> Channel:
    """Return a channel from the cells of its row by title."""
    cells = {key: "" if text.lower() == _NOT_STATED else text for key, text in texts.items()}
    return Channel(
        kind=cells.get("type", "").upper(),
        component=cells.get("component", "").lower(),
        tracked_point=cells.get("tracked_point", ""),
        units=cells.get("units", ""),
        frame=cells.get("reference_frame", ""),
        status=cells.get("status", "").lower(),
        name=cells.get("name", ""),
        rate=header_number(cells.get("sampling_frequency")),
    )
