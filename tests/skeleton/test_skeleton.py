from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from skeleton_files import amc, angle, asf, axis, bones, bvh

from priorfill.cli import main
from priorfill.database import PriorDatabase
from priorfill.errors import ClipError, FormatError, PriorfillError
from priorfill.formats.skeletons.asf_amc import (
    find_asf,
    parse_amc,
    parse_asf,
    read_amc,
    read_asf,
)
from priorfill.formats.skeletons.bvh import parse_bvh
from priorfill.markers.definitions import load
from priorfill.skeleton.joints import SkeletonMotion, forward_kinematics
from priorfill.skeleton.learn_sites import learn_sites
from priorfill.skeleton.marker_sites import known_sites, marker_positions
from priorfill.skeleton.virtual_markers import body_of, compute_virtual_markers

FRAMES = 40


def amc_motion(frames: int = FRAMES) -> SkeletonMotion:
    return parse_amc(amc(frames).encode(), parse_asf(asf().encode(), "a.asf"), "a.amc")


def matrix(rotation: NDArray[np.float64], offset: object = (0.0, 0.0, 0.0)) -> NDArray[np.float64]:
    whole = np.eye(4)
    whole[:3, :3], whole[:3, 3] = rotation, offset
    return whole


def test_asf_and_amc_agree_with_homogeneous_matrices() -> None:
    # L = C M C^-1 in each bone, about fixed axes x, then y, then z (Acclaim's ASF/AMC)
    motion, frame = amc_motion(), 7
    poses = forward_kinematics(motion)
    assert motion.skeleton.mm_per_unit == pytest.approx(10.0)
    root = [angle("root", channel, frame) for channel in range(3)]
    turned = Rotation.from_euler("xyz", root, degrees=True).as_matrix()
    ends = {"root": matrix(turned, (0.5 * frame, 90, 0))}
    for name, (parent, end, dof) in bones().items():
        angles = np.zeros(3)
        for channel, letter in enumerate(dof.split()):
            angles["xyz".index(letter[1])] = angle(name, channel, frame)
        own = Rotation.from_euler("xyz", axis(name), degrees=True)
        local = own * Rotation.from_euler("xyz", angles, degrees=True) * own.inv()
        start = ends[parent] @ matrix(local.as_matrix())
        joint = motion.skeleton.names.index(name)
        np.testing.assert_allclose(poses.positions[frame, joint], start[:3, 3], atol=1e-9)
        np.testing.assert_allclose(poses.rotations[frame, joint], start[:3, :3], atol=1e-9)
        ends[name] = start @ matrix(np.eye(3), end)


def test_bvh_agrees_with_homogeneous_matrices() -> None:
    motion, frame = parse_bvh(bvh(FRAMES).encode(), "a.bvh"), 11
    poses, skeleton = forward_kinematics(motion), motion.skeleton
    assert motion.rate == 120.0
    worlds: list[NDArray[np.float64]] = []
    values = [float(v) for v in bvh(FRAMES).splitlines()[-FRAMES + frame].split()]
    for joint, parent in enumerate(skeleton.parents):
        first = 3 + 3 * joint
        turn = Rotation.from_euler("ZXY", values[first : first + 3], degrees=True).as_matrix()
        offset = values[:3] if parent < 0 else skeleton.offsets[joint]
        worlds.append((np.eye(4) if parent < 0 else worlds[parent]) @ matrix(turn, offset))
        np.testing.assert_allclose(poses.positions[frame, joint], worlds[-1][:3, 3], atol=1e-9)
        np.testing.assert_allclose(poses.rotations[frame, joint], worlds[-1][:3, :3], atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("length 42.0", "length four", 54, "'four' is not a number"),
        ("    dof rx ry rz", "    dof rx ry q", 18, "'q' is not a degree of freedom"),
        ("    root lowerback", "    root lowerbck", None, "lowerbck is not among"),
    ],
)
def test_errors_in_an_asf_file_are_reported_with_the_line(
    old: str, new: str, line: int | None, message: str
) -> None:
    text = asf().replace(old, new, 1)
    assert text != asf()
    number = line or next(i for i, row in enumerate(text.splitlines(), 1) if "lowerbck" in row)
    with pytest.raises(FormatError, match=re.escape(f"a.asf: line {number}: ") + f".*{message}"):
        parse_asf(text.encode(), "a.asf")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("\n2\n", "\n2\nltoes 1\n", "line 26: bone ltoes cannot move"),
        ("\nltibia ", "\nltibia 3 ", r"line \d+: bone ltibia has 2 values, but 1 in the skeleton"),
        ("\nltibia ", "\nltibia x", r"line \d+: 'x.*is not a number"),
        ("\nltibia ", "\n# ", r"line \d+: bone ltibia has no values in frame 3"),
    ],
)
def test_errors_in_an_amc_file_are_reported_with_the_line(old: str, new: str, message: str) -> None:
    text = amc(3)
    assert old in text
    if new == "\n# ":
        text = text[: text.rindex(old)] + "\n# " + text[text.rindex(old) + 1 :]
    else:
        text = text.replace(old, new, 1)
    with pytest.raises(FormatError, match="a.amc: " + message):
        parse_amc(text.encode(), parse_asf(asf().encode(), "a.asf"), "a.amc")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("HIERARCHY", "hello", "line 1: does not begin with HIERARCHY"),
        ("CHANNELS 3", "CHANNELS 4", r"line \d+: states 4 channels but names 3"),
        ("Frames: 3", "Frames: 4", "states 4 frames but has 3"),
        ("OFFSET 0.0 25.0 0.0", "", r"line 6: joint chest has no OFFSET|line \d+: joint"),
        ("0.0 25.0", "0.0 1e300", r"line \d+: '1e300' is not a number or too large"),
        ("MOTION", "", r"line \d+: 'Frames:' is not expected here"),
        ("Xrotation", "Wrotation", r"line \d+: 'wrotation' is not a channel"),
        (
            "CHANNELS 3 Zrotation Xrotation Yrotation",
            "CHANNELS 3 Zrotation Xrotation Yrotation\nCHANNELS 3 Zrotation Xrotation Yrotation",
            "line .*: joint .* has CHANNELS twice",
        ),
    ],
)
def test_errors_in_a_bvh_file_are_reported(old: str, new: str, message: str) -> None:
    with pytest.raises(FormatError, match="a.bvh: " + message):
        parse_bvh(bvh(3).replace(old, new, 1).encode(), "a.bvh")


def test_truncated_files_are_read_or_refused_in_one_line() -> None:
    skeleton = parse_asf(asf().encode(), "a.asf")
    for text, read in (
        (asf(), lambda data: parse_asf(data, "a")),
        (amc(3), lambda data: parse_amc(data, skeleton, "a")),
        (bvh(3), lambda data: parse_bvh(data, "a")),
    ):
        for cut in range(0, len(text), 61):
            try:
                read(text[:cut].encode())
            except FormatError as error:
                assert "\n" not in str(error)


def test_the_skeleton_of_an_amc_file_is_found_by_name(tmp_path: Path) -> None:
    for name in ("01.asf", "HDM_d.asf", "HDM_dg.asf"):
        (tmp_path / name).touch()
    assert find_asf(tmp_path / "01_02.amc") == tmp_path / "01.asf"
    assert find_asf(tmp_path / "HDM_dg_06-03.amc") == tmp_path / "HDM_dg.asf"
    assert find_asf(tmp_path / "HDM_bd_06.amc") is None
    assert find_asf(tmp_path / "011_02.amc") is None


def test_learning_recovers_known_sites() -> None:
    motion = amc_motion(120)
    frames = body_of(motion, "a.asf")[0].frames
    sites = known_sites()
    labels = [label for label, some in sites.items() if len(some) == 1]
    single = {label: sites[label] for label in labels}
    markers = marker_positions(single, frames)
    marker_set = load("baumann41")
    contralateral = [labels.index(marker_set.mirror.get(label, label)) if
               marker_set.mirror.get(label, label) in labels else i
               for i, label in enumerate(labels)]  # fmt: skip
    segments = [marker_set.segment[label] for label in labels]
    learnt = learn_sites(frames, markers, segments, contralateral, 120.0)
    again = marker_positions(dict(zip(labels, learnt, strict=True)), frames)
    assert np.abs(again - markers).max() < 0.1


def test_markers_are_the_same_on_another_kind_of_skeleton() -> None:
    """The same body in its rest pose, as ASF in mm and as BVH in an unknown unit."""
    still = parse_amc(
        re.sub(r"(?m)^([a-z]+) .*$", _at_rest, amc(2)).encode(),
        parse_asf(asf().encode(), "a.asf"),
        "a.amc",
    )
    marker_set = load("baumann41")
    here = compute_virtual_markers(still, marker_set, name="a", file="a.amc").clip
    rest = parse_bvh(bvh(2, still=True).encode(), "a.bvh")
    there = compute_virtual_markers(rest, marker_set, name="b", file="b.bvh").clip
    assert here.labels == there.labels and len(here.labels) == 41
    assert (here.up, there.up, here.rate, there.rate) == ("+Y", "+Y", 120.0, 120.0)
    away = np.linalg.norm(here.positions - there.positions, axis=2)
    assert away.max() < 1e-6


def _at_rest(match: re.Match[str]) -> str:
    words = match[0].split()
    values = words[1:4] if words[0] == "root" else []
    return " ".join([words[0], *values, *["0"] * (len(words) - 1 - len(values))])


def test_markers_scale_with_the_body() -> None:
    motion, marker_set = amc_motion(), load("baumann41")
    small = compute_virtual_markers(motion, marker_set, name="a", file="a").clip
    large = compute_virtual_markers(motion, marker_set, name="a", file="a", mm_per_unit=11.0).clip
    np.testing.assert_allclose(large.positions, 1.1 * small.positions, atol=1e-6)


def test_markers_without_known_sites_are_left_out() -> None:
    clip = compute_virtual_markers(amc_motion(), load("plug-in-gait"), name="a", file="a").clip
    assert "LKNE" in clip.labels and "RBAK" in clip.labels and "LASI" not in clip.labels


def test_a_skeleton_of_no_person_is_refused() -> None:
    joints = "JOINT a\n{\nOFFSET 0 1 0\nCHANNELS 0\nJOINT b\n{\nOFFSET 0 1 0\nCHANNELS 0\n}\n}\n"
    text = "HIERARCHY\nROOT hips\n{\nOFFSET 0 0 0\nCHANNELS 3 Xposition Yposition Zposition\n"
    text += joints + "}\nMOTION\nFrames: 1\nFrame Time: 0.01\n0 0 0\n"
    with pytest.raises(ClipError, match=r"a\.bvh: no joint is recognised as .*`joints`"):
        compute_virtual_markers(
            parse_bvh(text.encode(), "a"), load("baumann41"), name="a", file="a.bvh"
        )
    with pytest.raises(ClipError, match="`unit`"):
        compute_virtual_markers(
            amc_motion(), load("baumann41"), name="a", file="a", mm_per_unit=1.0
        )


def test_db_add_marks_virtual_markers_and_requires_a_marker_set(tmp_path: Path) -> None:
    (tmp_path / "x.asf").write_text(asf())
    (tmp_path / "x_1.amc").write_text(amc(FRAMES))
    (tmp_path / "y.bvh").write_text(bvh(FRAMES))
    run, folder = CliRunner(), str(tmp_path / "db")
    add = ["db", "add", "-d", folder]
    done = run.invoke(main, [*add, str(tmp_path / "y.bvh")])
    assert done.exit_code == 1 and "--as 41" in done.output
    done = run.invoke(main, [*add, "--as", "41", str(tmp_path)])
    assert done.exit_code == 0, done.output
    with PriorDatabase.open(tmp_path / "db") as database:
        records = {record.name: record for record in database.clips()}
        assert all(r.virtual_markers and not r.synthetic for r in records.values())
        assert (records["x_1"].subject, records["x_1"].source) == ("x", "x_1.amc")
        assert database.info().virtual_markers == 2
    listed = run.invoke(main, ["db", "list", "-d", folder])
    assert listed.output.count("virtual markers") == 2
    assert run.invoke(main, ["db", "verify", "-d", folder]).exit_code == 0
    (tmp_path / "x.asf").unlink()
    done = run.invoke(main, [*add, "--as", "41", str(tmp_path / "x_1.amc")])
    assert done.exit_code == 1 and "--skeleton" in done.output
    done = run.invoke(
        main,
        ["db", "add", "-v", "-d", f"{folder}2", "--as", "plug-in-gait", str(tmp_path / "y.bvh")],
    )
    assert done.exit_code == 0 and "y.bvh (33 of 40 markers computed)" in done.output
    assert (
        "note: unit cm, found from the height of the body (else give --unit): 1 file" in done.output
    )
    wrong = run.invoke(main, [*add, "--as", "40", str(tmp_path / "y.bvh")])
    assert wrong.exit_code == 2 and isinstance(wrong.exception, SystemExit | PriorfillError)


@pytest.mark.realdata
def test_virtual_markers_are_near_the_recorded_ones(data: Path) -> None:
    from priorfill.formats import read

    data = data / "hdm05"
    take = data / "HDM_dg_06-03_03_120"
    skeleton = read_asf(data / "HDM_dg.asf")
    clip = compute_virtual_markers(
        read_amc(take.with_suffix(".amc"), skeleton), load("baumann41"), name="dg", file="dg"
    ).clip
    recorded = read(take.with_suffix(".c3d"))
    columns = [recorded.labels.index(label) for label in clip.labels]
    away = clip.positions - recorded.positions[:, columns][..., [1, 2, 0]]
    assert np.sqrt((away**2).sum(axis=2).mean()) <= 14.0
