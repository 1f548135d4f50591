"""Data flow one way: the import rules of ARCHITECTURE.md, late imports included."""

from __future__ import annotations

import ast
import re
from functools import cache
from graphlib import TopologicalSorter

import pytest
from package_source import PACKAGE as ROOT
from package_source import modules, tree_of

DOCUMENT = ROOT.parent / "ARCHITECTURE.md"

ONLY_IN = {
    "click": ("cli",),
    "rich": ("cli",),
    "distributed": ("study.dask_executor", "study.dask_task"),
    "filelock": ("runtime.file_lock",),
    "pooch": ("datasets",),
    "psutil": ("study",),
    "re2": ("datasets",),
    "requests": ("datasets",),
    "urllib3": ("datasets",),
    "matplotlib": (
        "evaluation.plots",
        "report.figures",
        "report.gap_figure",
        "report.notebook_figure",
    ),
    "ezc3d": ("formats",),
    "starlette": ("reviewing.server",),
    "uvicorn": ("reviewing.server",),
    "numba": ("runtime.numba_compiler",),
    "llvmlite": ("runtime.machine_code", "runtime.numba_compiler"),
    "platformdirs": ("runtime.code_files",),
}
"""Packages of others, and the only places that import them."""

ARRAYS_ONLY = (
    "geometry",
    "signal",
    "constraints",
    "gp",
    "energy",
    "search.kernels",
    "artefacts.discontinuities",
    "artefacts.distance_outliers",
    "artefacts.inconsistent_labels",
    "artefacts.label_swaps",
    "artefacts.marker_path",
    "artefacts.mislabelled",
    "artefacts.outlier_runs",
    "artefacts.reference_markers",
    "artefacts.spikes",
    "artefacts.stuck",
    "methods.gloersen2016.weighted_pca",
    "methods.gpr.blackout.correction",
    "methods.gpr.blackout.curves",
    "methods.gpr.blackout.predict_blackout",
    "methods.gpr.blackout.stacking",
    "methods.gpr.blackout.window_layout",
    "methods.gpr.blackout.windows",
    "methods.gpr.dropout.marker_coupling",
    "methods.gpr.dropout.predict_from_donors",
    "methods.gpr.sources.combine",
    "methods.gpr.sources.gap_layout",
    "methods.gpr.sources.similar_windows",
    "methods.gpr.sources.window_regression",
    "methods.gpr.training.lagged_poses",
)
"""Places that see arrays, and neither clips nor tasks."""

EVALUATION_ORDER = (
    "body_parts",
    "gap_generator",
    "protocols",
    "joint_angles",
    "metrics",
    "gap_case",
    "evaluation_plan",
    "summary_tables",
    "evaluation_results",
    "outcome_store",
    "runner",
)
"""The modules of ``evaluation``; each imports only those before it."""


def _is_typing_only(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)


def _imported(tree: ast.Module) -> set[tuple[str, str]]:
    """Modules and names that a module imports, in functions too, but not for types only."""
    found, pending = set(), list(tree.body)
    while pending:
        node = pending.pop()
        if _is_typing_only(node):
            continue
        if isinstance(node, ast.ImportFrom) and node.level == 0:
            found |= {(node.module or "", alias.name) for alias in node.names}
        elif isinstance(node, ast.Import):
            found |= {(alias.name, "") for alias in node.names}
        pending += ast.iter_child_nodes(node)
    return found


@cache
def imports() -> dict[str, set[str]]:
    """The modules that each module below ``priorfill`` imports; those of priorfill shortened."""
    files = {
        ".".join(f.relative_to(ROOT).with_suffix("").parts).removesuffix("__init__").rstrip("."): f
        for f in modules()
    }
    found = {}
    for module, file in files.items():
        names = set()
        for source, name in _imported(tree_of(file)):
            if source == "priorfill" or source.startswith("priorfill."):
                inner = source.removeprefix("priorfill").lstrip(".")
                whole = f"{inner}.{name}".lstrip(".")
                names.add(whole if whole in files else inner)
            else:
                names.add(f"/{source}")
        found[module] = names - {module}
    return found


def within(name: str, *places: str) -> bool:
    """Whether a module is one of some places, or below one."""
    return any(name == place or name.startswith(f"{place}.") for place in places)


def part_of(module: str) -> str:
    """The folder or top-level module that a module belongs to, a method's own folder included."""
    first, *rest = module.split(".")
    if first == "methods" and rest and (ROOT / "methods" / rest[0]).is_dir():
        return f"methods.{rest[0]}"
    return first


@cache
def rules() -> dict[str, set[str]]:
    """What each part may import: the block of ARCHITECTURE.md whose lines are ``part: others``."""
    text = DOCUMENT.read_text(encoding="utf-8")
    (block,) = re.findall(r"```imports\n(.*?)```", text, flags=re.DOTALL)
    lines = (line.partition(":") for line in block.splitlines())
    return {part.strip(): set(others.split()) for part, _, others in lines}


def test_each_part_imports_what_the_document_allows() -> None:
    seen: dict[str, set[str]] = {}
    for module, names in imports().items():
        inner = {part_of(name) for name in names if not name.startswith("/") and name}
        seen.setdefault(part_of(module), set()).update(inner - {part_of(module)})
    del seen[""]  # the package itself loads public names when they are first used
    assert seen == rules()  # nothing is forbidden here that happens, nothing allowed that does not


def test_no_part_depends_on_itself() -> None:
    order = list(TopologicalSorter(rules()).static_order())  # raises CycleError on a cycle
    assert order.index("geometry") < order.index("gp") < order.index("methods.gpr")


def test_no_module_depends_on_itself() -> None:
    inner = {m: {n for n in names if n in imports()} for m, names in imports().items() if m}
    assert "methods.gpr.predict" in list(TopologicalSorter(inner).static_order())


@pytest.mark.parametrize("package", ONLY_IN)
def test_packages_of_others_stay_in_their_places(package: str) -> None:
    users = [m for m, names in imports().items() if within_package(names, package)]
    assert users
    assert all(within(module, *ONLY_IN[package]) for module in users), users


def within_package(names: set[str], package: str) -> bool:
    """Whether some imported names are of a package of others."""
    return any(name == f"/{package}" or name.startswith(f"/{package}.") for name in names)


@pytest.mark.parametrize("place", ARRAYS_ONLY)
def test_array_modules_know_neither_clips_nor_tasks(place: str) -> None:
    members = [module for module in imports() if within(module, place)]
    assert members, f"{place} is not there: correct ARRAYS_ONLY"
    for module in members:
        assert not {"clip", "methods.task"} & imports()[module], module


def test_dropouts_and_blackouts_know_nothing_of_each_other() -> None:
    gpr = "methods.gpr."
    for part, other in (("dropout", "blackout"), ("blackout", "dropout")):
        banned = (gpr + other, gpr + "training.plan", gpr + "predict", gpr + "gpr_fill")
        for module, names in imports().items():
            if within(module, gpr + part):
                assert not any(within(name, *banned) for name in names), module


def test_other_methods_know_nothing_of_gpr() -> None:
    for module, names in imports().items():
        if within(module, "methods") and not within(module, "methods.gpr"):
            assert not any(within(name, "methods.gpr") for name in names), module


def test_nothing_but_the_command_line_imports_it() -> None:
    for module, names in imports().items():
        if not within(module, "cli", "__main__"):
            assert not any(within(name, "cli", "evaluation") for name in names) or within(
                module, "evaluation"
            ), module


def test_evaluation_is_in_order() -> None:
    for place, part in enumerate(EVALUATION_ORDER):
        own = {name for name in imports()[f"evaluation.{part}"] if within(name, "evaluation")}
        assert own <= {f"evaluation.{name}" for name in EVALUATION_ORDER[:place]}, part


def test_late_imports_are_seen() -> None:
    tree = ast.parse("def f():\n    if True:\n        from priorfill.clip import Clip\n")
    assert ("priorfill.clip", "Clip") in _imported(tree)


def test_only_the_download_uses_a_network() -> None:
    network = {"/urllib.request", "/http.client", "/requests", "/pooch", "/urllib3"}
    users = {module for module, names in imports().items() if names & network}
    local = "integrations.qtm_rest"  # calls QTM on the same computer
    assert all(within(module, "datasets", local) for module in users), users
