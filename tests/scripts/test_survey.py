"""scripts/checks/survey.py: its results for good files, unusual files and faults."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from c3d_bytes import DEC, LABELS, MIPS, C3DFile, standing
from scripted import load_script

from priorfill.formats import read_c3d, write_c3d
from priorfill.formats.c3d import patch as c3d_patch

survey = load_script("survey")


def job(path: Path, tmp_path: Path) -> survey.Job:
    return survey.Job(path, tmp_path / "out.c3d", "linear", 0.03)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "in.c3d"
    path.write_bytes(C3DFile(standing(), LABELS).bytes())
    return path


@pytest.mark.parametrize("processor", [DEC, MIPS])
@pytest.mark.parametrize("is_float", [True, False])
def test_a_good_file_passes(tmp_path, processor, is_float):
    path = tmp_path / "in.c3d"
    records = standing(step=None if is_float else 0.1)
    path.write_bytes(C3DFile(records, LABELS, processor=processor, is_float=is_float).bytes())
    row = survey.survey_file(job(path, tmp_path))
    assert (row.failure, row.passed, row.samples) == ("", survey.STEPS[:4], 3)
    if processor == DEC:
        assert survey.compare_with_ezc3d(job(path, tmp_path)) == ""


def odd_files() -> dict[str, C3DFile]:
    """Files that are odd, and right: what is filled goes into a copy of each."""
    many = np.concatenate([standing(), np.full((12, 300, 4), 500.0)], axis=1)
    long = np.zeros((70_000, 2, 4))
    long[:, 0, 2], long[:, 1, 2] = 100 + np.arange(70_000) % 7, 1700
    analog = np.ones((12, 4, 5))
    return {
        "latin-1": C3DFile(
            standing(), [*LABELS[:-1], b"Fu\xdf"], parameters={"PROCESSING": {"U": b"kg/m\xb2"}}
        ),
        "more labels than points": C3DFile(standing(), [*LABELS, "EXTRA1", "EXTRA2"]),
        "LABELS2": C3DFile(many, [*LABELS, *(f"M{i:03d}" for i in range(300))]),
        "another analog count": C3DFile(standing(), LABELS, analog=analog, header={"analog": 7}),
        "no analog scale": C3DFile(
            standing(), LABELS, analog=analog, omit=(("ANALOG", "SCALE"), ("ANALOG", "OFFSET"))
        ),
        "70,000 frames": C3DFile(
            long,
            ["LANK", "LFHD"],
            is_float=False,
            scale=1.0,
            first_frame=5,
            header={"last": 65535},
            parameters={"POINT": {"FRAMES": 65535, "LONG_FRAMES": 70_000.0}},
        ),
        "two of a label": C3DFile(
            standing(), ["RKNE", "RKNE", *LABELS[2:5], *LABELS[7:], "A", "B"]
        ),
    }


@pytest.mark.parametrize("what", odd_files())
def test_an_odd_file_passes(tmp_path, what):
    path = tmp_path / "in.c3d"
    path.write_bytes(odd_files()[what].bytes())
    row = survey.survey_file(job(path, tmp_path))
    assert (row.failure, row.passed) == ("", survey.STEPS[:4])
    assert row.samples >= 3


@pytest.mark.parametrize(
    ("place", "fault"),
    [(2, "bytes outside the filled samples differ"), (1, "a filled sample is read back elsewhere")],
)
def test_a_fault_is_seen(file, tmp_path, monkeypatch, place, fault):
    """A writer that gets a byte of the header, or of a filled position, wrong."""

    def spoil(path, clip, filled, **options):
        write_c3d(path, clip, filled, **options)
        content = bytearray(path.read_bytes())
        frame, marker = np.argwhere(filled)[0]
        at = 30 if place == 2 else C3DFile(standing(), LABELS).offset(frame, marker) + 2
        content[at] ^= 0x40
        path.write_bytes(bytes(content))

    monkeypatch.setattr(survey, "write_c3d", spoil)
    row = survey.survey_file(job(file, tmp_path))
    assert (row.failure, row.passed) == (fault, ("read", "filled", "byte-exact")[: 4 - place])


def test_another_sample_read_back(file, tmp_path):
    clip = read_c3d(file)
    moved = clip.positions.copy()
    moved[3, 4, 0] += 1e-3
    filled = np.zeros_like(clip.missing)
    c3d_patch.write_c3d(tmp_path / "out.c3d", clip, filled)
    fault = survey._fault(clip.with_positions(moved), clip, filled, clip, tmp_path / "out.c3d")
    assert fault == "a sample that was not filled is read back as another"


def test_table_of_good_and_bad_files(file, tmp_path, capsys):
    (tmp_path / "bad.C3D").write_bytes(file.read_bytes()[:900])
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "empty.c3d").write_bytes(b"")
    assert survey.main([str(tmp_path)]) == 1
    text = capsys.readouterr().out
    assert "3 files, 10 samples filled: 33.3% read, 33.3% byte-exact" in text
    name = Path("sub", "empty.c3d")
    assert f"    1  is empty; copy or export the recording again ({name})" in text
    assert "bad.C3D" in text
    assert sorted(path.name for path in tmp_path.rglob("*.*")) == ["bad.C3D", "empty.c3d", "in.c3d"]


def test_no_file(tmp_path, capsys):
    assert survey.main([str(tmp_path)]) == 1
    assert "contains no C3D file" in capsys.readouterr().err
