"""What the documents show is what the program reads and prints."""

from __future__ import annotations

import ast
import re
from dataclasses import replace
from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from gappy import person, with_gaps

from priorfill.cli import main
from priorfill.filling.overrides_file import read_overrides
from priorfill.formats import write
from priorfill.markers.definitions import load
from priorfill.methods import get_options
from priorfill.methods.options import with_values

ROOT = Path(__file__).parents[1]
COMMAND_LINE = (ROOT / "docs/cli.md").read_text(encoding="utf-8")
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks(path: Path, language: str) -> list[str]:
    """Return the examples of a page in a language."""
    text = path.read_text(encoding="utf-8")
    fenced = re.findall(r"^```(\w*)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    return [example for name, example in fenced if name == language]


def commands(group: click.Group, name: str = "") -> dict[str, click.Command]:
    """Return every command by its name, those of groups too."""
    context = click.Context(group)
    found = {}
    for part in group.list_commands(context):
        command = group.get_command(context, part)
        assert command is not None
        full = f"{name} {part}".strip()
        found |= commands(command, full) if isinstance(command, click.Group) else {full: command}
    return found


def test_the_example_of_a_marker_set_loads(tmp_path: Path) -> None:
    (example,) = blocks(ROOT / "database/markersets/README.md", "toml")
    path = tmp_path / "our-lower-body.toml"
    path.write_text(example, encoding="utf-8")
    marker_set = load(path)
    assert marker_set.name == "our-lower-body"
    needed = [label for label in marker_set.labels if label not in marker_set.optional]
    assert f"{len(needed)} markers" in marker_set.title


def test_the_example_of_overrides_is_read(tmp_path: Path) -> None:
    example, origin = blocks(ROOT / "docs/cli.md", "toml")
    path = tmp_path / "gaps.toml"
    path.write_text(origin + example, encoding="utf-8")
    overrides = read_overrides(path)
    frames = [(entry.first, entry.last) for entry in overrides.entries]
    assert frames == [(120, 180), (None, None), (301, 304), (410, 455), (None, None)]
    assert overrides.made_for is not None
    assert overrides.made_for.method == "gpr"
    options = overrides.entries[-1].options
    assert with_values(get_options("gpr"), options).max_expected_error == 50


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_examples_in_python_use_names_that_exist(page: Path) -> None:
    import priorfill as pf

    for example in blocks(page, "python"):
        for node in ast.walk(ast.parse(example)):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                if node.value.id == "pf":
                    assert hasattr(pf, node.attr), node.attr
                if node.value.id in ("gap", "result"):
                    kind = {"gap": pf.FilledGap, "result": pf.Result}[node.value.id]
                    known = {*kind.__dataclass_fields__, *vars(kind)}
                    assert node.attr in known, node.attr


def test_every_option_is_documented() -> None:
    missing = [
        f"{name} {option}"
        for name, command in commands(main).items()
        for parameter in command.params
        if isinstance(parameter, click.Option)
        for option in parameter.opts
        if option.startswith("--") and not re.search(rf"`{option}\b", COMMAND_LINE)
    ]
    assert missing == []


def test_the_table_of_a_fill_is_what_is_printed(here: Path) -> None:
    """The numbers of the example are those of another clip."""
    clip = replace(with_gaps(person(), (60, 120, ["LKNE"])), first_frame=1)
    write("walk.c3d", clip)
    printed = CliRunner().invoke(main, ["fill", "walk.c3d", "-o", "walk_filled.c3d"]).stdout
    assert without_numbers(printed) in [
        without_numbers(one) for one in blocks(ROOT / "docs/cli.md", "")
    ]


def without_numbers(text: str) -> str:
    """Return a text with its lengths in mm replaced, where widths may differ."""
    return re.sub(r" +[0-9]+\.[0-9](?![0-9])", " #", text)


ARCHITECTURE = ROOT / "ARCHITECTURE.md"
EQUATION = re.compile(r"\[(\w+)\] (\([\d.]+\)(?:(?:, |-)\([\d.]+\))*)")


def test_boxes_of_the_method_are_folders() -> None:
    (picture,) = blocks(ARCHITECTURE, "method")
    boxes = re.findall(r"│ ([a-z]\S*/) ", picture)
    assert len(boxes) > 9
    assert [box for box in boxes if not (ROOT / "priorfill" / box).is_dir()] == []


def test_equations_of_the_method_are_where_the_table_has_them() -> None:
    text = ARCHITECTURE.read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\[\w+\] \(.*?) \| (.*?) \| (.*?) \|$", text, re.MULTILINE)
    wrong = []
    for equation, _, places in rows:
        found = ""
        for path, name in re.findall(r"`(\S+\.py): (\w+)`", places):
            found += (ROOT / "priorfill" / path).read_text(encoding="utf-8")
            if not re.search(rf"^(def|class) {name}\b", found, re.MULTILINE):
                wrong.append(f"{path} has no {name}")
        for number in re.findall(r"\([\d.]+\)", equation):
            cited = number.strip("()") if "." in number else number
            if cited not in found:
                wrong.append(f"{places} has no Eq. {number}")
    assert wrong == []
    (picture,) = blocks(ARCHITECTURE, "method")
    in_table = {paper for equation, *_ in rows for paper, _ in EQUATION.findall(equation)}
    assert {paper for paper, _ in EQUATION.findall(picture)} <= in_table
