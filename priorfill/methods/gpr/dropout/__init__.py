"""Markers that the clip hardly shows: from other recordings, other bodies, and the mirror.

Where a marker sits on a body cannot be learnt from such a clip, so it is learnt from *witnesses*,
bodies that are seen with the marker. A witness is

* the clip's own body: other recordings of it (the clip's companions, and takes of the database
  whose markers keep the same distances), and the few frames in which the clip shows the marker;
* the clip's own body in a mirror, where the marker is the image of its partner;
* other people of the database, and they in a mirror.

All of them are rows of one Gaussian process from the visible markers nearby to the missing ones,
in frames aligned with those. Bodies differ by an offset and by how they move. Both are parts of
the covariance that rows share as far as their bodies do: wholly for one body, much for bodies of
nearly the same shape (the distances between visible markers that hardly vary), partly for a body
and its mirror image. How far a prediction is off is told by leaving whole bodies out, each
predicted from the others and its own image as the clip is. Several members are mixed by that.
"""

from priorfill.methods.gpr.dropout.fill_dropouts import Dropouts

__all__ = ["Dropouts"]
