"""Synthetic motion capture: simulated recordings for tests, demos and the starter database.

**Nothing here was measured.** A kinematic body with published proportions (`Body`) moves its joints
along published mean curves (`priorfill.synthetic.gait_curves`), with its feet on the floor, and
carries 41 markers with simulated soft-tissue artefacts. Its movements are more regular than real
ones, so gaps are easier to fill than those of recordings: use it to test that something works, not
how well. Names of clips start with ``synthetic_``, those of subjects with ``synthetic-``.

>>> from priorfill.synthetic import Body, synthesise
>>> clip = synthesise("walking", seconds=2.0, body=Body(height=1680), seed=3)
>>> clip.name, clip.subject, clip.positions.shape
('synthetic_walking_003', 'synthetic-0', (240, 41, 3))
"""

from __future__ import annotations

from priorfill.synthetic.generate import synthesise
from priorfill.synthetic.motions import MOTIONS
from priorfill.synthetic.synthetic_body import LABELS, MARKER_SEGMENTS, Body
from priorfill.synthetic.synthetic_options import Noise, Style

__all__ = ["LABELS", "MARKER_SEGMENTS", "MOTIONS", "Body", "Noise", "Style", "synthesise"]
