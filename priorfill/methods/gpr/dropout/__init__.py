"""Dropouts: markers that the clip hardly shows, predicted from other recordings.

Where a marker sits on the body cannot be learnt from such a clip. It is learnt from *donors*,
recordings that show the marker together with the visible ones:

* the clip's own subject: other recordings of it (those given as such, and takes of the database
  whose markers keep the same distances), and the few frames in which the clip shows the marker;
* the clip's mirror image, where the marker is the image of its contralateral one;
* other subjects of the database, and their mirror images.

All donors' poses train one Gaussian process from the visible to the missing markers, in frames
aligned by the visible markers nearby. Subjects differ by a constant and by how they move. Both
deviations are correlated between donors: fully for one subject, strongly for subjects of nearly the
same shape (the distances of the visible markers that hardly vary), and partly for a subject and its
mirror image (`MultiSubjectKernel`). The expected error is cross-validated by holding out one
subject at a time; each is predicted from the others and, as the clip is, from its own mirror image.
Several models, one for each alignment and kernel, are weighted by their held-out errors.
"""
