"""Motion-capture text files as exported by several programs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

LABELS = ("LTOE", "RTOE", "LKNE", "RKNE", "C7", "LFHD")


def standing(frames: int = 12, up: int = 2) -> np.ndarray:
    """Six markers of a swaying body, upright along an axis [shape=(frames, 6, 3), mm]."""
    t = np.arange(frames)[:, None]
    heights = np.array([30.0, 31.0, 480.0, 485.0, 1450.0, 1700.0])
    sides = np.array([-100.0, 100.0, -110.0, 110.0, 5.0, -70.0])
    places = np.stack(
        [
            sides + heights / 40 * np.sin(0.2 * t + 0.3),
            heights / 50 * np.cos(0.17 * t) + 20 + 0 * sides,
            heights + 2 * np.sin(0.1 * t),
        ],
        axis=2,
    )
    return np.roll(places, up - 2, axis=2)


def number(value: float, decimals: int, missing: str) -> str:
    return missing if np.isnan(value) else f"{value:.{decimals}f}"


def trc(
    positions: np.ndarray,
    labels: Sequence[str] = LABELS,
    *,
    rate: float = 100.0,
    unit: str = "mm",
    first: int = 1,
    decimals: int = 5,
    missing: str = "",
    newline: str = "\r\n",
    blank_line: bool = True,
    trailing_tab: bool = False,
    header: bool = True,
) -> bytes:
    """A TRC file of OpenSim or Cortex; positions in the file's unit."""
    frames, count = positions.shape[:2]
    lines = [
        "PathFileType\t4\t(X/Y/Z)\tC:\\data\\walk.trc\t",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate:.2f}\t{rate:.2f}\t{frames}\t{count}\t{unit}\t{rate:.2f}\t{first}\t{frames}",
    ]
    if not header:
        lines = []
    lines += [
        "Frame#\tTime\t" + "".join(f"{label}\t\t\t" for label in labels),
        "\t\t" + "".join(f"X{k}\tY{k}\tZ{k}\t" for k in range(1, count + 1)),
    ]
    lines += [""] * blank_line
    for frame, row in enumerate(positions.reshape(frames, positions.shape[1] * 3)):
        cells = [str(first + frame), f"{frame / rate:.5f}"]
        cells += [number(value, decimals, missing) for value in row]
        lines.append("\t".join(cells) + "\t" * trailing_tab)
    return (newline.join(lines) + newline).encode()


def nexus(
    positions: np.ndarray,
    labels: Sequence[str] = LABELS,
    *,
    rate: int = 100,
    subject: str = "Ann",
    first: int = 1,
    decimals: int = 4,
    delimiter: str = ",",
    before: str = "",
    after: str = "",
    comma: bool = False,
) -> bytes:
    """An ASCII export of trajectories by Nexus 2."""
    frames, count = positions.shape[:2]
    lines = [
        "Trajectories",
        str(rate),
        ",," + ",".join(f"{subject}:{label},," for label in labels),
        "Frame,Sub Frame" + ",X,Y,Z" * count,
        "," + ",mm" * (3 * count),
    ]
    for frame, row in enumerate(positions.reshape(frames, positions.shape[1] * 3)):
        cells = [str(first + frame), "0", *(number(value, decimals, "") for value in row)]
        lines.append(",".join(cells))
    text = "".join(f"{line}\n" for line in lines).replace(",", delimiter)
    if comma:
        text = text.replace(".", ",")
    return (before + text + after).encode("utf-8")


def qualisys(
    positions: np.ndarray,
    labels: Sequence[str] = LABELS,
    *,
    rate: str = "100",
    first: int = 1,
    decimals: int = 3,
    missing: str = "0.000",
    numbers: bool = True,
    titles: bool = True,
    trailing_tab: bool = False,
    types: Sequence[str] | None = None,
) -> bytes:
    """A TSV export of 3D data by Qualisys Track Manager."""
    frames, count = positions.shape[:2]
    lines = [
        f"NO_OF_FRAMES\t{frames}",
        "NO_OF_CAMERAS\t8",
        f"NO_OF_MARKERS\t{count}",
        f"FREQUENCY\t{rate}",
        "NO_OF_ANALOG\t0",
        "ANALOG_FREQUENCY\t0",
        "DESCRIPTION\t--",
        "TIME_STAMP\t2022-06-03, 10:47:36.627\t94247.45402301",
        "DATA_INCLUDED\t3D",
        "EVENT\tstart\t3\t0.02000",
        "\t".join(["MARKER_NAMES", *labels]),
        "\t".join(["TRAJECTORY_TYPES", *(types or ["Measured"] * count)]),
    ]
    if titles:
        names = ["Frame", "Time"] if numbers else []
        lines.append("\t".join(names + [f"{label} {a}" for label in labels for a in "XYZ"]))
    for frame, row in enumerate(positions.reshape(frames, positions.shape[1] * 3)):
        cells = [str(first + frame), f"{frame / 100:.5f}"] if numbers else []
        cells += [number(value, decimals, missing) for value in row]
        lines.append("\t".join(cells) + "\t" * trailing_tab)
    return "".join(f"{line}\r\n" for line in lines).encode()


def motive(
    positions: np.ndarray,
    labels: Sequence[str] = LABELS,
    *,
    rate: float = 120.0,
    unit: str = "Meters",
    kind: str = "Marker",
    first: int = 0,
    decimals: int = 6,
    timecode: bool = False,
    body: bool = True,
    extra_solved: bool = False,
) -> bytes:
    """A CSV export of a take by Motive 2 or 3, with a rigid body before the markers."""
    frames = len(positions)
    columns: list[tuple[str, str, str, str, str]] = []  # type, name, ID, measure, axis
    if body:
        columns += [("Rigid Body", "Head", '"77C3"', "Rotation", axis) for axis in "XYZW"]
        columns += [("Rigid Body", "Head", '"77C3"', "Position", axis) for axis in "XYZ"]
        columns += [("Rigid Body", "Head", '"77C3"', "Mean Marker Error", "")]
    if extra_solved:
        columns += [("Rigid Body Marker", "Head:M1", '"A1"', "Position", axis) for axis in "XYZ"]
        columns += [("Rigid Body Marker", "Head:M1", '"A1"', "Marker Quality", "")]
    before = len(columns)
    columns += [
        (kind, f"Ann:{label}", f'"{label}"', "Position", a) for label in labels for a in "XYZ"
    ]
    lead = ["", "Type", ""] if timecode else ["", "Type"]
    rows = [[*lead, *(column[0] for column in columns)]]
    for place, title in ((1, "Name"), (2, "ID")):
        rows.append(["", title, *lead[2:], *(column[place] for column in columns)])
    rows.append(["", "", *lead[2:], *(column[3] for column in columns)])
    clock = ["TimeCode"] if timecode else []
    rows.append(["Frame", "Time (Seconds)", *clock, *(column[4] for column in columns)])
    for frame, row in enumerate(positions.reshape(frames, positions.shape[1] * 3)):
        cells = [str(first + frame), f"{frame / rate:.6f}", *["15:26:46:12.02"] * timecode]
        cells += [f"{0.1 * k:.6f}" for k in range(before)]
        rows.append(cells + [number(value, decimals, "") for value in row])
    facts = (
        f"Format Version,1.23,Take Name,walk,Take Notes,,Capture Frame Rate,{rate:.6f},"
        f"Export Frame Rate,{rate:.6f},Capture Start Time,2023-06-02 12.09.45.344 PM,"
        f"Capture Start Frame,0,Total Frames in Take,{frames},Total Exported Frames,{frames},"
        f"Rotation Type,Quaternion,Length Units,{unit},Coordinate Space,Global"
    )
    return ("\r\n".join([facts, "", *(",".join(row) for row in rows)]) + "\r\n").encode()
