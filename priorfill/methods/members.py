"""The members of the regressions: which views and kernels predict which kind of gap.

Chosen on several hundred artificial gaps in takes of walking, karate, exercises and acrobatics;
no single member is best for all, and their mixture is better than any of them.
"""

from __future__ import annotations

from priorfill.regression import Kernel, View

__all__ = [
    "FEW",
    "FEW_KERNELS",
    "FEW_VIEWS",
    "LIMB_KERNELS",
    "LIMB_VIEWS",
    "STRANGER_KERNELS",
    "STRANGER_VIEWS",
]

FEW = 3
"""Up to this many markers are predicted by the members for a few, more by those for limbs."""

FEW_VIEWS = (
    View("rigid", 220.0, 0.005, 10.0),
    View("rigid", 300.0, 0.002, 10.0),
    View("rigid", 160.0, 0.002),
    View("heading", 220.0, 0.005, 10.0),
)
FEW_KERNELS = (
    Kernel(1.0, 0.1, 1.0, 0.001, 0.1, smooth=False, noise=1e-4),
    Kernel(10.0, 0.1, 0.6, 0.01, 0.3, smooth=True, noise=1e-4),
)
"""For a few markers, whose neighbours on the same segment are mostly visible."""

LIMB_VIEWS = (
    FEW_VIEWS[0],
    FEW_VIEWS[1],
    FEW_VIEWS[3],
    View("heading", 200.0, 0.1),
    View("rigid", 200.0, 0.1),
)
LIMB_KERNELS = FEW_KERNELS[:1] + tuple(
    Kernel(linear, radial, length, 0.05, 0.4, smooth=True, noise=1e-4)
    for linear, radial, length in (
        (10.0, 0.1, 0.6),
        (30.0, 0.0, 1.0),
        (1.0, 0.3, 0.5),
        (0.3, 1.0, 0.6),
        (3.0, 3.0, 1.0),
        (0.1, 0.1, 0.4),
    )
)
"""For limbs and other large parts of the body, which move against what is visible."""

STRANGER_VIEWS = FEW_VIEWS
STRANGER_KERNELS = (
    Kernel(1.0, 0.3, 0.6, 0.0, 1.0, smooth=False, noise=1e-2),
    Kernel(0.3, 0.1, 1.0, 0.0, 1.0, smooth=False, noise=1e-1),
)
"""For other people's poses: no seam in time, and far more noise, since bodies and the places of
markers differ."""
