"""The demo recording: synthetic, with gaps of known content."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from priorfill.clip import Clip
from priorfill.synthetic import Body, Style, synthesise

__all__ = ["DEMO_GAPS", "make_demo_clip"]

SECONDS = 12.0
"""Length of the demo clip (s)."""

DEMO_GAPS: tuple[tuple[float, float, tuple[str, ...]], ...] = (
    (1.00, 1.25, ("LKNE",)),
    (1.50, 4.50, ("LUPA", "LELB", "LFRM", "LWRA", "LWRB", "LFIN")),
    (3.00, 5.50, ("RSHN", "RANK", "RHEE", "RTOE", "RMT5")),
    (4.00, 4.60, ("RBWT",)),
    (6.20, 6.30, ("STRN",)),
    (6.50, 9.00, ("RELB", "RFRM", "RWRA", "RWRB", "RFIN")),
    (7.50, 9.50, ("LTHI", "LKNE", "LSHN")),
    (8.00, 8.80, ("CLAV", "STRN")),
    (10.00, 10.40, ("LBHD",)),
    (11.00, 12.00, ("LANK", "LHEE", "LTOE")),
)
"""The gaps of the demo: start (s), end (s), markers."""


def make_demo_clip(seed: int = 2011) -> tuple[Clip, Clip]:
    """Return the demo recording, complete and with gaps.

    It is **synthetic**: simulated by `priorfill.synthetic`. The subject (body and style) is not in
    the starter database, but the kinds of motion are: 12 s at 120 Hz of walking, reaching, walking
    along a curve and squatting (``mixed`` of `priorfill.synthetic.MOTIONS`).

    =============  ==================================  ======================================
    seconds        missing                             kind of gap
    =============  ==================================  ======================================
    1.00 - 1.25    LKNE                                a single short gap
    1.50 - 4.50    LUPA LELB LFRM LWRA LWRB LFIN       the left arm, for 3 s
    3.00 - 5.50    RSHN RANK RHEE RTOE RMT5            the right shank and foot, overlapping
    4.00 - 4.60    RBWT                                a marker of the pelvis, inside both
    6.20 - 6.30    STRN                                a single gap of a tenth of a second
    6.50 - 9.00    RELB RFRM RWRA RWRB RFIN            the right forearm
    7.50 - 9.50    LTHI LKNE LSHN                      the left thigh and knee, overlapping
    8.00 - 8.80    CLAV STRN                           the chest, inside both
    10.00 - 10.40  LBHD                                a marker of the head
    11.00 - 12.00  LANK LHEE LTOE                      the left foot, to the clip's end
    =============  ==================================  ======================================

    Parameters
    ----------
    seed : int
        Seed of the motion.

    Returns
    -------
    truth : Clip
        The recording without gaps.
    gappy : Clip
        The same with the gaps of the table.

    Examples
    --------
    >>> truth, gappy = make_demo_clip()
    >>> int(gappy.missing.sum())
    6594
    """
    truth = _simulated(seed)
    positions = truth.positions.copy()
    for start, end, labels in DEMO_GAPS:
        frames = slice(round(start * truth.rate), round(end * truth.rate))
        positions[frames, [truth.labels.index(label) for label in labels]] = np.nan
    return truth, truth.with_positions(positions)


@lru_cache(maxsize=1)  # examples make the demo clip again and again, which takes 0.2 s
def _simulated(seed: int) -> Clip:
    """Return the recording without gaps."""
    truth = synthesise(
        "mixed",
        seconds=SECONDS,
        body=Body(height=1742.0, leg=1.02, trunk=0.985, arm=1.01, breadth=1.04, seed=905),
        style=Style(speed=1.15, arm_swing=1.15, lean=1.5, toe_out=9.0, asymmetry=-0.04),
        seed=seed,
    )
    return replace(truth, name="synthetic_demo")
