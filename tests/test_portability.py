"""What a fill computes does not depend on the system: no functions that systems round differently.

Those of NumPy, of the C library, and the routines of LAPACK that use norms of vectors, differ in
the last bits between Linux and Windows. `priorfill.runtime.elementary`, `gp.linalg` and
`geometry.rotation_kernels` replace them.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "priorfill"

FOLDERS = ("constraints", "energy", "filling", "geometry", "gp", "methods/gpr", "search", "signal")
"""Packages that compute what the default method fills."""

DIFFERENT = re.compile(
    r"\b(?:np|numpy|math)\.(?:exp|expm1|exp2|log|log1p|log2|log10|sin|cos|tan|arcsin|arccos|arctan"
    r"|arctan2|asin|acos|atan|atan2|sinh|cosh|tanh|hypot|cbrt|power|pow|sinc|kaiser|i0)\("
    r"|np\.linalg\.(?!norm\(|LinAlgError)\w+|np\.fft\.|scipy\.(?:fft|special|optimize)"
)

ALLOWED = {
    "energy/multiresolution.py": "a number of levels, rounded down",
    "gp/calibration.py": "a bound rounded to nine digits, coarser than the differences",
    "gp/linalg.py": "where rounding has made a matrix indefinite",
    "search/bounds.py": "axes of bounding volumes; what is found is compared exactly",
    "search/span_scan.py": "axes of a bounding volume; what is found is compared exactly",
    "search/takes.py": "the nearest of a few rates",
}
"""Modules that may use such functions, with the reason."""


def test_fills_use_functions_with_the_same_bits_on_every_system() -> None:
    found = {}
    for folder in FOLDERS:
        for module in sorted((PACKAGE / folder).rglob("*.py")):
            code = re.sub(r'""".*?"""|#[^\n]*', "", module.read_text("utf-8"), flags=re.DOTALL)
            used = DIFFERENT.findall(code)
            if used:
                found[module.relative_to(PACKAGE).as_posix()] = used
    assert {name: used for name, used in found.items() if name not in ALLOWED} == {}
    assert set(ALLOWED) <= set(found), "an exception is not needed"


@pytest.mark.parametrize("line", ["np.exp(x)", "math.hypot(a, b)", "np.linalg.solve(a, b)"])
def test_such_functions_are_recognised(line: str) -> None:
    assert DIFFERENT.search(line)
    assert not DIFFERENT.search("np.linalg.norm(x) + np.sqrt(y) + elementary.exp(z)")
