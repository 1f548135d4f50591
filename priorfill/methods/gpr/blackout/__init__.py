"""Fill a blackout: no marker is seen, or too few of them to tell the others.

What a body did while nobody looked is told by three things: how it moved before and after; how
this person moves over stretches of the same length, which the rest of the clip shows; and what
came between when others stood and moved alike at both edges, which the database shows. Hence

1. several *curves*, each a linear function of the samples beside the blackout: Gaussian processes
   in time of different smoothness where both sides are seen, velocities that die away where one
   side is (`priorfill.signal.gp_interpolation`);
2. the same curves over *windows*: stretches of the clip, of its mirror image and of the database,
   of the same length and seen throughout. What comes out best there, marker by marker, mixes the
   curves, and least squares improve the mixture, frame by frame;
3. a Gaussian-process regression [R06]_ (section 2.2) from the poses, velocities and accelerations
   of the whole body at the edges to what the mixture got wrong. It counts as far as it helps in
   windows that are left out ([R06]_ Eq. 5.12, in blocks);
4. what is left wrong in the windows, in units of how far the curves disagree there, is the
   expected error.

References
----------
.. [R06] Rasmussen and Williams, Gaussian Processes for Machine Learning, MIT Press 2006.
"""

from priorfill.methods.gpr.blackout.fill_blackouts import Blackouts
from priorfill.methods.gpr.blackout.predict_blackout import fill_blackout
from priorfill.methods.gpr.blackout.windows import Recording

__all__ = ["Blackouts", "Recording", "fill_blackout"]
