"""Data flow one way: what ARCHITECTURE.md says of imports."""

from __future__ import annotations

import ast
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import priorfill

ROOT = Path(priorfill.__file__).parent
METHODS = "priorfill.methods."
PRIOR = METHODS + "prior."
ARRAYS_ONLY = (
    *(
        f"prior.blackout.{part}"
        for part in ("stencil", "windows", "curves", "mixture", "correction")
    ),
    "prior.blackout.prediction",
    *(f"prior.dropout.{part}" for part in ("ties", "covariance", "prediction")),
    "gloersen2016.weighted_pca",
    "prior.moments",
)
DETECTORS = ("partners", "steps", "frozen", "swaps", "takeovers", "far", "stray")


@cache
def imports() -> dict[str, set[str]]:
    """What each module imports of priorfill when it is imported itself."""
    files = {
        ".".join(f.relative_to(ROOT.parent).with_suffix("").parts).removesuffix(".__init__"): f
        for f in ROOT.rglob("*.py")
    }
    found = {}
    for module, file in files.items():
        found[module] = {
            name if (name := f"{node.module}.{alias.name}") in files else node.module
            for node in ast.parse(file.read_text(encoding="utf-8")).body
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("priorfill.")
            for alias in node.names
        }
    return found


def test_no_module_imports_itself_in_the_end() -> None:
    # raises CycleError if one does
    assert "priorfill.methods.prior.predict" in list(TopologicalSorter(imports()).static_order())


def test_kernels_see_arrays_only() -> None:
    found = imports()
    for part in ARRAYS_ONLY:
        above = {METHODS + "task", METHODS + "prior.options"}
        assert not found[METHODS + part] & above, part


def test_dropouts_and_blackouts_know_nothing_of_each_other() -> None:
    built = {"dropout": "blackout", "blackout": "dropout"}
    for module, names in imports().items():
        for part, other in built.items():
            if module.startswith(PRIOR + part):
                above = (other, "lessons", "predict.", "regression_prior")
                assert not any(f"{n}.".startswith(PRIOR + a) for n in names for a in above)


def test_the_methods_of_the_field_know_nothing_of_prior() -> None:
    for module, names in imports().items():
        if module.startswith(METHODS) and not module.startswith(PRIOR):
            assert not any(name.startswith(PRIOR) for name in names), module


def test_methods_import_neither_files_nor_databases() -> None:
    banned = ("priorfill.formats", "priorfill.database", "priorfill.filling", "priorfill.cli")
    for module, names in imports().items():
        if module.startswith(METHODS):
            assert not any(name.startswith(banned) for name in names), module


def test_detectors_of_trouble_see_arrays_only() -> None:
    trouble = "priorfill.trouble"
    for module, names in imports().items():
        if module.startswith(trouble):
            allowed = {"priorfill.gaps", *(f"{trouble}.{part}" for part in DETECTORS)}
            if module in {trouble, f"{trouble}.find"}:
                allowed |= {"priorfill.clip", f"{trouble}.find", f"{trouble}.kinds"}
            assert names <= allowed, module


def test_evaluation_stands_above_filling_and_below_the_command_line() -> None:
    evaluation, found = "priorfill.evaluation", imports()
    for module, names in found.items():
        if module.startswith(evaluation):
            assert not any(f"{name}.".startswith("priorfill.cli.") for name in names), module
            files = {name for name in names if name.startswith("priorfill.formats")}
            assert files <= {"priorfill.formats.atomic", "priorfill.formats.atomic.replace_file"}
        else:
            assert not any(name.startswith(evaluation) for name in names), module
    order = ("parts", "cutter", "protocols", "joints", "metrics", "case", "plan", "tables",
             "results", "store", "campaign")  # fmt: skip
    for place, part in enumerate(order):
        above = {f"{evaluation}.{name}" for name in order[:place]}
        own = {name for name in found[f"{evaluation}.{part}"] if name.startswith(evaluation)}
        assert own <= above, part


def test_skeletons_know_nothing_of_files_databases_or_methods() -> None:
    banned = tuple(f"priorfill.{part}." for part in ("formats", "database", "methods", "cli"))
    for module, names in imports().items():
        if module.startswith("priorfill.skeleton."):
            assert not any(f"{name}.".startswith(banned) for name in names), module
        if module.startswith("priorfill.formats."):
            skeletons = {name for name in names if name.startswith("priorfill.skeleton")}
            assert all(name.startswith("priorfill.skeleton.joints") for name in skeletons), module
