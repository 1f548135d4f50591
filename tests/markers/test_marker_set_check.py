"""A marker set that does not fit the labels, or the body."""

from __future__ import annotations

import numpy as np
import pytest
from gappy import person

import priorfill as pf
from priorfill.errors import MarkerSetError
from priorfill.markers.definitions import load, recognise
from priorfill.markers.marker_set_check import check_marker_set

CLIP = person()
OWN = recognise(CLIP.labels)
assert OWN is not None


def test_the_right_set_has_no_notes() -> None:
    assert check_marker_set(CLIP.labels, CLIP.positions, OWN, given=True) == ()
    assert check_marker_set(CLIP.labels, CLIP.positions, None, given=False) == ()


def test_a_set_without_the_markers_is_refused() -> None:
    labels = tuple(f"M{i}" for i in range(len(CLIP.labels)))
    with pytest.raises(MarkerSetError, match="has none of the clip's 41 markers"):
        check_marker_set(labels, CLIP.positions, OWN, given=True)
    clip = pf.Clip(CLIP.positions, labels, CLIP.rate)
    with pytest.raises(MarkerSetError, match="leave it out"):
        pf.fill(clip, method="linear", options=pf.FillOptions(marker_set=OWN))


def test_a_set_with_few_of_the_markers_is_noted_with_a_better_one() -> None:
    few = [label for label in OWN.labels if OWN.segment[label] == "head"]
    poor = pf.markers.marker_set.MarkerSet(
        "poor",
        tuple(few),
        dict.fromkeys(few, "head"),
        dict.fromkeys(few, True),
        {},
        ("head",),
    )
    (note,) = check_marker_set(CLIP.labels, CLIP.positions, poor, given=True)
    assert note.startswith("marker set poor has only 4 of the clip's 41 markers")
    assert f"{OWN.name} has " in note


def test_labels_in_the_wrong_order_are_noted() -> None:
    order = np.random.default_rng(2).permutation(len(CLIP.labels))
    clip = CLIP.with_positions(CLIP.positions[:, order])
    (note,) = check_marker_set(clip.labels, clip.positions, OWN, given=False)
    assert note.startswith(f"marker set {OWN.name} does not fit the body")
    assert pf.fill(clip, method="linear").notes == (note,)


def test_load_and_recognise_agree() -> None:
    assert load(OWN.name).labels == OWN.labels
