"""Tits, Tilmanne and Dutoit 2018: soft skeleton constraints and model averaging.

*Robust and automatic motion-capture data recovery using soft skeleton constraints and model
averaging*, PLoS ONE 13(7) e0199744, doi 10.1371/journal.pone.0199744, and the authors' program
MocapRecovery.

Markers are filled one after the other, those with the fewest missing frames first, else in the
clip's order; a marker that is filled helps the next (which makes limbs depend on that order).
Each is held to three *references*, the markers whose distance from it varies least (standard
deviation) among those seen beside the gap and, all together, in some of its frames.

1. A model predicts the gap. *Local* ones work in the frame of the references (`triad`): straight
   lines over time (``li``), a polynomial of degree two of the references' shape (``lpr``), a mean
   of frames weighed by how like their shape is, exp(-ln 2 (d / 0.3)²) (``lgrnn``). *Global* ones
   work about the centre of the markers that are never missing: linear regression on the markers
   seen throughout (``glr``), the weighted PCA of Gløersen and Federolf 2016 (``wpca``).
2. A straight line over time takes off what the prediction is off at both edges (`continuity`).
3. ``pma`` averages all five, each weighed, frame by frame, by the product of the densities of its
   distances from the references, estimated from measured frames (`averaging`).
4. Distances from the references are brought between the quantiles 0.01 and 0.99 of what was
   measured (`skeleton`).
5. Filled samples are smoothed by a moving median and mean of 0.07 s (`smoothing`).

Where it departs from paper and program:

* Measured samples are never changed. The program lets the skeleton constraint move the measured
  samples beside a gap before the marker helps others, and puts them back only in the end.
* Nothing is drawn at random. Of 500 to 999 frames (local models: 1000 to 1999), and of distances,
  the program draws rows by chance; here they are spread evenly. See `options.thinned`.
* A gap that starts in the clip's second frame, or ends in the last but one, is joined to the sample
  beside it; the program takes it for one at the clip's end.
* References of a gap at an end of the clip must be seen beside it on the measured side; the program
  wants them in the clip's first or last frame, too, and fills nothing where a person walks in.
* Each gap of ``glr`` is joined by the prediction as it was; the program joins two gaps with a
  single frame between one after the other.
* A marker that helps to fill a gap piece by piece is smoothed once, not once more for each piece.
* The PCA is that of `priorfill.methods.gloersen2016`, with what it departs in; distances are means
  over all frames, of which the program takes 500.
* References of gaps are looked for anew for each piece of a gap. The program forgets a reference
  that did not fit an earlier piece.
* Markers that were never seen together are no references of each other; the program stops.
* Without a marker that is never missing the program fills nothing. Here all models but the PCA
  work where the markers are: local models see no difference, and a linear regression hardly any.
* The network divides by its largest weight first. Far from all frames the program's weights are
  all 0; here the nearest frame decides.
* The program means to smooth what it is given, but uses the positions as they were; so do we.
"""

from priorfill.methods.tits2018.tits2018_fill import (
    glr,
    lgrnn,
    li,
    lpr,
    pma,
    wpca,
)
from priorfill.methods.tits2018.tits2018_options import Tits2018Options

__all__ = ["Tits2018Options", "glr", "lgrnn", "li", "lpr", "pma", "wpca"]
