"""Recordings of Motion-BIDS with their side files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from text_files import LABELS, number, standing

NAME = "sub-01_task-walk_tracksys-omc"


@dataclass(frozen=True)
class Column:
    """A channel with its line of ``_channels.tsv``, and its numbers."""

    component: str
    kind: str
    tracked_point: str
    units: str
    values: np.ndarray
    frame: str = "lab"
    status: str = "good"

    def line(self) -> str:
        name = f"{self.tracked_point}_{self.kind}_{self.component}"
        cells = (self.component, self.kind, self.tracked_point, self.units, self.frame, self.status)
        return "\t".join((name, *cells))


TITLES = "name\tcomponent\ttype\ttracked_point\tunits\treference_frame\tstatus"


def columns_of(
    positions: np.ndarray, labels: Sequence[str] = LABELS, unit: str = "mm"
) -> list[Column]:
    """The channels of markers [shape=(frames, markers, 3), in the unit]."""
    return [
        Column("xyz"[axis], "POS", label, unit, positions[:, k, axis])
        for k, label in enumerate(labels)
        for axis in range(3)
    ]


def gappy() -> np.ndarray:
    positions = standing()
    positions[3:6, 2] = np.nan
    return positions


def other_columns(frames: int) -> list[Column]:
    t = np.arange(frames)
    return [
        Column("x", "ACCEL", "LTOE", "m/s^2", np.sin(t)),
        Column("n/a", "LATENCY", "n/a", "s", t / 100),
        Column("quat_w", "ORNT", "LTOE", "n/a", np.cos(t)),
    ]


def channels_text(columns: Sequence[Column]) -> str:
    return "\n".join([TITLES, *(column.line() for column in columns)]) + "\n"


def motion_text(columns: Sequence[Column], decimals: int = 6, missing: str = "n/a") -> str:
    rows = zip(*(column.values for column in columns), strict=True)
    return "".join(
        "\t".join(number(value, decimals, missing) for value in row) + "\n" for row in rows
    )


def write_dataset(
    root: Path, columns: Sequence[Column], fields: dict[str, Any] | None = None, name: str = NAME
) -> Path:
    """A dataset of one recording; return the recording."""
    folder = root / "sub-01" / "motion"
    folder.mkdir(parents=True)
    (root / "dataset_description.json").write_text('{"Name": "x", "BIDSVersion": "1.10.0"}')
    path = folder / f"{name}_motion.tsv"
    path.write_bytes(motion_text(columns).encode())
    path.with_name(f"{name}_channels.tsv").write_bytes(channels_text(columns).encode())
    described = {"SamplingFrequency": 100, "TaskName": "walk"} if fields is None else fields
    path.with_suffix(".json").write_text(json.dumps(described))
    return path
