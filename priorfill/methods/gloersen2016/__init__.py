"""Weighted principal components: Gløersen and Federolf, PLoS ONE 2016 [GF16]_.

The mean of the markers that are visible throughout is subtracted from each frame. In the complete
frames, each column x (one coordinate of a marker) is scaled to

    z = w (x - mean) / standard deviation,    w = exp(-d^2 / 2 sigma^2),

with w = w_mm for missing markers, where d is the marker's mean distance to the nearest missing
marker. V are the principal components of these frames (right singular vectors of the rows z), V0
those of the same frames with the columns of the missing markers set to zero. As many components are
kept as are needed, in both, for the singular values to sum to a share of their total. With T = V'
V0, the incomplete frames z0 give

    z = z0 V0 T V'                                                    (1)

whose missing columns, scaled back to mm, fill the gaps.

``r1``, the simultaneous strategy, treats all markers with gaps as missing at once, and is fitted to
complete frames. ``r2``, the consecutive strategy and the default of the authors' program, treats
one marker as missing after another. Other markers with gaps are used if they are near
(``distal_threshold``) and visible in all gaps of the missing one; the fit is to the frames that
show all markers used. No marker is predicted from filled samples.

Departures from the authors' program (PredictMissingMarkers.m):

* Only the diagonal of T is used. In Eq. (1) component j of V0 becomes component k of V with the
  product of their signs, and the sign of a singular vector is arbitrary. For j = k the signs
  cancel; for all other pairs the fill depends on the signs that the SVD happens to return (for a
  limb of HDM05, mean errors of 84 to 147 mm). The diagonal is the mean of Eq. (1) over all choices
  of signs. V0' V, the change of coordinates, has the same diagonal and no signs, but predicts
  nothing if all components are kept, as V V' = 1 and z0 is zero in the missing columns.
* Components are computed from covariances: the same in exact arithmetic, and 100 times faster,
  since sums over complete frames are shared by all markers and missing columns are left out, not
  zeroed.
* Frames without any visible marker, and markers that are never visible, are left out; the program's
  means and distances are NaN then, and it fills nothing. Where no marker is visible in all
  remaining frames, those with the fewest markers are left out, for example those in which the
  subject walks in or out, until `gloersen2016_fill.MIN_ANCHORS` markers are visible in all of them.
* Two markers that are never visible together are infinitely far apart; the program's threshold is
  NaN then.
* A column counts as constant below `weighted_pca.MIN_SD`; the program requires a standard deviation
  of exactly 0, which rounding errors exceed.
* Components without variance are not counted.

As in the publication, standard deviations differ between axes, so rotating the clip by other than
right angles changes the fills slightly; and fills are not continuous at the edges of a gap.

References
----------
.. [GF16] Gløersen and Federolf, Predicting missing marker trajectories in human motion data using
   marker intercorrelations, PLoS ONE 11(3), e0152616, 2016. DOI 10.1371/journal.pone.0152616.
"""

from priorfill.methods.gloersen2016.gloersen2016_fill import r1, r2
from priorfill.methods.gloersen2016.strategies import Gloersen2016Options

__all__ = ["Gloersen2016Options", "r1", "r2"]
