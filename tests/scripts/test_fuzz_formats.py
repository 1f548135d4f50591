"""A few of scripts/checks/fuzz_formats.py: damaged files are used, or refused in one line."""

from __future__ import annotations

from collections import Counter

import pytest
from scripted import load_script

from priorfill.errors import FormatError

fuzz = load_script("fuzz_formats")
SECONDS = load_script("fuzzing").SECONDS


class ShoutingError(FormatError):
    """An error whose message has several lines."""

    def __str__(self) -> str:
        return str(self.args[0])


FEW = 12
"""Damaged files of a kind in a test; the script alone takes tens of thousands."""


@pytest.mark.parametrize("kind", fuzz.KINDS)
def test_damaged_files(tmp_path, kind):
    ends: Counter[str] = Counter()
    for number in range(FEW):
        end, seconds = fuzz.run_case(fuzz.Case(7, number, str(tmp_path), kind))
        ends[end.partition(": ")[2]] += 1
        assert seconds < SECONDS
    assert ends["refused"] > 0


@pytest.mark.parametrize("kind", fuzz.KINDS)
def test_whole_files_are_used(tmp_path, monkeypatch, kind):
    """What is damaged must be right before, or nothing is tested."""
    for content in fuzz.KINDS[kind].whole():
        monkeypatch.setattr(fuzz, "mutate", lambda kind, seed, number, content=content: content)
        end, _ = fuzz.run_case(fuzz.Case(0, 0, str(tmp_path), kind))
        assert end.partition(": ")[2] in ("filled", "markers placed", "applied")


@pytest.mark.parametrize("kind", fuzz.KINDS)
def test_a_seed_makes_the_same_files(kind):
    files = [fuzz.mutate(kind, 3, number) for number in range(12)]
    assert files == [fuzz.mutate(kind, 3, number) for number in range(12)]
    assert len(set(files)) > 8


@pytest.mark.parametrize(
    ("fault", "expected"),
    [(ValueError("x"), ValueError), (ShoutingError("a\nb"), AssertionError)],
)
def test_faults_are_seen(tmp_path, monkeypatch, fault, expected):
    def read(path):
        raise fault

    monkeypatch.setattr(fuzz, "read", read)
    with pytest.raises(expected):
        fuzz.run_case(fuzz.Case(1, 1, str(tmp_path), "trc"))


def test_measured_samples_that_change_are_seen(tmp_path, monkeypatch):
    whole = fuzz.KINDS["trc"].whole()[0]
    monkeypatch.setattr(fuzz, "mutate", lambda kind, seed, number: whole)
    write = fuzz.write

    def changing(path, clip, filled):
        write(path, clip, filled)
        path.write_bytes(path.read_bytes().replace(b"\t1700.", b"\t1701."))

    monkeypatch.setattr(fuzz, "write", changing)
    with pytest.raises(AssertionError, match="a measured sample changed"):
        fuzz.run_case(fuzz.Case(1, 1, str(tmp_path), "trc"))
