"""A result in a line, and as a notebook shows it: what was done, and the worst gaps."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from priorfill.errors import escaped
from priorfill.report.result_summary import gap_cells, summary_text, worst_first
from priorfill.report.shown_text import MAX_LABEL, shown
from priorfill.runtime.markup import html_table

if TYPE_CHECKING:
    from priorfill.filling.provenance import Provenance
    from priorfill.filling.result import Result

__all__ = ["provenance_line", "result_html", "result_line"]


def result_line(result: Result) -> str:
    """Return a result in a line.

    Parameters
    ----------
    result : Result
        Of a fill.
    """
    bounds = [gap.error_bound_90_mm for gap in result.gaps]
    known = [bound for bound in bounds if math.isfinite(bound)]
    errors = f", 90 % bounds up to {max(known):.1f} mm" if known else ""
    name = shown(result.clip.name, MAX_LABEL)
    return escaped(f"<Result {name}: {summary_text(result)}{errors}>")


def result_html(result: Result) -> str:
    """Return a result as a notebook shows it.

    Parameters
    ----------
    result : Result
        Of a fill.
    """
    facts = [("done", summary_text(result)), *_facts(result.provenance)]
    facts += [("note", note) for note in result.notes]
    gaps = html_table(
        "Gaps, the worst first",
        ("marker", "frames", "s>", "filled>", "expected mean error mm>", "90 % bound mm>", "from"),
        [
            (*gap_cells(result.clip, gap), "; ".join(gap.sources))
            for gap in worst_first(result.gaps)
        ],
    )
    return html_table(f"Result {result.clip.name}", ("", ""), facts) + gaps


def provenance_line(provenance: Provenance) -> str:
    """Return a provenance in a line.

    Parameters
    ----------
    provenance : Provenance
        Of a result.
    """
    facts = "; ".join(f"{name} {value}" for name, value in _facts(provenance))
    names = ", ".join(shown(clip.name, MAX_LABEL) for clip in provenance.clips[:3])
    return escaped(f"<Provenance {names}: {provenance.method}; {facts}>")


def _facts(provenance: Provenance) -> list[tuple[str, str]]:
    """Return from what and with what a result was computed, as names and values."""
    facts = []
    database = provenance.database
    if database is not None:
        facts.append(("database", f"{database.path} ({database.clips} clips)"))
    if provenance.source_clips:
        facts.append(("clips learnt from", str(len(provenance.source_clips))))
    if provenance.same_subject:
        facts.append(("same subject", ", ".join(clip.name for clip in provenance.same_subject)))
    changed = {**provenance.options, **provenance.plausibility}
    if changed:
        facts.append(("options", ", ".join(f"{name}={value}" for name, value in changed.items())))
    versions = (f"{name} {version}" for name, version in provenance.versions.items() if version)
    facts.append(("versions", ", ".join(versions)))
    return facts
