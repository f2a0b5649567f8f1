"""Text of summaries, as the program writes it."""

from __future__ import annotations

import html
import math
from typing import List, Sequence, Tuple

Rows = Sequence[Tuple[str, str]]


def significant(value: object, digits: int = 3) -> str:
    """A number with so many digits, without trailing zeros."""
    if value is None:
        return "none"
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return str(value)
    if isinstance(value, int):
        return str(value)
    if not math.isfinite(value):
        return str(value)
    return f"{value:.{digits}g}"


def percent(share: float) -> str:
    """A share as a percentage."""
    return f"{significant(100.0 * share, 3)} %"


def two_columns(rows: Rows) -> str:
    """Names and values, the values aligned."""
    width = max((len(name) for name, _ in rows), default=0)
    return "\n".join(f"{name:<{width}}  {value}".rstrip() for name, value in rows)


def table(title: str, rows: Rows) -> str:
    """The same for notebooks."""
    lines: List[str] = [f"<table><caption>{html.escape(title)}</caption>"]
    for name, value in rows:
        lines.append(f'<tr><th style="text-align:left">{html.escape(name)}</th>')
        lines.append(f'<td style="text-align:left">{html.escape(value)}</td></tr>')
    return "".join(lines) + "</table>"
