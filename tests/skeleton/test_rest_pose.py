"""Virtual markers depend on the motion, not on how a file describes the skeleton."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from skeleton_files import amc, asf, bvh

from priorfill.cli import main
from priorfill.errors import ClipError, MarkerSetError
from priorfill.formats.skeletons.asf_amc import parse_amc, parse_asf
from priorfill.formats.skeletons.bvh import parse_bvh
from priorfill.markers.definitions import load
from priorfill.skeleton.body_checks import check_markers
from priorfill.skeleton.joint_names import read_names
from priorfill.skeleton.joints import SkeletonMotion, forward_kinematics
from priorfill.skeleton.joints_file import read_joint_names
from priorfill.skeleton.marker_sites import MarkerSite
from priorfill.skeleton.virtual_markers import body_of, compute_virtual_markers

FRAMES = 50


def motion_of_amc() -> SkeletonMotion:
    return parse_amc(amc(FRAMES).encode(), parse_asf(asf().encode(), "a.asf"), "a.amc")


def motion_of_bvh() -> SkeletonMotion:
    return parse_bvh(bvh(FRAMES).encode(), "a.bvh")


def markers(motion: SkeletonMotion, **options: object) -> NDArray[np.float64]:
    found = compute_virtual_markers(
        motion,
        load("baumann41"),
        name="a",
        file="a.bvh",
        **options,  # type: ignore[arg-type]
    )
    return found.clip.positions


def with_rest_pose(motion: SkeletonMotion, seed: int) -> SkeletonMotion:
    """The same motion with joints whose axes are turned at random, in another rest pose."""
    skeleton, frames = motion.skeleton, len(motion.root)
    count = len(skeleton.names)
    own = Rotation.random(count, random_state=seed).as_matrix()
    above = [np.eye(3) if parent < 0 else own[parent] for parent in skeleton.parents]
    still = np.broadcast_to(np.eye(3), (frames, 3, 3))
    turns = {j: above[j].T @ motion.turns.get(j, still) @ own[j] for j in range(count)}
    offsets = np.array([above[j].T @ skeleton.offsets[j] for j in range(count)])
    ends = np.array([own[j].T @ skeleton.ends[j] for j in range(count)])
    moves = {j: move @ above[j] for j, move in motion.moves.items()}
    return replace(
        motion, skeleton=replace(skeleton, offsets=offsets, ends=ends), turns=turns, moves=moves
    )


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("read", [motion_of_amc, motion_of_bvh])
def test_the_rest_pose_does_not_matter(read: type, seed: int) -> None:
    motion = read()
    other = with_rest_pose(motion, seed)
    joints, again = (forward_kinematics(one).positions for one in (motion, other))
    np.testing.assert_allclose(again, joints, atol=1e-9)
    np.testing.assert_allclose(markers(other), markers(motion), atol=1e-6)


@pytest.mark.parametrize("turn", [(0, 70, 0), (-90, 0, 40), (90, 0, 0)])
def test_markers_turn_with_the_skeleton(turn: tuple[float, float, float]) -> None:
    motion = motion_of_bvh()
    world = Rotation.from_euler("xyz", turn, degrees=True).as_matrix()
    turns = motion.turns | {0: world @ motion.turns[0]}
    turned = replace(motion, root=motion.root @ world.T, turns=turns)
    np.testing.assert_allclose(markers(turned), markers(motion) @ world.T, atol=1e-6)


def test_a_file_of_positions_alone_places_markers_near_those_of_rotations() -> None:
    motion = motion_of_amc()
    poses = forward_kinematics(motion)
    parents = np.array(motion.skeleton.parents)
    steps = poses.positions - poses.positions[:, parents]
    moves = {j: steps[:, j] for j in range(1, len(parents))}
    alone = SkeletonMotion(
        replace(motion.skeleton, ends=np.zeros_like(motion.skeleton.ends)), motion.root, {}, moves
    )
    away = np.linalg.norm(markers(alone) - markers(motion), axis=2)
    assert np.median(away) < 40.0
    assert away.max() < 250.0


NAMING = {
    "blender": ("{name}.{S}", "thigh shin foot shoulder upper_arm forearm wrist hand"),
    "capitals": ("{name}_{S}", "UpperLeg LowerLeg Foot Shoulder UpperArm LowerArm Wrist Hand"),
    "mixamo": ("mixamorig:{Side}{name}", "UpLeg Leg Foot Shoulder Arm ForeArm ForeArmRoll Hand"),
    "biped": ("Bip01 {S} {name}", "Thigh Calf Foot Clavicle UpperArm Forearm ForeTwist Hand"),
    "joints": ("{Side}{name}", "Hip Knee Ankle Collar Shoulder Elbow Twist Wrist"),
    "unreal": ("{name}_{s}", "thigh calf foot clavicle upperarm lowerarm lowerarm_twist_01 hand"),
    "lower": ("{side}{name}", "upleg leg foot collar uparm lowarm wrist hand"),
    "motive": ("{S}{name}", "Thigh Shin Foot Shoulder UArm FArm FTwist Hand"),
    "second life": ("m{name}{Side}", "Hip Knee Ankle Collar Shoulder Elbow Twist Wrist"),
    "vrm": ("J_Bip_{S}_{name}", "UpperLeg LowerLeg Foot Shoulder UpperArm LowerArm Twist Hand"),
    "short": ("{Short}_{name}", "Thigh Shank Foot Clav Arm Forearm Roll Hand"),
    "numbers": ("b{number}", "0 1 2 3 4 5 6 7"),
}
BASES = ["femur", "tibia", "foot", "clavicle", "humerus", "radius", "wrist", "hand"]


def renamed(motion: SkeletonMotion, pattern: str, words: str) -> SkeletonMotion:
    """The same skeleton with other names of joints."""
    names = ["Hips"]
    known = [name.lower() for name in motion.skeleton.names]
    for number, name in enumerate(known[1:], start=1):
        base = next((b for b in BASES if name[1:] == b), None)
        if base is None:
            names.append(f"b{number}" if "number" in pattern else name)
            continue
        left = name[0] == "l"
        names.append(
            pattern.format(
                name=words.split()[BASES.index(base)],
                number=number,
                s=name[0],
                S=name[0].upper(),
                Side="Left" if left else "Right",
                side="left" if left else "right",
                Short="Lft" if left else "Rgt",
            )
        )
    if "number" in pattern:
        names[0] = "b0"
    return replace(motion, skeleton=replace(motion.skeleton, names=tuple(names)))


@pytest.mark.parametrize("naming", NAMING)
def test_joints_are_recognised_by_names_and_by_the_tree(naming: str) -> None:
    motion = motion_of_amc()
    found = body_of(renamed(motion, *NAMING[naming]), "a.bvh")[0].joints.parts
    expected = body_of(motion, "a.bvh")[0].joints.parts
    if naming == "numbers":  # nothing tells where the wrist twists
        expected = {p: j for p, j in expected.items() if not p.endswith("wrist")}
        found = {p: j for p, j in found.items() if not p.endswith("wrist")}
    assert {p: found[p] for p in expected if not p.endswith("wrist")} == {
        p: j for p, j in expected.items() if not p.endswith("wrist")
    }


def test_names_tell_sides_only_where_they_do() -> None:
    names = ["LeftLeg", "leg", "lleg", "R_Toe_End", "HeadTop_End", "lowerback", "rib"]
    assert [name.side for name in read_names(names)] == ["left", "", "left", "right", "", "", ""]
    assert [name.is_end for name in read_names(names)][3:5] == [True, True]
    assert [name.side for name in read_names(["L5", "T8", "RFArm", "LLLeg"])] == [
        "",
        "",
        "right",
        "left",
    ]


def test_unrecognised_joints_are_named_by_the_users_file(tmp_path: Path) -> None:
    motion = replace(
        motion_of_bvh(),
        skeleton=replace(
            motion_of_bvh().skeleton,
            names=tuple(
                name.replace("head", "abdomen2").replace("neck", "abdomen3")
                for name in motion_of_bvh().skeleton.names
            ),
        ),
    )
    file = tmp_path / "joints.toml"
    file.write_text('sides = ["l", "r"]\n[parts]\nthigh = "{s}Thigh"\nhead = "abdomen2"\n')
    joints = read_joint_names(file)
    assert joints == {"left_thigh": "lThigh", "right_thigh": "rThigh", "head": "abdomen2"}
    np.testing.assert_allclose(markers(motion, joints=joints), markers(motion_of_bvh()), atol=1e-6)
    with pytest.raises(ClipError, match="no joint is named 'nothing'"):
        markers(motion, joints={"head": "nothing"})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = 1", r"has no table \[parts\]"),
        ('[parts]\nknee = "a"', "part 'knee' is unknown"),
        ('[parts]\nthigh = "a"', "is a part of both sides"),
        ("[parts]\nhead = 3", "head is not a name in quotes"),
        ("[parts", "is not valid TOML"),
    ],
)
def test_a_wrong_file_of_joints_is_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "joints.toml").write_text(text)
    with pytest.raises(MarkerSetError, match=message):
        read_joint_names(tmp_path / "joints.toml")


def test_the_command_shows_how_joints_are_named(tmp_path: Path) -> None:
    text = bvh(FRAMES)
    for part in ("Thigh", "Shin", "Foot"):
        text = text.replace(f"l{part}", f"x{part}1").replace(f"r{part}", f"x{part}2")
    text = text.replace("lButtock", "x1").replace("rButtock", "x2")
    text = text.replace("lHand", "x3").replace("lTwist", "x4").replace("lForeArm", "x5")
    (tmp_path / "y.bvh").write_text(text.replace("head", "ball"))
    (tmp_path / "joints.toml").write_text(
        '[parts]\nleft_thigh = "xThigh1"\nleft_shank = "xShin1"\nleft_foot = "xFoot1"\n'
        'right_thigh = "xThigh2"\nright_shank = "xShin2"\nright_foot = "xFoot2"\nhead = "ball"\n'
    )
    add = ["db", "add", "-d", str(tmp_path / "db"), "--as", "41", str(tmp_path / "y.bvh")]
    done = CliRunner().invoke(main, [*add, "--joints", str(tmp_path / "joints.toml")])
    assert done.exit_code == 0, done.output
    done = CliRunner().invoke(main, [*add[:4], *add[6:], "--joints", str(tmp_path / "joints.toml")])
    assert done.exit_code == 2 and "--joints needs --as" in done.output


def test_the_unit_is_found_or_checked_by_the_size_of_the_body() -> None:
    motion = motion_of_bvh()
    found = compute_virtual_markers(motion, load("baumann41"), name="a", file="a.bvh")
    assert any("unit cm" in note for note in found.notes)
    for unit in (1.0, 25.4, 100.0, 1000.0):
        with pytest.raises(ClipError, match=r"in cm it would be 1\.81 m tall"):
            markers(motion, mm_per_unit=unit)
    for factor, unit in ((1.0, "cm"), (0.01, "m"), (1 / 2.54, "in"), (10.0, "mm"), (0.18, "ASF's")):
        skeleton = replace(motion.skeleton, offsets=motion.skeleton.offsets * factor)
        found = compute_virtual_markers(
            replace(motion, skeleton=skeleton, root=motion.root * factor),
            load("baumann41"),
            name="a",
            file="a.bvh",
        )
        assert any(f"unit {unit}," in note for note in found.notes)
    odd = replace(motion.skeleton, offsets=motion.skeleton.offsets * 1e6)
    with pytest.raises(ClipError, match="no usual unit"):
        markers(replace(motion, skeleton=odd))


def scaled(motion: SkeletonMotion, joint: str, factor: float) -> SkeletonMotion:
    offsets = motion.skeleton.offsets.copy()
    offsets[motion.skeleton.names.index(joint)] *= factor
    return replace(motion, skeleton=replace(motion.skeleton, offsets=offsets))


def test_a_body_unlike_a_persons_is_refused() -> None:
    motion = motion_of_bvh()
    with pytest.raises(ClipError, match=r"left shank is .* mm long, the right one"):
        markers(scaled(motion, "lFoot", 1.5))
    with pytest.raises(ClipError, match=r"left upper arm is .* not as in a person"):
        markers(scaled(motion, "lForeArm", 3.5))
    mirror = np.diag([1.0, 1.0, -1.0])
    image = replace(
        motion,
        skeleton=replace(
            motion.skeleton,
            offsets=motion.skeleton.offsets @ mirror,
            ends=motion.skeleton.ends @ mirror,
        ),
        root=motion.root @ mirror,
        turns={j: mirror @ turn @ mirror for j, turn in motion.turns.items()},
    )
    with pytest.raises(ClipError, match="left and right are exchanged"):
        markers(image)
    with pytest.raises(ClipError, match="the pelvis moves at"):
        markers(replace(motion, root=motion.root * 300.0))


def test_a_file_without_motion_in_a_rest_pose_that_is_none_is_refused() -> None:
    motion = motion_of_bvh()
    lengths = np.linalg.norm(motion.skeleton.offsets, axis=1)
    offsets = np.zeros((len(lengths), 3))
    offsets[:, 0] = lengths
    for side, z in (("l", 9.0), ("r", -9.0)):
        offsets[motion.skeleton.names.index(f"{side}Buttock")] = (0.0, 0.0, z)
        offsets[motion.skeleton.names.index(f"{side}Collar")] = (20.0, 0.0, z)
    flat = replace(motion.skeleton, offsets=offsets)
    with pytest.raises(ClipError, match="hip is bent by more than 120 degrees in every frame"):
        markers(replace(motion, skeleton=flat, turns={}))


def test_markers_off_their_bones_are_refused() -> None:
    body = body_of(motion_of_bvh(), "a.bvh")[0]
    sites = {"LKNE": (MarkerSite("left_thigh", 1.0, (0.0, 0.0, 0.0)),)}
    near = body.at("left_thigh")[:, None]
    check_markers(near, sites, body, "a.bvh")
    with pytest.raises(ClipError, match=r"frame \d+: marker LKNE would be 400 mm from the bone"):
        check_markers(near + body.upward * 400.0, sites, body, "a.bvh")


def test_the_up_axis_is_that_along_which_the_body_stands() -> None:
    motion = motion_of_bvh()
    expected = {(0, 0, 0): "+Y", (90, 0, 0): "+Z", (0, 0, 90): "+Y", (180, 0, 0): "+Y"}
    for turn, up in expected.items():
        world = Rotation.from_euler("xyz", turn, degrees=True).as_matrix()
        turned = replace(
            motion, root=motion.root @ world.T, turns=motion.turns | {0: world @ motion.turns[0]}
        )
        found = compute_virtual_markers(turned, load("baumann41"), name="a", file="a.bvh")
        assert found.clip.up == up
        assert any("else give `up`" in note for note in found.notes) == any(turn)


def test_a_body_that_lies_on_the_floor_does_not_stand_on_its_head() -> None:
    motion = motion_of_bvh()
    lying = Rotation.from_euler("x", 90, degrees=True).as_matrix()
    still = np.broadcast_to(lying, (FRAMES, 3, 3))
    root = np.tile([0.0, 12.0, 300.0], (FRAMES, 1))
    found = compute_virtual_markers(
        replace(motion, root=root, turns={0: still}), load("baumann41"), name="a", file="a.bvh"
    )
    assert found.clip.up == "+Y"


def test_many_frames_of_joints_that_do_not_move_are_refused_before_memory_is_taken() -> None:
    motion = motion_of_bvh()
    root = np.zeros((300_000, 3))
    with pytest.raises(ClipError, match=r"300000 frames of .* joints are too many"):
        markers(replace(motion, root=root, turns={}))


def test_one_person_among_the_roots_of_a_file_is_found() -> None:
    motion = motion_of_bvh()
    skeleton, count = motion.skeleton, len(motion.skeleton.names)
    two = replace(
        skeleton,
        names=(*skeleton.names, "ball"),
        parents=(*skeleton.parents, -1),
        offsets=np.vstack([skeleton.offsets, np.zeros(3)]),
        ends=np.vstack([skeleton.ends, np.zeros(3)]),
    )
    ball = {count: np.ones((FRAMES, 3))}
    np.testing.assert_allclose(
        markers(replace(motion, skeleton=two, moves=ball)), markers(motion), atol=1e-9
    )
    people = replace(
        skeleton,
        names=skeleton.names * 2,
        parents=(*skeleton.parents, *(p + count if p >= 0 else p for p in skeleton.parents)),
        offsets=np.tile(skeleton.offsets, (2, 1)),
        ends=np.tile(skeleton.ends, (2, 1)),
    )
    turns = motion.turns | {joint + count: turn for joint, turn in motion.turns.items()}
    with pytest.raises(ClipError, match="has the skeletons of 2 people"):
        markers(replace(motion, skeleton=people, turns=turns, moves={count: motion.root + 500.0}))


def test_angles_in_radians_are_noticed() -> None:
    motion = motion_of_bvh()
    turns = {
        joint: Rotation.from_rotvec(Rotation.from_matrix(turn).as_rotvec() / 57.3 * 4.0).as_matrix()
        for joint, turn in motion.turns.items()
    }
    found = compute_virtual_markers(
        replace(motion, turns=turns), load("baumann41"), name="a", file="a.bvh"
    )
    assert any("check whether angles are in radians" in note for note in found.notes)


def test_a_person_who_kneels_is_no_mirror_image() -> None:
    motion = motion_of_bvh()
    names, frames = motion.skeleton.names, np.ones((FRAMES, 1, 1))
    bent = {"Thigh": -70.0, "Shin": 140.0, "Foot": 45.0}
    turns = {
        names.index(side + limb): Rotation.from_euler("x", angle, degrees=True).as_matrix() * frames
        for limb, angle in bent.items()
        for side in "lr"
    }
    found = compute_virtual_markers(
        replace(motion, turns=turns), load("baumann41"), name="a", file="a.bvh"
    ).clip
    place = {label: found.positions[0, k] for k, label in enumerate(found.labels)}
    assert place["LTOE"][2] < place["LANK"][2] < place["LKNE"][2]  # they point backwards
    assert place["LTOE"][0] > place["RTOE"][0]
