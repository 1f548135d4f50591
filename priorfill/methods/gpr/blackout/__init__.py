"""Blackouts: gaps in which fewer than three markers are visible.

The movement during a blackout is inferred from three sources: the movement right before and after
it; spans of the same length elsewhere in the clip, which show how this subject moves; and the
database, which shows what happened between similar edges. Hence

1. several *curves* are computed, each a linear function of the samples on either side: Gaussian
   processes in time of different smoothness where both sides are visible, velocities that decay
   where one side is (`curves`);
2. the same curves are computed in *windows*: spans of the clip, of its mirror image and of the
   database that have the same length and show all markers (`windows`, `database_windows`). The
   curves are combined by their errors there (`stacking`);
3. a Gaussian-process regression [RW06]_ (section 2.2) predicts the remaining error from the poses,
   velocities and accelerations at the edges, scaled by its gain on held-out windows ([RW06]_
   Eq. 5.12, in blocks) (`correction`);
4. the residuals in the windows, in units of the disagreement of the curves, give the expected error
   (`predict_blackout`).

References
----------
.. [RW06] Rasmussen and Williams, Gaussian Processes for Machine Learning, MIT Press 2006.
"""
