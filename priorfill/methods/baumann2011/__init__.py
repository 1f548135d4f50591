"""Completion from nearest poses: Baumann et al. 2011, Krüger et al. 2010, distance-weighted votes.

`neighbour_votes` is the published method of Baumann et al. (``baumann2011``), `weighted_votes` the
same with votes weighted by distance (``neighbours``), `krueger2010` the frame-by-frame optimisation
that the paper compares with. They share the plan of their searches, `pose_searches`;
`neighbour_count` chooses the number of neighbours of the first.
"""
