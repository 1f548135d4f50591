"""The members of the regressions: which views, moments and kernels predict which kind of gap.

Chosen on several hundred artificial gaps in takes of walking, karate, exercises and acrobatics;
no single member is best for all, and their mixture is better than any of them.
"""

from __future__ import annotations

from collections.abc import Sequence

from priorfill.gp.data import Member
from priorfill.gp.features import Moment, View
from priorfill.gp.pose_kernel import Kernel

__all__ = ["BASIC", "BRIEF_MEMBERS", "LIMB_MEMBERS", "MARKER_MEMBERS", "seconds_of"]


def _each(
    views: Sequence[View], moments: Sequence[Moment | None], kernels: Sequence[Kernel]
) -> tuple[Member, ...]:
    """Return a member for each view, moment and kernel."""
    return tuple(Member(v, m, k) for v in views for m in moments for k in kernels)


def seconds_of(members: Sequence[Member]) -> tuple[float, ...]:
    """Return the seconds before and after poses that members look at, each once."""
    return tuple(dict.fromkeys(m.moment.seconds for m in members if m.moment is not None))


_SEGMENT = View("rigid", 220.0, 0.005, 10.0)
_NEAR = View("rigid", 120.0, 0.001, 8.0)
_PARTS = View("rigid", 300.0, 0.002, 10.0)
_UPRIGHT = View("heading", 220.0, 0.005, 10.0)
_BODY = View("heading", 200.0, 0.1)

_PLAIN = Kernel(1.0, 0.1, 1.0, 0.001, 0.1, smooth=False, noise=1e-4)
_WIDE = Kernel(1.0, 1.0, 1.5, 0.001, 0.1, smooth=False, noise=1e-4)

_MARKER_KERNELS = (
    _PLAIN,
    Kernel(1.0, 0.1, 1.0, 0.001, 0.1, smooth=False, noise=1e-3),
    _WIDE,
    Kernel(1.0, 0.1, 1.0, 0.001, 0.1, smooth=False, noise=1e-4, fading=3.0),
    Kernel(30.0, 0.0, 1.0, 0.01, 0.3, smooth=True, noise=1e-4),
)
_MARKER_MOMENTS = (
    Moment(1.0 / 30.0, 0.4),
    Moment(1.0 / 15.0, 0.4),
    Moment(1.0 / 30.0, 2.0, velocity=True),
)


def _marker() -> tuple[Member, ...]:
    """Members for one marker: moments with some of the views and kernels only."""
    members: list[Member] = []
    for view in (_SEGMENT, _NEAR, _UPRIGHT, _PARTS):
        members += _each([view], [None], _MARKER_KERNELS)
        if view is not _PARTS:
            members += _each([view], _MARKER_MOMENTS, [_PLAIN, _WIDE])
    return tuple(members)


MARKER_MEMBERS = _marker()
"""For one marker alone, whose neighbours on the same segment are mostly visible."""

BRIEF_MEMBERS = _each([_SEGMENT, _NEAR, _UPRIGHT, _PARTS], [None], _MARKER_KERNELS[::4])
"""For pieces of a few frames: the seam says nearly all of them. Where gaps have ragged edges there
are hundreds."""

BASIC = _each([_SEGMENT, _UPRIGHT], [None], [_PLAIN])
"""For a first reading that a second will replace."""

_LIMB_KERNELS = (
    _PLAIN,
    Kernel(3.0, 3.0, 1.0, 0.05, 0.4, smooth=True, noise=1e-5),
    Kernel(30.0, 0.0, 1.0, 0.05, 0.4, smooth=True, noise=1e-4),
    Kernel(0.3, 1.0, 0.6, 0.05, 0.4, smooth=True, noise=1e-4),
)
_LIMB_MOMENTS = (
    Moment(1.0 / 15.0, 0.8),
    Moment(2.0 / 15.0, 0.4),
    Moment(4.0 / 15.0, 0.6),
    Moment(2.0 / 15.0, 1.5, velocity=True),
)

_WINDING = (
    Kernel(3.0, 10.0, 0.6, 0.05, 0.4, smooth=True, noise=1e-5),
    Kernel(3.0, 10.0, 0.4, 0.05, 0.4, smooth=True, noise=1e-5),
)
"""Hardly linear: they follow the poses closely."""

_FORGETFUL = Kernel(0.1, 0.1, 0.4, 0.05, 0.4, smooth=True, noise=1e-4)
"""Goes back to the mean pose where nothing like it was seen."""

LIMB_MEMBERS = (
    *(
        member
        for view in (_SEGMENT, _UPRIGHT, _BODY)
        for member in (
            *_each([view], [None], [*_LIMB_KERNELS, *_WINDING, _FORGETFUL]),
            *_each([view], _LIMB_MOMENTS, _LIMB_KERNELS),
        )
    ),
    *_each([_NEAR], [None], _LIMB_KERNELS[:3]),
    *_each([_NEAR], _LIMB_MOMENTS[:1], _LIMB_KERNELS[:2]),
)
"""For several markers at once: limbs above all, which move against what is visible. Their moments
are whole steps of 1/15 s, which databases are read by."""
