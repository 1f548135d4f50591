"""Gap filling in eigenspaces: Li, Yu, Kieu, Vuong and Zhang, IEEE Access 8, 2020 [L20]_.

There are three methods:

* `pca_pieces` (``pca-pieces``), Eqs. (1)-(4): the eigenvectors of training pieces, those of each
  piece masked like the clip, and the matrix T that maps coordinates in the masked eigenspaces to
  coordinates in the complete one. With ``over="frames"``, Eqs. (5)-(8): the same with eigenvectors
  over frames, of pieces side by side.
* `pca_train` (``pca-train``), a variant: all masked pieces, and the clip, share their eigenvectors.
* `pca_frames` (``pca-frames``), Eqs. (9)-(16): complete frames are missing, and the eigenvectors
  are those of trajectories, with one coordinate per frame.

`eigenspaces` has the equations on arrays, `training_windows` and `piece_sources` the choice of
training data, `normalisation` the scale of coordinates, `li2020_options` all constants.
`li2020_fill`, `pieces_fill` and `frames_fill` apply them to a task, and list the departures from
the paper.

References
----------
.. [L20] Z. Li, H. Yu, H. D. Kieu, T. L. Vuong and J. J. Zhang, PCA-Based Robust Motion Data
   Recovery, IEEE Access 8, 2020, doi 10.1109/ACCESS.2020.2989744.
"""

from __future__ import annotations

from priorfill.methods.li2020.frames_fill import pca_frames
from priorfill.methods.li2020.li2020_fill import pca_pieces, pca_train
from priorfill.methods.li2020.li2020_options import Li2020Options

__all__ = ["Li2020Options", "pca_frames", "pca_pieces", "pca_train"]
