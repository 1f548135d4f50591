"""Marker sets: shipped and user definitions, recognition, and discovery from data."""

from __future__ import annotations

import os
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from priorfill.clip import Clip
from priorfill.errors import MarkerSetError, OptionError
from priorfill.geometry.distances import pair_distances
from priorfill.geometry.rigid_groups import MIN_COMMON, rigid_groups
from priorfill.markers.definitions import available, load, recognise
from priorfill.markers.describe import describe
from priorfill.markers.discover import discover
from priorfill.markers.marker_set import DISCOVERED, MarkerSet

# Baumann et al. 2011, table 1
RELIABLE = [
    "LFHD",
    "RFHD",
    "LBHD",
    "RBHD",
    "C7",
    "STRN",
    "LELB",
    "LWRA",
    "LWRB",
    "LFIN",
    "RELB",
    "RWRA",
    "RWRB",
    "RFIN",
    "LKNE",
    "LANK",
    "LHEE",
    "RKNE",
    "RANK",
    "RHEE",
]
NOT_RELIABLE = [
    "T10",
    "CLAV",
    "RBAC",
    "LSHO",
    "LUPA",
    "LFRM",
    "RSHO",
    "RUPA",
    "RFRM",
    "LFWT",
    "RFWT",
    "LBWT",
    "RBWT",
    "LTHI",
    "LSHN",
    "LTOE",
    "LMT5",
    "RTHI",
    "RSHN",
    "RTOE",
    "RMT5",
]

MINIMAL = """
name = "mine"
title = "My set"
root_segments = ["pelvis"]
[markers]
A = { segment = "pelvis", reliable = true }
B = { segment = "pelvis" }
LC = { segment = "leg", optional = true }
"""


@pytest.fixture(autouse=True)
def no_user_sets(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("PRIORFILL_MARKERSETS", raising=False)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))


def body(frames: int = 200, noise: float = 0.0, seed: int = 0) -> tuple[np.ndarray, list[int]]:
    """Five segments of four markers, hinged in a chain, that swing and turn.

    Returns positions (frames, 20, 3) in mm and the segment of each marker.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(frames)[:, None] / 100
    origin = np.stack([800 * t[:, 0], 50 * np.sin(3 * t[:, 0]), 1000 + 0 * t[:, 0]], axis=1)
    markers = []
    for segment in range(5):
        frequency = rng.uniform(0.7, 1.5, (1, 3))
        angle = 0.6 * np.sin(2 * np.pi * frequency * t + rng.uniform(0, 6, (1, 3)))
        turn = Rotation.from_rotvec(angle).as_matrix()
        local = rng.uniform(-90, 90, (4, 3)) + np.array([0, 0, -200])
        markers.append(origin[:, None] + np.einsum("fij,mj->fmi", turn, local))
        if segment:
            origin = origin + turn @ np.array([0.0, 0.0, -400.0])
    positions = np.concatenate(markers, axis=1)
    return positions + rng.normal(0, noise, positions.shape) if noise else positions, [
        m // 4 for m in range(20)
    ]


def pair_agreement(truth: list[str], found: list[str]) -> tuple[float, float]:
    """Precision and recall of "these two markers are on one segment"."""
    pairs = list(combinations(range(len(truth)), 2))
    same = {(i, j) for i, j in pairs if truth[i] == truth[j]}
    together = {(i, j) for i, j in pairs if found[i] == found[j]}
    return len(same & together) / len(together), len(same & together) / len(same)


# --- definitions -----------------------------------------------------------------------------


def test_shipped_sets() -> None:
    sets = available()
    assert sorted(sets) == ["baumann41", "gait59", "plug-in-gait"]
    assert {name: len(s.labels) - len(s.optional) for name, s in sets.items()} == {
        "baumann41": 41,
        "gait59": 59,
        "plug-in-gait": 39,
    }
    for marker_set in sets.values():
        assert set(marker_set.segment) == set(marker_set.reliable) == set(marker_set.labels)
        for label, other in marker_set.mirror.items():
            assert marker_set.mirror[other] == label
        for root in marker_set.root_segments:
            assert len(marker_set.segments[root]) >= 3
        assert sum(marker_set.reliable.values()) >= 20


def test_reliable_bits_of_baumann_2011() -> None:
    bits = load("baumann41").reliable
    assert [label for label in RELIABLE if not bits[label]] == []
    assert [label for label in NOT_RELIABLE if bits[label]] == []
    assert len(bits) == len(RELIABLE) + len(NOT_RELIABLE) == 41


def test_mirror_of_baumann41() -> None:
    mirror = load("baumann41").mirror
    assert mirror["LFHD"] == "RFHD"
    assert mirror["RMT5"] == "LMT5"
    assert mirror["C7"] == "C7"
    assert "RBAC" not in mirror  # there is no LBAC


def test_definition_by_path(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(MINIMAL + '[aliases]\nA = ["AA"]\n[mirror]\nA = "B"\n')
    marker_set = load(path)
    assert marker_set == MarkerSet(
        name="mine",
        labels=("A", "B", "LC"),
        segment={"A": "pelvis", "B": "pelvis", "LC": "leg"},
        reliable={"A": True, "B": False, "LC": False},
        mirror={"A": "B", "B": "A"},
        root_segments=("pelvis",),
        title="My set",
        aliases={"AA": "A"},
        optional=frozenset({"LC"}),
    )
    assert marker_set.match(["lc", "AA", "x", "B"]) == {"lc": "LC", "AA": "A", "B": "B"}
    assert marker_set.match(["AA", "A"]) == {"A": "A"}


def test_an_edited_definition_is_read_again(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(MINIMAL)
    assert load(path).title == "My set"
    path.write_text(MINIMAL.replace("My set", "Another"))
    os.utime(path, ns=(1, 1))
    assert load(path).title == "Another"


@pytest.mark.parametrize("where", ["environment", "config"])
def test_user_folders(where: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / ("sets" if where == "environment" else "config/priorfill/markersets")
    folder.mkdir(parents=True)
    if where == "environment":
        monkeypatch.setenv("PRIORFILL_MARKERSETS", str(folder))
    (folder / "a.toml").write_text(MINIMAL)
    (folder / "b.toml").write_text(MINIMAL.replace('"mine"', '"gait59"'))
    assert load("mine").title == "My set"
    assert load("gait59").title == "My set"  # the user's definition takes precedence
    assert recognise(["A", "B"]) == load("gait59")  # equally good: the first by name


def test_user_folder_that_is_not_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PRIORFILL_MARKERSETS", str(tmp_path / "nowhere"))
    with pytest.raises(MarkerSetError, match="is not a folder; set PRIORFILL_MARKERSETS"):
        available()


def test_two_definitions_of_one_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PRIORFILL_MARKERSETS", str(tmp_path))
    (tmp_path / "a.toml").write_text(MINIMAL)
    (tmp_path / "b.toml").write_text(MINIMAL)
    with pytest.raises(MarkerSetError, match=r"b\.toml: the name mine is also that of a\.toml"):
        available()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("name =", "name = = "), "is not valid TOML"),
        (('name = "mine"', ""), "has no name"),
        (('"mine"', '"../x"'), "is not allowed"),
        (('title = "My set"', ""), "has no title"),
        (('title = "My set"', "title = 3"), "has no title"),
        (('title = "My set"', 'titel = "x"'), "key titel is unknown"),
        (('root_segments = ["pelvis"]', ""), "has no root_segments"),
        (('["pelvis"]', '"pelvis"'), "root_segments is not a list of names"),
        (('["pelvis"]', '["head"]'), "root segment head has no markers; use some of leg, pelvis"),
        (('B = { segment = "pelvis" }', "B = { reliable = true }"), "marker B has no segment"),
        (('B = { segment = "pelvis" }', 'B = "pelvis"'), "marker B has no segment"),
        (("reliable = true", 'reliable = "yes"'), "marker A has reliable = 'yes'"),
        (("reliable = true", "relaible = true"), "marker A has the unknown key relaible"),
        (("[markers]", 'midline = ["Z"]\n[markers]'), "midline names Z"),
        (("[markers]", 'mirror = "A/B"\n[markers]'), "mirror = 'A/B' is unknown"),
        (("[markers]", '[aliases]\nZ = ["Y"]\n[markers]'), "aliases names Z"),
        (("[markers]", '[aliases]\nA = ["B"]\n[markers]'), "alias B of A is also another marker"),
        (("[markers]", '[aliases]\nA = "C"\n[markers]'), "A is not a list of names"),
        (("[markers]", 'aliases = "A"\n[markers]'), "aliases is not a table"),
        (("[markers]", 'joints = "A"\n[markers]'), "joints is not a table"),
        (("[markers]", '[joints]\nknee = [["A"], ["B"]]\n[markers]'), "knee is not three lists"),
        (("[markers]", '[joints]\nk = [["A"], [], ["B"]]\n[markers]'), "k is not three lists"),
        (("[markers]", '[joints]\nk = [["A"], ["Z"], ["B"]]\n[markers]'), "joints names Z"),
        (("[markers]", '[mirror]\nA = "Z"\n[markers]'), "mirror names Z"),
        (("[markers]", '[mirror]\nA = "B"\nB = "LC"\n[markers]'), "two mirror images"),
        (
            ("[markers]", 'midline = ["A"]\nmirror = { A = "B" }\n[markers]'),
            "A is in midline but mirrors onto B",
        ),
    ],
)
def test_malformed_definitions(change: tuple[str, str], message: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    assert change[0] in MINIMAL
    path.write_text(MINIMAL.replace(*change))
    with pytest.raises(MarkerSetError) as caught:
        load(path)
    text = str(caught.value)
    assert message in text
    assert text.startswith(f"{path}: ")
    assert "\n" not in text


def test_unreadable_definitions(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for place in ("no.toml", "no/set", "file/set.toml"):
        with pytest.raises(OptionError, match="there is no such marker set; check the path"):
            load(tmp_path / place)
    with pytest.raises(MarkerSetError, match="cannot be read"):
        load(tmp_path / f"{'n' * 300}.toml")  # longer than names may be
    with pytest.raises(OptionError, match=r"is unknown; did you mean baumann41\?"):
        load("baumann42")
    (tmp_path / "empty.toml").write_text('name = "x"\ntitle = "y"\n')
    with pytest.raises(MarkerSetError, match="has no markers"):
        load(tmp_path / "empty.toml")
    (tmp_path / "latin.toml").write_bytes(b'name = "\xe4"\n')
    with pytest.raises(MarkerSetError, match="is not valid TOML"):
        load(tmp_path / "latin.toml")


# --- recognition -----------------------------------------------------------------------------


def name_of(labels: list[str]) -> str | None:
    marker_set = recognise(labels)
    return None if marker_set is None else marker_set.name


def test_recognises_whole_sets() -> None:
    for name, marker_set in available().items():
        assert name_of(list(marker_set.labels)) == name
        assert name_of([label.lower() for label in reversed(marker_set.labels)]) == name


def test_recognises_sets_with_markers_missing_or_added() -> None:
    labels = list(load("baumann41").labels)
    without = [label for label in labels if label not in ("LBHD", "RBHD")]
    assert name_of(without) == "baumann41"
    assert name_of([*labels, "RBAC-1", "MIHD"]) == "baumann41"
    pig = load("plug-in-gait")
    sacr = [label for label in pig.labels if label not in ("LPSI", "RPSI")]
    assert name_of(sacr) == "plug-in-gait"
    legs = [
        x for x in pig.labels if x[1:] in ("ASI", "PSI", "THI", "KNE", "TIB", "ANK", "HEE", "TOE")
    ]
    assert len(legs) == 16
    assert name_of(legs) == "plug-in-gait"


def test_does_not_recognise_what_is_not_known() -> None:
    assert name_of([f"M{i:02d}" for i in range(1, 38)]) is None
    assert name_of(["r_asis", "l_asis", "sacrum", "r_heel", "l_heel"]) is None
    assert name_of(["LASI", "RASI", "SACR"]) is None
    assert name_of([]) is None


# --- discovery -------------------------------------------------------------------------------


@pytest.mark.parametrize("frames", [50, 120, 400])
def test_discovers_the_segments_of_a_body(frames: int) -> None:
    positions, truth = body(frames, noise=1.0)
    labels = [f"M{i}" for i in range(20)]
    found = discover(positions, labels)
    assert found.name == DISCOVERED
    assert [int(found.segment[label][-2:]) - 1 for label in labels] == truth
    assert all(found.reliable.values())
    assert sorted(found.root_segments) == [f"segment0{i}" for i in range(1, 6)]
    assert found.mirror == {}


def test_discovery_with_gaps_and_a_dropout() -> None:
    positions, _ = body(300, noise=1.0)
    rng = np.random.default_rng(5)
    for marker in range(19):
        start = rng.integers(0, 250)
        positions[start : start + rng.integers(20, 200), marker] = np.nan
    positions[:, 7] = np.nan
    labels = [f"M{i}" for i in range(20)]
    found = discover(positions, labels)
    assert found.segments[found.segment["M7"]] == ("M7",)
    assert not found.reliable["M7"]
    for first in (0, 8, 12, 16):
        assert len({found.segment[f"M{m}"] for m in range(first, first + 4)}) == 1
    assert len({found.segment[f"M{m}"] for m in (4, 5, 6)}) == 1


def test_discovery_depends_on_neither_order_nor_place() -> None:
    positions, _ = body(150, noise=2.0, seed=3)
    labels = [f"M{i}" for i in range(20)]
    found = discover(positions, labels)
    order = np.random.default_rng(1).permutation(20)
    again = discover(positions[:, order] + [1000.0, -500.0, 20.0], [labels[i] for i in order])
    groups = {frozenset(group) for group in found.segments.values()}
    assert {frozenset(group) for group in again.segments.values()} == groups
    assert again.reliable == found.reliable
    root = found.segments[found.root_segments[0]]
    assert set(again.segments[again.root_segments[0]]) == set(root)


def test_nothing_rigid() -> None:
    positions = np.random.default_rng(0).normal(0, 500, (100, 8, 3))
    found = discover(positions, list("abcdefgh"))
    assert all(len(group) == 1 for group in found.segments.values())
    assert all(found.reliable.values())  # no better ones to search by
    assert len(found.root_segments) == 8


def test_all_rigid_short_single_and_empty() -> None:
    positions, _ = body(100)
    still = np.repeat(positions[:1], 100, axis=0)
    assert len(discover(still, [f"M{i}" for i in range(20)]).segments) == 1
    assert len(discover(positions[:5], [f"M{i}" for i in range(20)]).segments) == 20
    one = discover(positions[:, :1], ["M0"])
    assert one.segments == {"segment01": ("M0",)}
    gone = discover(np.full((100, 2, 3), np.nan), ["a", "b"])
    assert gone.reliable == {"a": False, "b": False}


def test_root_is_central() -> None:
    """Of five equally rigid segments in a chain, the middle one carries the root frame."""
    positions, _ = body(200)
    found = discover(positions, [f"M{i}" for i in range(20)])
    assert set(found.root_segments[:2]) <= {"segment02", "segment03", "segment04"}
    positions[50:, 8:12] = np.nan  # the middle one is hardly ever visible
    again = discover(positions, [f"M{i}" for i in range(20)])
    assert again.root_segments[0] != "segment03"


def test_mirror_by_names() -> None:
    positions = np.random.default_rng(0).normal(0, 500, (100, 6, 3))
    labels = ["R_ASIS", "L_ASIS", "SACRUM", "left_knee", "right_knee", "LHEEL"]
    assert discover(positions, labels).mirror == {
        "R_ASIS": "L_ASIS",
        "L_ASIS": "R_ASIS",
        "SACRUM": "SACRUM",
        "left_knee": "right_knee",
        "right_knee": "left_knee",
    }


def test_spread_against_a_naive_one() -> None:
    positions, _ = body(80, noise=3.0)
    positions[10:70, 3] = np.nan  # 20 frames left: too few
    positions[:40, 5] = np.nan
    spread = pair_distances(positions, MIN_COMMON)[1]
    for i, j in combinations(range(20), 2):
        distance = np.linalg.norm(positions[:, i] - positions[:, j], axis=1)
        distance = distance[~np.isnan(distance)]
        expected = distance.std() if len(distance) >= 25 else np.inf
        assert spread[i, j] == spread[j, i] == pytest.approx(expected)
    assert rigid_groups(np.zeros((0, 0))) == []


# --- describe --------------------------------------------------------------------------------


def test_describe_keeps_the_clips_own_labels() -> None:
    rng = np.random.default_rng(0)
    names = [label for label in load("baumann41").labels if label != "LFHD"]
    labels = tuple({"RBAC": "RBAK"}.get(label, label.lower()) for label in names)
    clip = Clip(rng.normal(0, 500, (60, 40, 3)), labels, 120.0)
    found = describe(clip)
    assert found.name == "baumann41"
    assert found.labels == labels
    assert found.segment["RBAK"] == "thorax"
    assert found.reliable["lkne"] and not found.reliable["lsho"]
    assert found.mirror["lkne"] == "rkne"
    assert "rfhd" not in found.mirror  # its contralateral marker is not in the clip
    assert found.root_segments[:3] == ("pelvis", "thorax", "head")


def test_describe_puts_unknown_markers_on_segments() -> None:
    positions, truth = body(120, noise=1.0)
    labels = tuple(f"M{i}" for i in range(20))
    known = MarkerSet(
        name="mine",
        labels=labels[:18],
        segment={label: f"s{truth[i]}" for i, label in enumerate(labels[:18])},
        reliable=dict.fromkeys(labels[:18], True),
        mirror={},
        root_segments=("s0", "s9"),
    )
    positions[:, 19] = np.nan
    found = describe(Clip(positions, labels, 100.0), known)
    assert found.segment["M18"] == "s4"
    assert found.segment["M19"] == "M19"  # never visible: on no segment
    assert not found.reliable["M18"]
    assert found.root_segments == ("s0",)


def test_describe_discovers_what_is_not_known() -> None:
    positions, _ = body(100)
    clip = Clip(positions, tuple(f"M{i}" for i in range(20)), 100.0)
    assert describe(clip) == discover(positions, clip.labels)


# --- real recordings -------------------------------------------------------------------------


def real(name: str) -> tuple[np.ndarray, list[str]]:
    ezc3d = pytest.importorskip("ezc3d")
    root = Path(os.environ.get("PRIORFILL_DATA", Path(__file__).parents[3] / "shared" / "data"))
    path = root / name
    if not path.exists():
        pytest.skip(f"{name} is not there")
    content = ezc3d.c3d(str(path))
    labels = [x.split(":")[-1] for x in content["parameters"]["POINT"]["LABELS"]["value"]]
    positions = content["data"]["points"][:3].transpose(2, 1, 0).copy()
    positions[(positions == 0).all(axis=2)] = np.nan
    keep = [i for i, label in enumerate(labels) if not label.startswith("*")]
    return positions[:, keep], [labels[i] for i in keep]


@pytest.mark.realdata
@pytest.mark.parametrize(
    ("name", "precision", "recall"),
    [  # seen: 0.94, 0.73; 0.81, 0.65; 0.63, 0.90
        ("hdm05/HDM_bd_05-01_01_120.c3d", 0.85, 0.65),
        ("cmu/135_02.c3d", 0.75, 0.6),
        ("cmu/01_01.c3d", 0.55, 0.8),
    ],
)
def test_discovery_agrees_with_known_segments(name: str, precision: float, recall: float) -> None:
    """Without labels, most segments found are those of the definition."""
    positions, labels = real(name)
    known = load("baumann41")
    keep = [i for i, label in enumerate(labels) if label in known.labels]
    labels = [labels[i] for i in keep]
    found = discover(positions[:, keep], [f"M{i}" for i in range(len(labels))])
    truth = [known.segment[label] for label in labels]
    got = pair_agreement(truth, [found.segment[f"M{i}"] for i in range(len(labels))])
    assert got[0] > precision
    assert got[1] > recall
    root = found.segments[found.root_segments[0]]
    assert {known.segment[labels[int(label[1:])]] for label in root} == {"pelvis"}


@pytest.mark.realdata
def test_treadmill_without_names() -> None:
    positions, labels = real("walkl/WalkL.c3d")
    assert recognise(labels) is None
    for cut in (positions, positions[1000:1050]):
        found = discover(cut, labels)
        assert sum(found.reliable.values()) >= 12
        root = found.segments[found.root_segments[0]]
        assert len(root) >= 3
        middle = positions[0, [labels.index(label) for label in root]].mean(axis=0)
        body_size = np.ptp(positions[0], axis=0).max()
        assert np.linalg.norm(middle - positions[0].mean(axis=0)) < 0.35 * body_size


@pytest.mark.parametrize("name", ["baumann41", "plug-in-gait", "gait59"])
def test_joints_of_both_sides_are_mirror_images(name: str) -> None:
    known = load(name)
    assert len(known.joints) == 12
    for joint, points in known.joints.items():
        other = (
            joint.replace("left", "right") if "left" in joint else joint.replace("right", "left")
        )
        assert known.joints[other] == tuple(
            tuple(known.mirror[marker] for marker in point) for point in points
        )


def test_joints_of_a_clip_have_its_labels() -> None:
    known = load("baumann41")
    labels = [label.lower() for label in known.labels if label != "LANK"]
    clip = Clip(np.zeros((3, len(labels), 3)), tuple(labels), 100.0)
    joints = describe(clip).joints
    assert joints["left_elbow"] == (("lsho",), ("lelb",), ("lwra", "lwrb"))
    assert "left_knee" not in joints  # its ankle is missing
    assert "right_knee" in joints


@pytest.mark.parametrize("error", [PermissionError(13, "Permission denied"), RuntimeError("none")])
def test_a_home_that_cannot_be_read(monkeypatch, error):
    def refuse(*_: object) -> Path:
        raise error

    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    monkeypatch.setattr("pathlib.Path.home", refuse)
    assert "plug-in-gait" in available()


def test_the_suffix_of_a_definition_in_upper_case(tmp_path: Path) -> None:
    path = tmp_path / "MINE.TOML"
    with pytest.raises(OptionError, match=r"MINE\.TOML: there is no such marker set"):
        load(path.name)
    path.write_text("a = 1", encoding="utf-8")
    with pytest.raises(MarkerSetError):
        load(str(path))
