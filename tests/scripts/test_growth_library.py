"""`growth_study.py --library`: parts of a library, and the errors with each of them."""

from __future__ import annotations

import json
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import pytest
from gappy import ARM, person, with_gaps
from scripted import load_script

import priorfill as pf

growth_study = load_script("growth_study")
library = growth_study.growth_library

BODIES = range(3)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two recordings of each of three people."""
    (tmp_path / "takes").mkdir()
    for number, body in enumerate((*BODIES, *BODIES)):
        clip = person(seconds=1.6, rate=30.0, seed=number, body=body)
        pf.write(tmp_path / "takes" / f"take{number}.c3d", clip)
    return tmp_path / "takes"


def test_a_library_is_studied(folder: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(library, "KINDS", ("arm", "legs"))
    monkeypatch.setattr(library, "process_pool", lambda _: nullcontext(SimpleNamespace(map=map)))
    output = folder.parent / "out"
    line = f"growth_study.py --library {folder} --sizes 2 --cases 1 -o {output}"
    monkeypatch.setattr("sys.argv", line.split())
    assert growth_study.main() == 0
    rows = [library.Row(**row) for row in json.loads((output / "growth.json").read_text())]
    assert [row.takes for row in rows] == 2 * [0, 2, 2, 4, 4]
    assert len({row.name for row in rows}) == 2, "no take is used twice"
    assert all(row.error > 0 for row in rows)
    printed = capsys.readouterr().out
    found = library.ratios(rows, ("arm",), "strangers")
    assert f"| arm (1) | strangers | {found[2]:.2f} | {found[4]:.2f} |" in printed
    assert (output / "growth.png").stat().st_size > 1000


def test_only_the_takes_of_a_part_are_learnt_from(folder: Path, tmp_path: Path) -> None:
    path = library._opened(folder, tmp_path)
    gappy = with_gaps(person(seconds=1.6, rate=30.0, seed=9), (15, 30, ARM))
    with library.PartOfDatabase.open(path) as database:
        assert database.clips() == ()
        every = pf.PriorDatabase.clips(database)
        assert len({record.subject for record in every}) == len(BODIES)
        database.kept = frozenset(record.content for record in every[:2])
        assert database.clips() == every[:2]
        used = {name for gap in pf.fill(gappy, database=database).gaps for name in gap.source_clips}
    assert used <= {gappy.name, *(record.name for record in every[:2])}
