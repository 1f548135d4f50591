"""Files other than C3D through the command line."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import text_files as files
from db_cli import LABELS, run, small_clip

from priorfill import formats
from priorfill.clip import Clip
from priorfill.database import PriorDatabase

WRITERS = {
    "walk.trc": (files.trc, (1, 2, 0), 1.0, {"missing": "", "decimals": 5}),
    "metres.trc": (files.trc, (1, 2, 0), 0.001, {"unit": "m", "decimals": 6}),
    "nexus.csv": (files.nexus, (0, 1, 2), 1.0, {}),
    "qualisys.tsv": (files.qualisys, (0, 1, 2), 1.0, {}),
    "motive.csv": (files.motive, (1, 2, 0), 0.001, {}),
}


def export(name: str, clip: Clip) -> Path:
    write, axes, scale, options = WRITERS[name]
    options = options | {"rate": f"{clip.rate:g}" if write is files.qualisys else int(clip.rate)}
    options |= {} if write is files.qualisys else {"first": clip.first_frame}
    Path(name).write_bytes(write(clip.positions[..., axes] * scale, clip.labels, **options))
    return Path(name)


def changed_lines(before: Path, after: Path) -> int:
    old, new = (path.read_bytes().split(b"\n") for path in (before, after))
    assert len(old) == len(new)
    return sum(a != b for a, b in zip(old, new, strict=True))


def gappy() -> Clip:
    clip = small_clip("walk", 3)
    positions = clip.positions.copy()
    positions[40:50, 3] = np.nan
    return replace(clip, positions=positions, first_frame=11)


@pytest.mark.parametrize("name", WRITERS)
def test_fill_inspect_and_db_add(here, name):
    file = export(name, gappy())
    facts = json.loads(run("inspect", file, "--json").stdout)
    assert facts["labels"] == list(LABELS)
    assert facts["missing_samples"] == 10
    out = Path(f"out{file.suffix}")
    result = run("fill", file, "-o", out, "-m", "pchip", "-d", "db", "--add-to-database", "--json")
    assert result.exit_code == 0, result.stderr
    filled = json.loads(result.stdout)
    assert (filled["filled_samples"], filled["complete"]) == (10, True)
    assert 0 < filled["rounding_mm"] < 0.001
    assert filled["added"]
    assert changed_lines(file, out) == 10
    assert not formats.read(out).missing.any()
    assert run("db", "add", "-v", "-d", "other", file).stdout.startswith(f"added {file}")


def test_a_new_file_of_another_format_joins_the_database(here):
    file = export("metres.trc", gappy())
    Path("metres.trc").write_bytes(file.read_bytes().replace(b"\tm\t", b"\tells\t"))
    line = ["fill", file, "-m", "pchip", "--unit", "m", "-d", "db", "--add-to-database"]
    result = run(*line, "-o", "out.c3d")
    assert result.exit_code == 0, result.stderr
    assert "added to db" in result.stdout
    with PriorDatabase.open("db") as database:  # read again in the unit of the new file
        assert np.nanmax(np.abs(database.positions(*database.clips()))) < 5000
    assert np.allclose(
        formats.read("out.c3d").positions, formats.read("out.c3d", unit="mm").positions
    )
    refused = run(*line, "-o", "out.csv")
    assert refused.exit_code == 2
    assert "only as a copy of a .csv file" in refused.stderr


def test_a_folder_of_recordings_and_other_files(here):
    Path("in").mkdir()
    export("nexus.csv", gappy()).rename("in/nexus.csv")
    np.savez("in/weights.npz", weights=np.zeros(3))
    Path("in/notes.txt").write_text("felt unwell\n")
    Path("in/table.csv").write_text("a,b\n1,2\n")
    result = run("db", "add", "-v", "-d", "db", "in")
    assert result.exit_code == 0, result.stderr
    assert result.stdout.splitlines()[0] == f"added {Path('in/nexus.csv')}"


@pytest.mark.realdata
@pytest.mark.parametrize("name", WRITERS)
def test_real_recordings(here, data, name):
    clip = formats.read(data / "gait" / "HC002D06.c3d")
    positions = clip.positions.copy()
    positions[100:130, [3, 10]] = np.nan
    lost = np.isnan(positions[..., 0]) & ~clip.missing
    file = export(name, clip.with_positions(positions))
    out = Path(f"out{file.suffix}")
    result = run("fill", file, "-o", out, "--json")
    assert result.exit_code == 0, result.stderr
    assert json.loads(result.stdout)["filled_samples"] == lost.sum() + clip.missing.sum()
    filled = formats.read(out).positions[..., np.argsort(WRITERS[name][1])]
    error = np.linalg.norm(filled - clip.positions, axis=2)
    assert error[lost].mean() < 3
    assert error[~lost & ~clip.missing].max() < 0.002  # the digits of the text
