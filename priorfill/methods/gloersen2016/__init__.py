"""Gaps filled by what markers have in common: Gløersen and Federolf, PLoS ONE 2016 [GF16]_.

The mean of the markers that are seen throughout is taken out of each frame. In the frames that
show everything needed, each column x (one coordinate of a marker) is brought to

    z = w (x - mean) / deviation,    w = exp(-d^2 / 2 sigma^2),    w = w_mm for lost markers,

where d is the marker's mean distance to the nearest lost marker. V are the principal components
of these frames (right singular vectors of the rows z), V0 those of the same frames with the lost
markers' columns set to zero; of both as many are kept as the sum of the singular values needs to
reach a share of the whole in both. With T = V' V0, the frames z0 that lack the markers give

    z = z0 V0 T V'                                                    (1)

and the lost columns of it, brought back to mm, fill the gaps.

``r1``, simultaneous: all markers with gaps are lost at once, and learnt from frames that show all.
``r2``, consecutive, the program's default: one marker after the other is lost. Of the other
markers with gaps those stay that are nearer than a share of the mean distance and are seen in all
its gaps; it is learnt from frames that show them. No marker is predicted from filled samples.

Where it departs from the publication's program (PredictMissingMarkers.m):

* Of T its diagonal is kept. In (1) component j of V0 becomes component k of V with the sign of
  both, and the sign of a singular vector is arbitrary: for j = k it cancels, for all others the
  fill depends on which signs the SVD happens to return (on a limb of HDM05 means of 84 to 147 mm).
  The diagonal is the mean of (1) over all choices of signs, and the same for each of them.
* The components come from covariances, which is the same in exact arithmetic, and 100 times
  faster: sums over frames that show everything are taken once for all markers, and lost columns
  are left out rather than zeroed.
* Frames that show no marker and markers that are never seen are left out. There the program's
  means and distances are NaN, and it fills nothing. Where no marker is seen in all frames left,
  those that show fewest are left out too, as of a body that walks in and out, until some markers
  (`methods.ANCHORS`) are seen in all of them.
* A pair of markers never seen together is infinitely far apart; the program's cut-off is NaN then.
* A column is still below `weighted_pca.STILL`, not only at a deviation of exactly 0, which
  rounding misses.
* Components without variance are not counted.

As in the publication, deviations differ by axis, so that a clip turned by other than right angles
gives slightly other fills, and fills do not join the samples beside the gap.

References
----------
.. [GF16] Gløersen and Federolf, Predicting missing marker trajectories in human motion data using
   marker intercorrelations, PLoS ONE 11(3), e0152616, 2016. DOI 10.1371/journal.pone.0152616.
"""

from priorfill.methods.gloersen2016.gloersen2016_fill import r1, r2
from priorfill.methods.gloersen2016.strategies import Gloersen2016Options

__all__ = ["Gloersen2016Options", "r1", "r2"]
