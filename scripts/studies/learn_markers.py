"""Learn marker positions on skeletons from a take that exists as C3D and as ASF/AMC.

    python scripts/studies/learn_markers.py TAKE.c3d TAKE.amc [--skeleton X.asf] [-o OUT.toml]

Axes are those of HDM05: (x, y, z) of the C3D file are (z, x, y) of the AMC file. Prints for each
marker the body parts it is attached to, the rms residual, and the same for markers learnt from one
half of the take and tested on the other. `database/skeletons/markers.toml` is the output for the
take HDM_dg_06-03_03_120 of HDM05.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from priorfill.cli.encoding import replace_what_is_lacking
from priorfill.formats import read
from priorfill.formats.skeletons.asf_amc import find_asf, read_amc, read_asf
from priorfill.markers.definitions import recognise
from priorfill.runtime.atomic_file import replace_file
from priorfill.skeleton.learn_sites import learn_sites
from priorfill.skeleton.marker_sites import MarkerSite, marker_positions
from priorfill.skeleton.virtual_markers import body_of

FROM_C3D = [1, 2, 0]
"""Which coordinates of the C3D file are x, y and z of the AMC file."""

HEAD = """# Sites of the 41 markers of baumann41 on a body.
#
# Learnt by scripts/studies/learn_markers.py from one take of HDM05 that exists as C3D and
# as ASF/AMC, HDM_dg_06-03_03_120 (HDM05, CC BY-SA 3.0: Mueller, Roeder, Clausen, Eberhardt,
# Krueger, Weber, Documentation: Mocap Database HDM05, CG-2007-2, Universitaet Bonn 2007).
#
# A marker is the sum over its parts of weight * (origin of the part's frame) + frame * at, with
# `at` in the part's sizes: up, left, ahead, for limbs that hang down
# (priorfill/skeleton/skeleton_body.py).

[markers]
"""


def main() -> None:
    """Learn the sites, print the errors, and write the sites if --output is given."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("c3d", type=Path)
    parser.add_argument("amc", type=Path)
    parser.add_argument("--skeleton", type=Path)
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    asf_file = options.skeleton or find_asf(options.amc)
    if asf_file is None:
        parser.error(
            f"{options.amc}: its folder has no skeleton of the same name; give one (--skeleton)"
        )
    asf = read_asf(asf_file)
    motion = read_amc(options.amc, asf)
    clip = read(options.c3d)
    markers = clip.positions[..., FROM_C3D]
    marker_set = recognise(clip.labels)
    assert marker_set is not None
    frames = body_of(motion, str(asf_file))[0].frames
    labels = [label for label in clip.labels if label in marker_set.segment]
    columns = [clip.labels.index(label) for label in labels]
    markers = markers[:, columns]
    contralateral = [labels.index(marker_set.mirror.get(label, label)) for label in labels]
    segments = [marker_set.segment[label] for label in labels]

    def learn(rows: slice) -> dict[str, tuple[MarkerSite, ...]]:
        some = {part: frame.rows(rows) for part, frame in frames.items()}
        found = learn_sites(some, markers[rows], segments, contralateral, clip.rate)
        return dict(zip(labels, found, strict=True))

    def square(sites: dict[str, tuple[MarkerSite, ...]], rows: slice) -> NDArray[np.float64]:
        some = {part: frame.rows(rows) for part, frame in frames.items()}
        away = marker_positions(sites, some) - markers[rows]
        return np.nanmean((away**2).sum(axis=2), axis=0)

    middle = len(markers) // 2
    halves = [slice(0, middle), slice(middle, None)]
    sites = learn(slice(None))
    within = square(sites, slice(None))
    left_out = np.mean([square(learn(one), other) for one, other in (halves, halves[::-1])], axis=0)
    for number, (label, some) in enumerate(sites.items()):
        where = ", ".join(site.part for site in some)
        print(f"{label:6} {within[number] ** 0.5:6.1f} {left_out[number] ** 0.5:6.1f} mm  {where}")
    print(f"{'all':6} {within.mean() ** 0.5:6.1f} {left_out.mean() ** 0.5:6.1f} mm rms; left out")
    if options.output is not None:
        with replace_file(options.output, overwrite=True) as temporary:
            temporary.write_text(
                HEAD + "".join(_row(*item) for item in sites.items()), encoding="utf-8"
            )


def _row(label: str, sites: tuple[MarkerSite, ...]) -> str:
    rows = []
    for site in sites:
        at = ", ".join(f"{value:.5f}" for value in site.position)
        weight = f", weight = {site.weight:.5f}" if len(sites) > 1 else ""
        rows.append(f'{{ part = "{site.part}"{weight}, at = [{at}] }}')
    return f"{label} = [{', '.join(rows)}]\n"


if __name__ == "__main__":
    replace_what_is_lacking()
    main()
