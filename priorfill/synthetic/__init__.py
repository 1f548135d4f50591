"""Synthetic motion capture: computed full-body recordings for tests, demos and a start.

**Nothing here was measured.** A kinematic body of published proportions (`Body`) moves its
joints along published mean curves (`priorfill.synthetic.gait_curves`), stands on its feet, and
carries 41 markers that wobble as on skin. It looks like a person and has no surprises, so
gaps in it are easier to fill than those of recordings: use it to see that something works,
not how well. Clips are called ``synthetic_...``, their subjects ``synthetic-...``.

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
