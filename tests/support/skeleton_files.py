"""Small ASF, AMC and BVH files of a complete body, as text."""

from __future__ import annotations

import math

LIMBS = {
    # bone: parent, vector from start to end (cm), degrees of freedom
    "lowerback": ("root", (0.0, 25.0, 0.0), "rx ry rz"),
    "thorax": ("lowerback", (0.0, 25.0, 0.0), "rx ry rz"),
    "head": ("thorax", (0.0, 20.0, 0.0), "rx ry rz"),
    "lhipjoint": ("root", (10.0, -8.0, 0.0), ""),
    "lfemur": ("lhipjoint", (0.0, -42.0, 0.0), "rx ry rz"),
    "ltibia": ("lfemur", (0.0, -41.0, 0.0), "rx"),
    "lfoot": ("ltibia", (0.0, -6.0, 14.0), "rx rz"),
    "lclavicle": ("thorax", (19.0, 1.0, 0.0), "ry rz"),
    "lhumerus": ("lclavicle", (28.0, 0.0, 0.0), "rx ry rz"),
    "lradius": ("lhumerus", (17.0, 0.0, 0.0), "rx"),
    "lwrist": ("lradius", (9.0, 0.0, 0.0), "ry"),
    "lhand": ("lwrist", (7.0, 0.0, 0.0), "rx rz"),
}
AXES = {"lhumerus": (180.0, -30.0, -90.0), "lradius": (180.0, -30.0, -90.0), "lfemur": (0, 0, 20.0)}


def bones() -> dict[str, tuple[str, tuple[float, float, float], str]]:
    """The bones of both sides, parents before their children."""
    found = {}
    for name, (parent, end, dof) in LIMBS.items():
        found[name] = (parent, end, dof)
        if name[0] == "l" and name != "lowerback":
            above = "r" + parent[1:] if parent in LIMBS and parent != "thorax" else parent
            found["r" + name[1:]] = (above, (-end[0], *end[1:]), dof)
    return found


def axis(name: str) -> tuple[float, float, float]:
    """The axis of a bone."""
    x, y, z = AXES.get("l" + name[1:], (0.0, 0.0, 0.0))
    return (x, -y, -z) if name[0] == "r" else (x, y, z)


def asf() -> str:
    """An ASF file with lengths in cm, that is with a unit of 2.54."""
    lines = [":version 1.10", ":name test", ":units", "  length 2.54", "  angle deg", ":root"]
    lines += ["  order TX TY TZ RX RY RZ", "  axis XYZ", "  position 0 0 0"]
    lines += ["  orientation 0 0 0", ":bonedata"]
    for number, (name, (_, end, dof)) in enumerate(bones().items(), start=1):
        length = math.dist(end, (0, 0, 0))
        lines += ["  begin", f"    id {number}", f"    name {name}"]
        lines += ["    direction " + " ".join(repr(v / length) for v in end)]
        lines += [f"    length {length!r}", "    axis {} {} {} XYZ".format(*axis(name))]
        lines += [f"    dof {dof}"] if dof else []
        lines += ["  end"]
    lines += [":hierarchy", "  begin"]
    for parent in ("root", *bones()):
        below = [name for name, bone in bones().items() if bone[0] == parent]
        lines += [f"    {parent} {' '.join(below)}"] if below else []
    return "\n".join([*lines, "  end", ""])


def angle(bone: str, channel: int, frame: int) -> float:
    """An angle (deg) that differs for every bone, channel and frame."""
    return 20.0 * math.sin(0.05 * frame + sum(map(ord, bone)) + 2.0 * channel)


def amc(frames: int) -> str:
    """An AMC file for the skeleton of the ASF file."""
    lines = ["# test", ":FULLY-SPECIFIED", ":DEGREES"]
    for frame in range(frames):
        lines += [str(frame + 1), f"root {0.5 * frame} 90 0 " + _angles("root", 3, frame)]
        for name, (_, _, dof) in bones().items():
            if dof:
                lines += [f"{name} {_angles(name, len(dof.split()), frame)}"]
    return "\n".join([*lines, ""])


def _angles(bone: str, count: int, frame: int) -> str:
    return " ".join(repr(angle(bone, channel, frame)) for channel in range(count))


DAZ = {
    "root": "hip", "thorax": "chest", "head": "head", "lowerback": "abdomen",
    "hipjoint": "Buttock", "femur": "Thigh", "tibia": "Shin", "foot": "Foot",
    "clavicle": "Collar", "humerus": "Shldr", "radius": "ForeArm", "wrist": "Twist", "hand": "Hand",
}  # fmt: skip


def bvh(frames: int, still: bool = False) -> str:
    """A BVH file of a similar body (cm)."""
    every = bones()
    order: list[str] = []

    def joint(name: str, offset: tuple[float, ...]) -> list[str]:
        order.append(name)
        known = DAZ.get(name) or name[0] + DAZ[name[1:]]
        lines = [f"{'ROOT' if name == 'root' else 'JOINT'} {known}", "{"]
        lines += ["OFFSET {} {} {}".format(*offset)]
        places = "Xposition Yposition Zposition " if name == "root" else ""
        lines += [f"CHANNELS {6 if places else 3} {places}Zrotation Xrotation Yrotation"]
        below = [child for child, bone in every.items() if bone[0] == name]
        end = every[name][1] if name != "root" else (0.0, 0.0, 0.0)
        for child in below:
            lines += joint(child, end)
        if not below:
            lines += ["End Site", "{", "OFFSET {} {} {}".format(*end), "}"]
        return [*lines, "}"]

    lines = ["HIERARCHY", *joint("root", (0, 0, 0)), "MOTION", f"Frames: {frames}"]
    lines += ["Frame Time: 0.00833333"]
    for frame in range(frames):
        words = [f"{0.5 * frame} 90 0"]
        words += ["0 0 0" if still else _angles(name, 3, frame) for name in order]
        lines += [" ".join(words)]
    return "\n".join([*lines, ""])
