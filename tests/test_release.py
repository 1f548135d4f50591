"""What a release relies on: workflows, the conda recipe, checkouts with the same bytes."""

from __future__ import annotations

import re
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
RECIPE = (ROOT / "conda" / "recipe.yaml").read_text("utf-8")

OTHER_NAMES = {"matplotlib": "matplotlib-base"}
"""Packages that conda-forge calls otherwise."""


def jobs(text: str) -> dict[str, str]:
    """The text of each job of a workflow."""
    _, _, body = text.partition("\njobs:\n")
    names = re.split(r"^  (\w+):$", body, flags=re.MULTILINE)
    return dict(zip(names[1::2], names[2::2], strict=True))


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda file: file.name)
def test_actions_are_pinned(workflow: Path) -> None:
    for used in re.findall(r"uses: (.+)", workflow.read_text("utf-8")):
        assert re.fullmatch(r"[\w./-]+@[0-9a-f]{40} # v[\d.]+", used) or (ROOT / used).is_file()


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda file: file.name)
def test_workflows_name_what_is_there(workflow: Path) -> None:
    text = workflow.read_text("utf-8")
    for name in re.findall(r"\b(?:scripts|docs)/[\w./-]*\w", text):
        assert (ROOT / name).is_file(), name


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda file: file.name)
def test_commands_are_texts_in_yaml(workflow: Path) -> None:
    """Outside quotes, a colon and a space would make a command a mapping."""
    for command in re.findall(r"run: ([^|\"\n].*)", workflow.read_text("utf-8")):
        assert ": " not in command


def test_only_the_last_job_may_publish() -> None:
    text = (ROOT / ".github" / "workflows" / "release.yml").read_text("utf-8")
    *others, (name, last) = jobs(text).items()
    assert name == "publish"
    assert "needs: [build, test, install]" in last
    assert "id-token: write" in last
    assert all("write" not in job for _, job in others)
    assert "password" not in last


def test_the_supported_versions_of_python_are_tried() -> None:
    listed = re.findall(r"Python :: (3\.\d+)", " ".join(PROJECT["project"]["classifiers"]))
    text = (ROOT / ".github" / "workflows" / "release.yml").read_text("utf-8")
    assert re.findall(r'"(3\.\d+)"', jobs(text)["install"]) == listed
    assert PROJECT["project"]["requires-python"] == f">={listed[0]}"
    text = (ROOT / ".github" / "workflows" / "test.yml").read_text("utf-8")
    assert re.findall(r'"(3\.\d+)"', text) == [listed[0], listed[-1]]


def section(name: str) -> set[str]:
    """Requirements in a section of the recipe, as in ``pyproject.toml``."""
    _, _, rest = RECIPE.partition(f"\n  {name}:\n")
    lines = re.match(r"(?:    - .*\n)*", rest)
    assert lines is not None
    return {line[6:].replace(" ", "") for line in lines[0].splitlines()}


def conda(requirement: str) -> str:
    """A requirement with the name that conda-forge has for it."""
    name, bound, version = requirement.partition(">=")
    return OTHER_NAMES.get(name, name) + bound + version


def test_the_recipe_has_the_dependencies_of_the_package() -> None:
    project = PROJECT["project"]
    (oldest,) = re.findall(r'python_min: "(.*)"', RECIPE)
    assert project["requires-python"] == f">={oldest}"
    python = "python>=${{python_min}}"
    assert section("run") == {python, *map(conda, project["dependencies"])}
    optional = [name for group in project["optional-dependencies"].values() for name in group]
    assert section("run_constraints") == set(map(conda, optional))
    assert set(PROJECT["build-system"]["requires"]) <= section("host")


def test_the_recipe_has_the_metadata_of_the_package() -> None:
    project = PROJECT["project"]
    assert f'version: "{project["version"]}"' in RECIPE
    assert f"- priorfill = {project['scripts']['priorfill']}\n" in RECIPE
    assert f"summary: {project['description']}\n" in RECIPE
    assert f"license: {project['license']}\n" in RECIPE


def test_checkouts_have_the_same_bytes_on_all_systems() -> None:
    """Where git is set up to write the line ends of Windows, too."""
    try:
        line = ["git", "ls-files", "--eol", "-z"]
        done = subprocess.run(line, cwd=ROOT, capture_output=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("needs a git checkout")
    entries = [entry.split("\t") for entry in done.stdout.decode().split("\0") if entry]
    for description, name in entries:
        index, _, *attributes = description.split()
        if index == "i/-text":
            assert attributes[0] == "attr/-text", name
        else:
            assert index in ("i/lf", "i/none"), name
            assert attributes == ["attr/text=auto", "eol=lf"], name
