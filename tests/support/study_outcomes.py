"""Outcomes of jobs, without fills."""

from __future__ import annotations

from typing import Any

from priorfill.study.job import JobOutcome, Status

__all__ = ["FRAMES", "failure", "gap", "outcome"]

FRAMES = 1000
"""Frames of a trial."""

MARKERS = 40
"""Markers of a trial."""

RATE = 100.0
"""Hz"""


def gap(
    marker: str,
    seconds: float,
    error: float | None = 2.0,
    *,
    left: int = 0,
    requested: bool = True,
    reason: str = "nothing alike",
) -> dict[str, Any]:
    """Return a gap as in the facts of a fill; its last frames, as many as `left`, stay missing."""
    frames = round(seconds * RATE)
    last = 100 + frames
    span = {"first_frame": last - left + 1, "last_frame": last, "reason": reason}
    return {
        "marker": marker,
        "subject": "Anna",
        "first_frame": 101,
        "last_frame": last,
        "frames": frames,
        "seconds": seconds,
        "filled": frames - left,
        "expected_mean_error_mm": error,
        "error_bound_90_mm": None if error is None else 2 * error,
        "unfilled": [span | {"requested": requested}] if left else [],
    }


def outcome(name: str, *gaps: dict[str, Any], **more: Any) -> JobOutcome:
    """Return the outcome of a job whose trial has some gaps."""
    left = any(span["requested"] for one in gaps for span in one["unfilled"])
    status: Status = "no gaps" if not gaps else "incomplete" if left else "filled"
    facts = {
        "frames": FRAMES,
        "samples": FRAMES * MARKERS,
        "rate": RATE,
        "method": "gpr",
        "subjects": [{"subject": "Anna"}],
        "gaps": list(gaps),
    } | more.pop("facts", {})
    given = {"status": status, "facts": facts, "report": f"/study/out/{name}.html", "seconds": 2.0}
    return JobOutcome(name, f"/study/in/{name}", f"/study/out/{name}", **given | more)


def failure(name: str, reason: str, **more: Any) -> JobOutcome:
    """Return the outcome of a job that failed."""
    return JobOutcome(
        name, f"/study/in/{name}", f"/study/out/{name}", "failed", reason=reason, **more
    )
