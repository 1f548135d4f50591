"""Tables as HTML, for notebooks: text only, whatever files contain."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from priorfill.errors import escaped

__all__ = ["MAX_CELL", "MAX_ROWS", "html_table"]

MAX_ROWS = 12
"""Rows of a table; a notebook's cell should not fill the screen."""

MAX_CELL = 80
"""Characters of a cell."""


def html_table(
    caption: str, names: Sequence[str], rows: Sequence[Sequence[str]], *, most: int = MAX_ROWS
) -> str:
    """Return a table.

    Parameters
    ----------
    caption : str
        Above it.
    names : sequence of str
        Of the columns; one that ends with ``>`` is aligned to the right. No line where all are
        empty.
    rows : sequence of sequence of str
        The cells, as many as names.
    most : int
        Number of rows; a line states how many are left out.

    Returns
    -------
    str
        HTML without style sheets or scripts; empty without rows.

    Examples
    --------
    >>> html_table("Gaps", ("marker", "frames>"), [("<b>", "3")]).splitlines()[2]
    '<tr><td style="text-align:left">&lt;b&gt;</td><td style="text-align:right">3</td></tr>'
    """
    if not rows:
        return ""
    sides = ["right" if name.endswith(">") else "left" for name in names]
    lines = [f"<table><caption>{_text(caption)}</caption>"]
    if any(names):
        lines[0] += _row("th", [name.removesuffix(">") for name in names], sides)
    lines.append("<tbody>")
    lines += [_row("td", row, sides) for row in rows[:most]]
    if len(rows) > most:
        lines.append(f'<tr><td colspan="{len(names)}">... and {len(rows) - most} more</td></tr>')
    return "\n".join([*lines, "</tbody></table>"])


def _row(tag: str, cells: Sequence[str], sides: Sequence[str]) -> str:
    inner = "".join(
        f'<{tag} style="text-align:{side}">{_text(cell)}</{tag}>'
        for cell, side in zip(cells, sides, strict=True)
    )
    return f"<tr>{inner}</tr>"


def _text(text: str) -> str:
    """Return a text that is no markup, in one line and not too long."""
    safe = escaped(text[: 2 * MAX_CELL])
    return escape(safe if len(safe) <= MAX_CELL else f"{safe[: MAX_CELL - 1]}\u2026")
