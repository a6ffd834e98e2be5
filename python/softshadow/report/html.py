"""Pieces of a page: tables that sort, figures as data, lists; everything escaped."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from html import escape
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

__all__ = ["definitions", "figure", "image", "page", "table"]

_HERE = Path(__file__).parent

_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
"""The browser itself refuses to load anything from anywhere."""


def page(title: str, summary: str, sections: Mapping[str, str]) -> str:
    """Return a whole page.

    Parameters
    ----------
    title, summary : str
        Plain text.
    sections : mapping of str to str
        HTML by heading; those without any are left out.
    """
    kept = {heading: body for heading, body in sections.items() if body}
    links = "".join(f'<a href="#s{i}">{escape(h)}</a>' for i, h in enumerate(kept))
    bodies = "\n".join(
        f'<section id="s{i}"><h2>{escape(h)}</h2>\n{body}</section>'
        for i, (h, body) in enumerate(kept.items())
    )
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{_POLICY}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(title)}</title>
<link rel="icon" href="data:,">
<style>
{_asset("page.css")}</style>
</head>
<body>
<h1>{escape(title)}</h1>
<p class="soft">{escape(summary)}</p>
<nav>{links}</nav>
{bodies}
<script>
{_asset("sort.js")}</script>
</body>
</html>
"""


def figure(
    drawn: Figure, caption: str, kind: Literal["svg", "png"] = "svg", dpi: float = 110
) -> str:
    """Return a matplotlib figure as an image in the page itself.

    Parameters
    ----------
    drawn : matplotlib.figure.Figure
    caption : str
        Plain text, also for those who hear the page.
    kind : {"svg", "png"}
        Lines are sharp at any size as SVG; pictures are smaller as PNG.
    dpi : float
        Pixels an inch, of PNG.
    """
    import matplotlib

    buffer = BytesIO()
    # Text stays text; names in the file are the same in every run, and there is no date.
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "softshadow"}):
        metadata = {"Date": None} if kind == "svg" else {}
        drawn.savefig(buffer, format=kind, dpi=dpi, metadata=metadata)
    mime = "image/svg+xml" if kind == "svg" else "image/png"
    tag = image(buffer.getvalue(), caption, mime)
    return f"<figure>{tag}<figcaption>{escape(caption)}</figcaption></figure>\n"


def image(data: bytes, text: str, mime: str = "image/png") -> str:
    """Return an image that is in the page itself.

    Parameters
    ----------
    data : bytes
        Of the file.
    text : str
        What it shows, for those who do not see it.
    mime : str
        The file's type.
    """
    encoded = base64.b64encode(data).decode("ascii")
    return f'<img alt="{escape(text)}" src="data:{mime};base64,{encoded}">'


def table(rows: pd.DataFrame, marked: Sequence[bool] | None = None, name: str = "") -> str:
    """Return a table whose columns sort when their headings are pressed.

    Parameters
    ----------
    rows : pandas.DataFrame
    marked : sequence of bool, optional
        Which rows to mark; they get a column "front", too, that sorts.
    name : str
        Its id in the page.
    """
    columns = [str(c) for c in rows.columns]
    kinds = [_is_number(rows.iloc[:, i]) for i in range(len(columns))]
    mark = ["front"] if marked is not None else []
    heads = "".join(
        f'<th scope="col"{" class=number" if number else ""}>'
        f'<button type="button">{escape(_heading(c))}</button></th>'
        for c, number in zip([*mark, *columns], [*(False for _ in mark), *kinds], strict=True)
    )
    lines = []
    for i, values in enumerate(rows.itertuples(index=False, name=None)):
        on = marked is not None and bool(marked[i])
        cells = [f'<td data-value="{int(not on)}">{"●" if on else ""}</td>' for _ in mark]
        for column, value, number in zip(columns, values, kinds, strict=True):
            cells.append(_cell(column, value, number))
        lines.append(f"<tr{' class=front' if on else ''}>{''.join(cells)}</tr>")
    attribute = f' id="{escape(name)}"' if name else ""
    body = "\n".join(lines)
    return (
        f'<div class="scroll"><table{attribute}><thead><tr>{heads}</tr></thead>\n'
        f"<tbody>\n{body}\n</tbody></table></div>\n"
    )


def definitions(facts: Mapping[str, str]) -> str:
    """Return facts with their names before them."""
    rows = "".join(f"<dt>{escape(k)}</dt><dd>{escape(v)}</dd>\n" for k, v in facts.items())
    return f"<dl>\n{rows}</dl>\n"


def _heading(column: str) -> str:
    if column == "bytes":
        return "MB"
    return column.replace("_seconds", " s").replace("_", " ")


def _cell(column: str, value: Any, number: bool) -> str:
    if not number:
        text = "" if _missing(value) else str(value)
        return f"<td{' class=text' if len(text) > 40 else ''}>{escape(text)}</td>"
    if _missing(value):
        return '<td class="number" data-value="nan"></td>'
    shown = value / 1e6 if column == "bytes" else value
    whole = isinstance(shown, (int, np.integer)) and not isinstance(shown, bool)
    text = str(shown) if whole else f"{float(shown):.3g}"
    return f'<td class="number" data-value="{float(value)!r}">{text}</td>'


def _is_number(column: pd.Series[Any]) -> bool:
    return column.dtype.kind in "iuf"


def _missing(value: Any) -> bool:
    return value is None or (isinstance(value, float) and math.isnan(value)) or str(value) == "<NA>"


def _asset(name: str) -> str:
    return (_HERE / name).read_text(encoding="utf-8")
