"""Fragments and phantoms: which trajectories are no markers of their own."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from gappy import person
from numpy.typing import NDArray

import priorfill as pf
from priorfill.cli import main
from priorfill.clip import Clip
from priorfill.markers.phantoms import MAX_NOTES, find_phantoms, phantom_notes

TRUTH = person()


def with_trajectory(label: str, frames: slice, hidden: str = "") -> Clip:
    """The clip with one more trajectory, on the path of RBAC; ``hidden`` is missing meanwhile."""
    labels = (*TRUTH.labels, label)
    positions = np.full((TRUTH.frames, len(labels), 3), np.nan)
    positions[:, :-1] = TRUTH.positions
    positions[frames, -1] = TRUTH.positions[frames, TRUTH.labels.index("RBAC")]
    if hidden:
        positions[frames, labels.index(hidden)] = np.nan
    return Clip(positions, labels, TRUTH.rate, first_frame=101)


@pytest.mark.parametrize(
    "label", ["RBAC-1", "RBAC_2", "RBAC.3", "RBAC 1", "RBAC (2)", "RBAC-RBAC1"]
)
def test_a_trajectory_that_continues_a_marker_is_a_fragment(label: str) -> None:
    clip = with_trajectory(label, slice(60, 100), hidden="RBAC")
    (found,) = find_phantoms(clip, TRUTH.labels)
    assert clip.labels[found.marker] == label
    assert found.reason == (
        "a fragment of RBAC by its label, visible in 40 of 240 frames (frames 161-200)"
    )


def test_markers_of_a_cluster_are_no_fragments() -> None:
    assert find_phantoms(with_trajectory("RBAC-1", slice(0, 100)), TRUTH.labels) == ()
    assert find_phantoms(with_trajectory("THIGH-1", slice(0, 100)), TRUTH.labels) == ()


def test_a_trajectory_of_a_frame_is_a_phantom() -> None:
    clip = with_trajectory("glint", slice(60, 61))
    (found,) = find_phantoms(clip, TRUTH.labels)
    assert found.reason == "visible in 1 of 240 frames (frame 161) only; taken as a phantom"


def test_a_marker_of_the_set_or_of_another_recording_is_a_dropout() -> None:
    clip = with_trajectory("glint", slice(60, 61))
    assert find_phantoms(clip, (*TRUTH.labels, "glint")) == ()
    assert find_phantoms(with_trajectory("glint", slice(0, 0)), TRUTH.labels) == ()


@pytest.mark.parametrize("label", ["RBAC-1", "glint"])
def test_they_are_filled_only_by_name(label: str) -> None:
    frames = slice(60, 100) if label == "RBAC-1" else slice(60, 62)
    clip = with_trajectory(label, frames, hidden="RBAC" if label == "RBAC-1" else "")
    result = pf.fill(clip, method="linear")
    column = clip.labels.index(label)
    assert not result.filled[:, column].any()
    (note,) = [text for text in result.notes if text.startswith(f"{label}: ")]
    assert note.endswith("not filled unless named in `markers`")
    alone = {span.reason for gap in result.gaps if gap.label == label for span in gap.unfilled}
    assert len(alone) == 1
    assert alone.pop() in note
    if label == "RBAC-1":
        assert result.filled[frames, clip.labels.index("RBAC")].all()
    named = pf.fill(clip, method="linear", gap_filter=pf.GapFilter(markers=(label,)))
    spans = [span for gap in named.gaps if gap.label == label for span in gap.unfilled]
    assert all(span.requested for span in spans)  # a fill that is not believed was requested
    assert not any("unless named" in note for note in named.notes)


def test_inspect_names_them(tmp_path: Path) -> None:
    pf.write(tmp_path / "walk.npz", with_trajectory("RBAC-1", slice(60, 100), hidden="RBAC"))
    done = CliRunner().invoke(main, ["inspect", str(tmp_path / "walk.npz"), "--json"])
    facts = json.loads(done.stdout)
    assert [phantom["marker"] for phantom in facts["phantoms"]] == ["RBAC-1"]
    assert any("RBAC-1: a fragment of RBAC" in note for note in facts["notes"])
    done = CliRunner().invoke(main, ["inspect", str(tmp_path / "walk.npz")])
    assert "not filled unless --markers names them: RBAC-1." in done.stdout


def test_many_phantoms_have_few_notes() -> None:
    labels = tuple(f"glint{i}x" for i in range(50))
    positions = np.full((200, 50, 3), np.nan)
    positions[7] = 1.0
    clip = Clip(positions, labels, 100.0)
    notes = phantom_notes(clip, find_phantoms(clip))
    assert len(notes) == MAX_NOTES + 1
    assert notes[-1].startswith(f"{50 - MAX_NOTES} more fragments and phantoms are not filled: ")


def test_many_fragments_cost_as_much_each_as_few(monkeypatch: pytest.MonkeyPatch) -> None:
    """The whole clip is not read again for each of them."""
    reads = []

    def missing(clip: Clip) -> NDArray[np.bool_]:
        reads.append(clip)
        return np.isnan(clip.positions[..., 0])

    monkeypatch.setattr(Clip, "missing", property(missing))
    count = {}
    for number in (4, 40):
        positions = np.full((200, number, 3), np.nan)
        positions[7, ::2], positions[9, 1::2] = 1.0, 1.0
        labels = tuple(f"M{i // 2}{'-1' * (i % 2)}" for i in range(number))
        reads.clear()
        assert len(find_phantoms(Clip(positions, labels, 100.0))) == number
        count[number] = len(reads)
    assert count[4] == count[40]


def test_labels_of_any_length_are_matched_in_time() -> None:
    labels = ("_" * 20000, "A" + " -" * 10000 + "1")
    assert find_phantoms(Clip(np.full((200, 2, 3), np.nan), labels, 100.0)) == ()
