"""Tables for notebooks."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Mapping, Sequence
from typing import Any


def number(value: object) -> str:
    """A value as a short text: four digits of a number, nothing for a missing one."""
    if value is None or value != value:  # NaN
        return ""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def table(head: Sequence[str], rows: Iterable[Sequence[object]], caption: str = "") -> str:
    """A table with escaped cells: numbers to the right, words to the left under their heads."""
    rows = list(rows)

    def cell(kind: str, value: object, words: bool) -> str:
        side = "left" if words else "right"
        return f'<{kind} style="text-align: {side}">{html.escape(number(value))}</{kind}>'

    words = [all(isinstance(row[column], str) or row[column] is None for row in rows) for column in range(len(head))]
    names = "".join(cell("th", *pair) for pair in zip(head, words, strict=True))
    body = "".join(f"<tr>{''.join(cell('td', *pair) for pair in zip(row, words, strict=True))}</tr>" for row in rows)
    said = f"<caption>{html.escape(caption)}</caption>" if caption else ""
    return f"<table>{said}<thead><tr>{names}</tr></thead><tbody>{body}</tbody></table>"


def aligned(rows: Iterable[Sequence[object]]) -> str:
    """The same for a terminal: columns by width, without a head."""
    texts = [[number(cell) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*texts, strict=True)]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in texts
    )


def picture(svg: str, words: str) -> str:
    """An SVG document as an image: its style sheet would reach the whole page of a notebook otherwise."""
    data = base64.b64encode(svg.encode()).decode()
    return (
        f'<img alt="{html.escape(words)}" style="max-width: 100%; background: white" '
        f'src="data:image/svg+xml;base64,{data}">'
    )


_STATUS = {
    "patient": "patient",
    "step": "step",
    "state": "state",
    "step1_cost": "cost of step 1",
    "step2_cost": "cost of step 2",
    "note": "note",
}


def status_table(status: Mapping[str, Any]) -> str:
    """The table of a run's status, a row for each patient."""
    counts = ", ".join(f"{n} {state}" for state, n in status["counts"].items() if n)
    rows = [[patient.get(key) for key in _STATUS] for patient in status["patients"]]
    return table(list(_STATUS.values()), rows, f"{status['cohort']}: {counts}")
