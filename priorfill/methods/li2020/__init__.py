"""Gap filling in eigenspaces: Li, Yu, Kieu, Vuong and Zhang, IEEE Access 8, 2020 [L20]_.

Three methods. `pca_train`, Eqs. (1)-(4): the eigenvectors of training pieces and of the same pieces
masked as the clip is, and the matrix T that leads from the coordinates in the one to those in the
other. `pca_pieces`, Eqs. (5)-(8): the same with eigenvectors of its own for each masked piece, and
those of the clip. `pca_frames`, Eqs. (9)-(16): whole frames are missing, and the eigenvectors are
those of trajectories, one number a frame.

`eigenspaces` has the equations on arrays, `training_windows` the choice of training data,
`li2020_options` every constant, and `li2020_fill` joins
them. Where all of it departs from the paper is in `li2020_fill`.

References
----------
.. [L20] Z. Li, H. Yu, H. D. Kieu, T. L. Vuong and J. J. Zhang, PCA-Based Robust Motion Data
   Recovery, IEEE Access 8, 2020, doi 10.1109/ACCESS.2020.2989744.
"""

from __future__ import annotations

from priorfill.methods.li2020.li2020_fill import pca_frames, pca_pieces, pca_train
from priorfill.methods.li2020.li2020_options import Li2020Options

__all__ = ["Li2020Options", "pca_frames", "pca_pieces", "pca_train"]
