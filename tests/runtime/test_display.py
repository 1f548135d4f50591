"""Text of files made safe for terminals and spreadsheets."""

from __future__ import annotations

import csv
import io
import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st

from priorfill.errors import FormatError, OutputError
from priorfill.runtime.display import csv_cell, escaped, shell_command


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("LKNE", "LKNE"),
        ("Knöchel 膝 колено ركبة", "Knöchel 膝 колено ركبة"),
        ("a\x1b[31mb", r"a\x1b[31mb"),
        ("a\x9b1mb\x7f\0", r"a\x9b1mb\x7f\x00"),
        ("a\u202eb\u2066c\u200f\u061c", r"a\u202eb\u2066c\u200f\u061c"),
        ("a\u200bb\ufeff\xad", r"a\u200bb\ufeff\xad"),
        ("a\nb\r\tc\u2028", r"a\nb\r\tc\u2028"),
        ("\udcff.c3d", r"\udcff.c3d"),
        ("\U000e0041", r"\U000e0041"),
    ],
)
def test_what_has_no_glyph_is_made_visible(text: str, shown: str) -> None:
    assert escaped(text) == shown


@given(st.text())
def test_nothing_hidden_is_left_and_nothing_visible_is_lost(text: str) -> None:
    shown = escaped(text)
    hidden = {"Cc", "Cf", "Cs", "Zl", "Zp"}
    assert not any(unicodedata.category(character) in hidden for character in shown)
    visible = [character for character in text if unicodedata.category(character) not in hidden]
    assert not visible or all(character in shown for character in visible)
    assert escaped(shown) == shown


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1+2", "@SUM(A1)", "\t=1", "\r=1", " =1", "\n=1"])
def test_no_cell_is_a_formula(text: str) -> None:
    cell = csv_cell(text)
    assert cell.startswith("'")
    assert cell == f"'{escaped(text)}"
    assert csv_cell("LKNE") == "LKNE"


def test_a_cell_survives_the_csv_module() -> None:
    file = io.StringIO()
    csv.writer(file).writerow([csv_cell('=HYPERLINK("x","y")'), csv_cell("a,b\x1b")])
    assert next(csv.reader(io.StringIO(file.getvalue()))) == ['\'=HYPERLINK("x","y")', "a,b\\x1b"]


def test_messages_of_errors_are_one_line_of_bounded_length():
    assert str(OutputError("a\nb\x1b")) == r"a\nb\x1b"
    text = str(FormatError("a" * 10**6 + "; remedy"))
    assert len(text) < 2100
    assert text.endswith("a; remedy")


@pytest.mark.parametrize("path", ["Anna\u2019s takes", "Anna\u2019s", "a|b", "a&b", "a b"])
def test_paths_are_quoted_for_shells_of_windows(path: str) -> None:
    """For PowerShell, typographic quotes are quotes."""
    assert shell_command(["priorfill", path], windows=True) == f'priorfill "{path}"'
