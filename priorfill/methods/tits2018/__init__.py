"""Soft skeleton constraints and model averaging: Tits, Tilmanne and Dutoit 2018 [T18]_.

Markers are filled one after another, those with the fewest missing frames first, otherwise in the
clip's order; a filled marker helps to fill the next ones (so the fill of a limb depends on that
order). Each marker has three *references*: the markers whose distance from it varies least
(standard deviation) among those that are visible adjacent to the gap and, all together, in some of
its frames.

1. Models predict the gap. *Local* models work in the frame of the references (`triad_frame`):
   linear interpolation over time (``li``), a polynomial of degree two of the references' shape
   (``lpr``), and a mean of frames with weights exp(-ln 2 (d / 0.3)²) by the distance d of these
   shapes (``lgrnn``). *Global* models work relative to the centroid of the markers that are never
   missing: linear regression on the markers visible throughout the gap (``glr``), and the weighted
   PCA of Gløersen and Federolf 2016 (``wpca``).
2. A linear ramp over time removes the errors of the prediction at both edges (`continuity`).
3. ``pma`` averages all five models, frame by frame, with weights proportional to the product of the
   probability densities of the distances from the references (`model_averaging`).
4. Distances from the references are moved into the range of the quantiles 0.01 and 0.99 of the
   measured distances (`distance_bounds`).
5. Filled samples are smoothed by a moving median and a moving mean over 0.07 s
   (`median_mean_filter`).

`recovery` applies these steps to arrays, `tits2018_fill` to a task; `tits2018_options` has all
constants.

Departures from the paper and from the authors' program MocapRecovery:

* Measured samples never change. In the program the skeleton constraint moves the measured samples
  adjacent to a gap while the marker helps others, and restores them at the end.
* Nothing is random. Of 500 to 999 frames (local models: 1000 to 1999) and of distances, the program
  draws rows at random; here they are spread evenly. See `tits2018_options.thinned`.
* A gap that starts in the clip's second frame, or ends in the last but one, is joined to the
  adjacent sample; the program treats it like a gap at the end of the clip.
* References of a gap at an end of the clip must be visible adjacent to it on the measured side
  only; the program requires them in the clip's first or last frame, too, and fills nothing where a
  subject walks in.
* Each gap of ``glr`` is joined using the unchanged prediction; the program joins two gaps with a
  single frame between them one after the other.
* A marker that helps to fill a gap in several parts is smoothed once, not once per part.
* The PCA is that of `priorfill.methods.gloersen2016`, with its departures; distances are means over
  all frames, where the program uses 500.
* References are chosen anew for each part of a gap; the program discards a reference that did not
  suit an earlier part.
* Markers that are never visible together are not references of each other; the program stops.
* Without a marker that is never missing, the program fills nothing. Here all models but the PCA
  work in world coordinates: local models are not affected, and a linear regression hardly is.
* The weights of ``lgrnn`` are divided by their maximum first. Far from all training frames the
  program's weights all underflow to 0; here the nearest frame is used.
* The program is meant to smooth its input, but uses the unsmoothed positions; so does this one.

References
----------
.. [T18] M. Tits, J. Tilmanne, T. Dutoit, Robust and automatic motion-capture data recovery using
   soft skeleton constraints and model averaging, PLoS ONE 13(7), e0199744, 2018, doi
   10.1371/journal.pone.0199744.
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
