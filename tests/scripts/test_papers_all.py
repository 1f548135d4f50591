"""The script that rewrites the page of published tables, on small pages and scripts."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

import pytest
from scripted import SCRIPTS, load_script

PAGE = """# Page
Text by hand.

### Table 1: `python scripts/papers/one.py`
```
old
```
Findings.

### The same, large: `python scripts/papers/one.py --database DIR`
```
of a database
```

### Table 2: `python scripts/papers/bad.py`
```
stays
```

### Counts: `python scripts/papers/all.py`
```
```
"""

ONE = """
import sys
if __name__ == "__main__":
    print(chr(10) + "Gløersen", *sys.argv[1:], "  ")
    print("3 of 4 cells are within 10% of the paper's")
    print("1 of 1 cells are within 10% of the paper's")
"""


@pytest.fixture
def script(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The script with a page and two scripts of its own; one of these fails."""
    module = load_script("all")
    (tmp_path / "page.md").write_text(PAGE, encoding="utf-8")
    (tmp_path / "one.py").write_text(ONE, encoding="utf-8")
    (tmp_path / "bad.py").write_text('if __name__ == "__main__":\n    exit(1)', encoding="utf-8")
    (tmp_path / "all.py").write_text("__main__", encoding="utf-8")
    (tmp_path / "shared.py").write_text("", encoding="utf-8")
    monkeypatch.setattr(module, "SCRIPTS", tmp_path)
    return module


def run(module: ModuleType, monkeypatch: pytest.MonkeyPatch, arguments: str) -> int:
    page = str(module.SCRIPTS / "page.md")
    monkeypatch.setattr(
        sys, "argv", ["all.py", "--data", "recordings", "--page", page, *arguments.split()]
    )
    status: int = module.main()
    return status


def page(module: ModuleType) -> str:
    text: str = (module.SCRIPTS / "page.md").read_text(encoding="utf-8")
    return text


def test_blocks_are_replaced_and_the_text_stays(
    script: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(script, monkeypatch, "") == 1  # one fails
    found = page(script)
    cells = "3 of 4 cells are within 10% of the paper's\n1 of 1 cells are within 10% of the paper's"
    counted = (
        "script    cells of the paper  within 10 %  others\n"
        "one                        5            4       1\n"
        "together                   5            4       1\n"
    )
    wanted = PAGE.replace("\nold", f"\nGløersen --data recordings\n{cells}")
    assert found == wanted.removesuffix("```\n") + counted + "```\n"
    printed = capsys.readouterr()
    assert printed.out == counted
    assert "[2/3] one --database DIR needs --database" in printed.err
    assert "failed: bad" in printed.err


def test_a_large_database_is_handed_on(script: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(script, monkeypatch, "--database store --only one.py") == 0
    assert "Gløersen --data recordings --database store" in page(script)
    assert "stays" in page(script)


def test_scripts_can_be_chosen(script: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(script, monkeypatch, "--only") == 0
    assert page(script).startswith(PAGE.removesuffix("```\n"))
    with pytest.raises(SystemExit, match="no script is called two"):
        run(script, monkeypatch, "--only two one")


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("bad.py", "worse.py", r"bad.py has no heading; worse.py does not exist"),
        ("```\nold", "old", r"one has no block"),
        (" --database DIR", "", r"one has two blocks"),
    ],
)
def test_headings_and_scripts_belong_together(
    script: ModuleType, monkeypatch: pytest.MonkeyPatch, old: str, new: str, fault: str
) -> None:
    changed = PAGE.replace(old, new, 1)
    (script.SCRIPTS / "page.md").write_text(changed, encoding="utf-8")
    with pytest.raises(SystemExit, match=fault):
        run(script, monkeypatch, "")
    assert page(script) == changed


def test_the_page_of_the_project_has_a_block_for_every_script() -> None:
    module = load_script("all")
    shown = {block.name for block in module.blocks(module.PAGE.read_text(encoding="utf-8"))}
    assert "gloersen_table1" in shown
    assert shown == {file.stem for file in (SCRIPTS / "papers").glob("*_*.py")} | {"all"}


def test_cells_are_compared_with_the_papers(capsys: pytest.CaptureFixture[str]) -> None:
    compared = load_script("paper").Comparison()
    compared.add("equal", 1.74, "1.7")
    compared.add("rounds to it", 1.4, "1", "not needed")
    compared.add("within 10 %", 109.9, "100")
    compared.add("above", 111.0, "100", "a stand-in")
    compared.add("below", 0.8, "1.0")
    compared.add("nothing", None, "5")
    compared.print()
    assert capsys.readouterr().out.splitlines()[1:] == [
        "3 of 6 cells are within 10% of the paper's",
        "  above: 111.0 mm (paper 100, +11%): a stand-in",
        "  below: 0.80 mm (paper 1.0, -20%)",
        "  nothing: - mm (paper 5, not filled)",
    ]


def test_a_page_that_is_not_there_is_named(
    script: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    (script.SCRIPTS / "page.md").unlink()
    with pytest.raises(SystemExit, match=r"page\.md: file not found"):
        run(script, monkeypatch, "")
