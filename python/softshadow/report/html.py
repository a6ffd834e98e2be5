"""Pieces of a page: tables that sort, figures as data, lists; everything escaped."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from html import escape
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

__all__ = ["definitions", "figure", "image", "page", "table"]

_ALL_DIGITS = 10**8
"""Whole numbers below it are written with all their digits."""

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
    drawn: Figure, caption: str, kind: Literal["svg", "png", "png8"] = "svg", dpi: float = 110
) -> str:
    """Return a matplotlib figure as an image in the page itself.

    Parameters
    ----------
    drawn : matplotlib.figure.Figure
    caption : str
        Plain text, also for those who hear the page.
    kind : {"svg", "png", "png8"}
        Lines are sharp at any size as SVG; pictures are smaller as PNG, and smallest with a palette
        of 256 colours.
    dpi : float
        Pixels an inch, of PNG.
    """
    import matplotlib

    from softshadow.figure import with_palette

    buffer = BytesIO()
    # Text stays text; names in the file are the same in every run, and there is no date.
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "softshadow"}):
        metadata = {"Date": None} if kind == "svg" else {}
        drawn.savefig(buffer, format=kind.rstrip("8"), dpi=dpi, metadata=metadata)
    data = with_palette(buffer.getvalue()) if kind == "png8" else buffer.getvalue()
    mime = "image/svg+xml" if kind == "svg" else "image/png"
    tag = image(data, caption, mime)
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
        f'<th scope="col"{"" if number else " class=text"}>'
        f'<button type="button">{escape(_heading(c))}</button></th>'
        for c, number in zip([*mark, *columns], [*(False for _ in mark), *kinds], strict=True)
    )
    lines = []
    for i, values in enumerate(rows.itertuples(index=False, name=None)):
        on = marked is not None and bool(marked[i])
        cells = [f'<td class="text">{"●" if on else ""}</td>' for _ in mark]
        for column, value, number in zip(columns, values, kinds, strict=True):
            cells.append(_cell(column, value, number))
        lines.append(f"<tr{' class=front' if on else ''}>{''.join(cells)}</tr>")
    attribute = f' id="{escape(name)}"' if name else ""
    body = "\n".join(lines)
    return (
        f"{_FILTER if len(lines) >= _FILTERED else ''}"
        f'<div class="scroll"><table{attribute}><thead><tr>{heads}</tr></thead>\n'
        f"<tbody>\n{body}\n</tbody></table></div>\n"
    )


def definitions(facts: Mapping[str, str]) -> str:
    """Return facts with their names before them."""
    rows = "".join(f"<dt>{escape(k)}</dt><dd>{escape(v)}</dd>\n" for k, v in facts.items())
    return f"<dl>\n{rows}</dl>\n"


_FILTERED = 40
"""Rows from which on a table has a field that filters it."""

_FILTER = (
    '<p><label>Rows with all of these words: <input type="search" class="filter" '
    'placeholder="bunny medium"></label> <span class="soft"></span></p>\n'
)


def _heading(column: str) -> str:
    if column == "bytes":
        return "MB"
    return column.replace("_seconds", " s").replace("_", " ")


def _cell(column: str, value: Any, number: bool) -> str:
    text = "" if _missing(value) else str(value)
    if not number:
        return f'<td class="text{" long" if len(text) > 40 else ""}">{escape(text)}</td>'
    if not text:
        return "<td></td>"
    shown = value / 1e6 if column == "bytes" else value
    whole = float(shown).is_integer() and abs(shown) < _ALL_DIGITS
    return f"<td>{int(shown) if whole else f'{float(shown):.4g}'}</td>"


def _is_number(column: pd.Series[Any]) -> bool:
    return column.dtype.kind in "iuf"


def _missing(value: Any) -> bool:
    return value is None or (isinstance(value, float) and math.isnan(value)) or str(value) == "<NA>"


def _asset(name: str) -> str:
    return (_HERE / name).read_text(encoding="utf-8")
