"""Tables: without rich where the output is no terminal, with the same lines."""

import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from priorfill.cli import output
from priorfill.synthetic.demo import make_demo_clip

WORDS = st.text(st.characters(min_codepoint=33, max_codepoint=126), min_size=1, max_size=12)
TEXTS = st.lists(WORDS, max_size=4).map(" ".join)
NAMES = st.tuples(
    st.lists(TEXTS, min_size=1, max_size=2).map("\n".join), st.sampled_from(["", ">"])
)


@st.composite
def tables(draw: st.DrawFn) -> tuple[list[str], list[list[str]], list[int]]:
    names = ["".join(name) for name in draw(st.lists(NAMES, min_size=1, max_size=6))]
    row = st.lists(TEXTS, min_size=len(names), max_size=len(names))
    cells = draw(st.lists(row, max_size=4))
    _, least = output._layout(names, cells, output.WIDTH)
    return names, cells, least


@given(tables())
def test_plain_tables_are_those_of_rich(
    table: tuple[list[str], list[list[str]], list[int]],
) -> None:
    plain = [line.rstrip() for line in output._plain_lines(*table)]
    if plain:  # it fits
        assert plain == [line.rstrip() for line in output._styled_lines(*table)]


@pytest.mark.parametrize(
    "cells",
    [["é", "1"], ["a" * 50, "b " * 20], [" indented", "1"]],
    ids=["wide characters", "wrapped", "blanks"],
)
def test_others_are_left_to_rich(cells: list[str]) -> None:
    assert output._plain_lines(["name", "value>"], [["a", "b"]], [4, 5]) != []
    assert output._plain_lines(["name", "value>"], [cells], [4, 5]) == []


def test_a_fill_whose_output_is_no_terminal_imports_no_rich(tmp_path: Path) -> None:
    import priorfill as pf

    pf.write(tmp_path / "in.npz", make_demo_clip()[1])
    code = (
        "import sys\nfrom priorfill.cli import main\n"
        "try: main(['fill', 'in.npz', '-m', 'linear'])\n"
        "except SystemExit: pass\n"
        "print('rich' in sys.modules)"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tmp_path)
    assert "marker" in done.stdout
    assert done.stdout.splitlines()[-1] == "False"
