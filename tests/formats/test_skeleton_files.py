"""ASF, AMC and BVH files as programs write them, and damaged ones."""

from __future__ import annotations

import time

import numpy as np
import pytest
from skeleton_files import amc, asf, bvh

from priorfill.errors import FormatError
from priorfill.formats.skeletons.asf_amc import parse_amc, parse_asf
from priorfill.formats.skeletons.bvh import parse_bvh
from priorfill.skeleton.joints import forward_kinematics


def test_comments_after_values_are_ignored() -> None:
    plain = parse_asf(asf().encode(), "a.asf")
    text = asf().replace("position 0 0 0", "position 0 0 0 # at the origin\n # nothing")
    noted = parse_asf(text.replace("angle deg", "angle deg   # of arc").encode(), "a.asf")
    np.testing.assert_array_equal(noted.axes, plain.axes)
    motion = parse_amc(amc(2).replace("\n2\n", "\n2 # second\n").encode(), noted, "a.amc")
    assert len(motion.root) == 2


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("length 2.54", "length 1e-300", "the unit of length is 1e-300"),
        ("position 0 0 0", "position 0 0 zero", r"line 9: 'zero' is not a number"),
        ("position 0 0 0", "position 0 0", "line 9: the root's position has 2 of 3 numbers"),
        ("position 0 0 0", "position 0 1_0 0", "line 9: '1_0' is not a number"),
        ("order TX TY TZ", "order TX TX TZ", "line 7: degree of freedom tx occurs twice"),
        ("order TX TY TZ", "order TX TY up", "line 7: 'up' is not a degree of freedom"),
        ("axis XYZ", "axis", "line 8: '' is not an order of axes"),
    ],
)
def test_errors_of_the_root_are_reported_with_the_line(old: str, new: str, message: str) -> None:
    with pytest.raises(FormatError, match=message):
        parse_asf(asf().replace(old, new, 1).encode(), "a.asf")


def test_a_value_that_is_repeated_on_a_line_is_read_once() -> None:
    text = asf().replace("position 0 0 0", "position 0 0 0 " * 50)
    assert parse_asf(text.encode(), "a.asf").root.tolist() == [0.0, 0.0, 0.0]


def test_frames_of_an_amc_file_that_do_not_follow_each_other_are_refused() -> None:
    skeleton = parse_asf(asf().encode(), "a.asf")
    with pytest.raises(FormatError, match="frame 7 follows frame 1"):
        parse_amc(amc(3).replace("\n2\n", "\n7\n").encode(), skeleton, "a.amc")
    with pytest.raises(FormatError, match="is not a number or too large"):
        parse_amc(amc(3).replace("\n2\n", f"\n{'9' * 5000}\n").encode(), skeleton, "a.amc")


def test_chains_without_end_are_refused_at_once() -> None:
    count = 100_000
    begun = time.perf_counter()
    joints = "".join(f"JOINT j{n}\n{{\nOFFSET 0 1 0\nCHANNELS 0\n" for n in range(count))
    text = "HIERARCHY\n" + joints.replace("JOINT", "ROOT", 1)
    with pytest.raises(FormatError, match="more than 200 joints in a chain"):
        parse_bvh(text.encode(), "a.bvh")
    flat = "HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\n" + "JOINT b\n{\nOFFSET 0 1 0\n}\n" * count
    with pytest.raises(FormatError, match="more than 2000 joints"):
        parse_bvh(flat.encode(), "a.bvh")
    bones = "".join(f"begin\nname b{n}\ndirection 0 1 0\nlength 1\nend\n" for n in range(count))
    with pytest.raises(FormatError, match="more than 2000 bones"):
        parse_asf((":bonedata\n" + bones).encode(), "a.asf")
    assert time.perf_counter() - begun < 5.0


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("Frames: 3", "Frames: 1000000000", "states 1000000000 frames but has 3"),
        ("Frames: 3", "Frames: nan", "'nan' is not a number"),
        ("OFFSET 0.0 25.0 0.0", "OFFSET 0 25 0\nOFFSET 0 25 0", "has a second OFFSET"),
        ("CHANNELS 3", "CHANNELS 1 Xrotation\nCHANNELS 3", "has CHANNELS twice"),
        ("HIERARCHY", "MOTION\nHIERARCHY", "line 1: does not begin with HIERARCHY"),
        ("0.0 90 0", "0.0,90,0", r"line \d+: has \d+ values, but the joints have \d+ channels"),
        ("0.0 90 0", "0.0 NaN 0", r"line \d+: 'NaN' is not a number"),
        (
            "CHANNELS 3 Zrotation Xrotation Yrotation",
            "CHANNELS 4 Zrotation Xrotation Yrotation Zrotation",
            "names more than 3 channels of rotation",
        ),
    ],
)
def test_damage_of_a_bvh_file_is_reported_in_one_line(old: str, new: str, message: str) -> None:
    text = bvh(3)
    assert old in text
    with pytest.raises(FormatError, match=message) as caught:
        parse_bvh(text.replace(old, new, 1).encode(), "a.bvh")
    assert "\n" not in str(caught.value)


def test_a_frame_time_of_zero_is_no_rate() -> None:
    text = bvh(3).replace("Frame Time: 0.00833333", "Frame Time:0").replace("Frames: 3", "Frames:3")
    assert parse_bvh(text.encode(), "a.bvh").rate is None


def test_braces_may_share_lines_with_names() -> None:
    text = bvh(3).replace("\n{\n", " {\n")
    assert (
        parse_bvh(text.encode(), "a.bvh").skeleton.names
        == parse_bvh(bvh(3).encode(), "a.bvh").skeleton.names
    )


def test_positions_of_joints_replace_offsets_unless_they_are_small() -> None:
    plain = forward_kinematics(parse_bvh(bvh(3).encode(), "a.bvh")).positions
    text = bvh(3)
    first = text.index("CHANNELS 3")
    name = text[:first].rindex("JOINT ")
    offset = text[text.index("OFFSET", name) + 7 : first].split()[:3]
    for place in (["0", "0", "0"], offset):
        moved = _insert(text, first, place)
        again = forward_kinematics(parse_bvh(moved.encode(), "a.bvh")).positions
        np.testing.assert_allclose(again, plain, atol=1e-9)


def _insert(text: str, first: int, place: list[str]) -> str:
    """Add channels of position with constant values to the first joint below the root."""
    old = "CHANNELS 3 Zrotation Xrotation Yrotation"
    head = text[:first] + text[first:].replace(
        old, "CHANNELS 6 Zrotation Xrotation Yrotation Xposition Yposition Zposition", 1
    )
    head, _, rows = head.partition("Frame Time: 0.00833333\n")
    lines = [" ".join([*(w := row.split())[:9], *place, *w[9:]]) for row in rows.splitlines()]
    return head + "Frame Time: 0.00833333\n" + "\n".join(lines) + "\n"


def test_a_second_root_is_another_skeleton() -> None:
    text = bvh(3)
    prop = "ROOT ball\n{\nOFFSET 0 0 0\nCHANNELS 3 Xposition Yposition Zposition\n}\n"
    head, _, rows = text.partition("MOTION\n")
    lines = rows.splitlines()
    lines[2:] = [f"{line} 1 2 3" for line in lines[2:]]
    motion = parse_bvh((head + prop + "MOTION\n" + "\n".join(lines)).encode(), "a.bvh")
    poses = forward_kinematics(motion)
    assert motion.skeleton.parents.count(-1) == 2
    np.testing.assert_allclose(poses.positions[:, -1], [[1.0, 2.0, 3.0]] * 3)
    alone = forward_kinematics(parse_bvh(text.encode(), "a.bvh"))
    np.testing.assert_allclose(poses.positions[:, :-1], alone.positions)
