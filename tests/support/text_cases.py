"""Text files of several programs with gaps, one for each dialect."""

from __future__ import annotations

import numpy as np
import text_files as files

GAP = (slice(4, 7), 2)


def with_gap(up: int = 2, frames: int = 12) -> np.ndarray:
    positions = files.standing(frames, up)
    positions[GAP] = np.nan
    positions[-1, 5] = np.nan
    return positions


# writer, suffix, up axis of the positions, file units per mm, options
CASES = {
    "trc": (files.trc, ".trc", 1, 1.0, {}),
    "trc, m": (files.trc, ".trc", 1, 0.001, {"unit": "m", "decimals": 7}),
    "trc, NaN, no blank line, LF": (
        files.trc, ".trc", 2, 1.0, {"missing": "NaN", "blank_line": False, "newline": "\n"},
    ),
    "trc, zeros as Cortex": (
        files.trc, ".trc", 2, 1.0, {"missing": "0.00000", "trailing_tab": True, "first": 31},
    ),
    "trc, CR": (files.trc, ".trc", 1, 1.0, {"newline": "\r"}),
    "trc, no header": (files.trc, ".trc", 1, 1.0, {"header": False}),
    "nexus": (files.nexus, ".csv", 2, 1.0, {"first": 101}),
    "nexus, tabs": (files.nexus, ".txt", 2, 1.0, {"delimiter": "\t"}),
    "nexus, comma": (files.nexus, ".csv", 2, 1.0, {"delimiter": ";", "comma": True}),
    "nexus, sections": (
        files.nexus, ".csv", 2, 1.0,
        {
            "before": "Devices\n1000\n,,Force\nFrame,Sub Frame,Fx\n,,N\n1,0,3.25\n\n",
            "after": "\nModel Outputs\n100\n,,Ann:LHip\nFrame,Sub Frame,X,Y,Z\n,,mm\n1,0,,,\n",
        },
    ),
    "qualisys": (files.qualisys, ".tsv", 2, 1.0, {}),
    "qualisys, null": (files.qualisys, ".tsv", 2, 1.0, {"missing": "null", "titles": False}),
    "qualisys, blank, no numbers": (
        files.qualisys, ".tsv", 2, 1.0,
        {"missing": "", "titles": False, "numbers": False, "trailing_tab": True},
    ),
    "motive": (files.motive, ".csv", 1, 0.001, {}),
    "motive, mm, time code": (
        files.motive, ".csv", 1, 1.0, {"unit": "Millimeters", "timecode": True, "first": 7},
    ),
    "motive, rigid body markers": (files.motive, ".csv", 1, 0.001, {"kind": "Rigid Body Marker"}),
}  # fmt: skip
