"""TOML files of users, read within bounds."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from priorfill.datasets.dataset_definitions import find_dataset
from priorfill.errors import FetchError, MarkerSetError, OptionError, PriorfillError
from priorfill.filling.overrides_file import read_overrides
from priorfill.markers.definitions import load
from priorfill.runtime.toml_file import MAX_BYTES, MAX_DEPTH, read_toml


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.toml"


def test_contents(path):
    path.write_bytes(b"\xef\xbb\xbfname = 'a'\r\n[t]\r\nx = [1, 2.5, true, \"K\xc3\xb6\"]\r\n")
    assert read_toml(path, OptionError) == {"name": "a", "t": {"x": [1, 2.5, True, "Kö"]}}


FAULTS = {
    "syntax": (b"a = 1\nb = = 2", r"is not valid TOML: .*line 2"),
    "nested arrays": (b"\na = " + b"[" * 50_000, "line 2 is nested more than 16 deep"),
    "nested tables": (b"a = " + b"{b=" * 400 + b"1" + b"}" * 400, "line 1 is nested"),
    "nested to a depth": (b"a = " + b"[" * (MAX_DEPTH + 1) + b"]" * (MAX_DEPTH + 1), "nested more"),
    "long key": (b"a" + b".a" * 50 + b" = 1", "has tables nested more than 16 deep"),
    "longer key": (b"x = 1\na" + b".a" * 30_000 + b" = 1", "line 2 has more than 100 dots"),
    "digits": (b"\n\na = " + b"9" * 5000, "has a number of too many digits in line 3"),
    "64 bits": (b"a = 0\nbytes = 99999999999999999999", "bytes is an integer of more than 64 bits"),
    "hexadecimal": (b"a = 0x" + b"f" * 20_000, "a is an integer of more than 64 bits"),
    "date": (b"name = 2020-01-01", r"name is a date or time \(2020-01-01\)"),
    "encoding": (b"a = 1\nb = '\xff'", "line 2 is not UTF-8; save it as UTF-8"),
    "utf-16": ("a = 1".encode("utf-16"), "line 1 is not UTF-8"),
    "size": (b"#" * (1 << 22) + b"#", "has more than (256|4096) KiB"),
    "old line ends": (b"a = 1\rb = 2\r", "a line ends with CR alone, which TOML does not have"),
    "zero": (b"a = '\0'", "is not valid TOML"),
    "line break in a key": (b'"a\\nb" = 2020-01-01', r"a\\nb is a date"),
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize(
    ("reader", "error"),
    [
        (lambda path: read_toml(path, OptionError), OptionError),
        (read_overrides, OptionError),
        (load, MarkerSetError),
        (lambda path: find_dataset(str(path)), FetchError),
    ],
    ids=["toml", "overrides", "marker set", "data set"],
)
def test_faults_are_reported_in_one_line(path, fault, reader, error):
    content, message = FAULTS[fault]
    path.write_bytes(content)
    start = time.process_time()
    with pytest.raises(error, match=message) as caught:
        reader(path)
    assert time.process_time() - start < 2
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(path))


def test_the_slowest_keys_take_seconds_at_most(path):
    line = ".".join("a" * 100)
    path.write_text("\n".join(f"b{i}.{line} = 1" for i in range(MAX_BYTES // 208 // 8)))
    start = time.process_time()
    with pytest.raises(OptionError, match="deep"):
        read_toml(path, OptionError)
    assert time.process_time() - start < 1  # an eighth of the largest file


def test_files_that_cannot_be_read(tmp_path):
    for path in (tmp_path, tmp_path / "none.toml", Path("a\0b.toml")):
        with pytest.raises(PriorfillError, match=r"cannot be read|not a regular file"):
            read_toml(path, MarkerSetError)
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe.toml")
        with pytest.raises(OptionError, match="is not a regular file"):
            read_overrides(tmp_path / "pipe.toml")


def test_a_file_that_another_program_keeps_for_itself(path, monkeypatch):
    path.write_text("a = 1")

    def refuse(*_args, **_keywords):
        error = PermissionError(13, "Permission denied")
        error.winerror = 32
        raise error

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(OptionError, match="permissions, and close it in other programs"):
        read_toml(path, OptionError)
