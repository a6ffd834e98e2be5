"""How scenes, images and comparisons show themselves in notebooks.

Tables need nothing but the package's own dependencies. Pictures need the extra ``plot``; without it
they are left out, so that showing a thing never fails.
"""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, cast

import numpy as np

from softshadow import comparing, framing, fronts
from softshadow.compare import Comparison
from softshadow.entries import Curves, Mesh, Spheres, bounds_of
from softshadow.render import Image, render
from softshadow.report import html
from softshadow.scene import Scene, scene_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from softshadow.figure import OwnFigure

__all__ = ["comparison_html", "image_png", "scene_html"]

MOST_TRIANGLES = 100_000
"""Of a scene that gets a picture: copying and rendering so many takes a quarter of a second."""

MOST_ENTRIES = 50
"""Rows of a scene's table."""

MOST_LIGHTS = 4
"""Lights of an image that get a picture of their own."""

MOST_IMAGES = 4
"""Of a comparison's strip, beside the reference: more take seconds; `softshadow.plot.strip` draws
all."""

_SIZE = (240, 180)
"""Of a scene's picture, pixels."""


def scene_html(scene: Scene) -> str:
    """Return a scene's entries as a table, and a picture of it if it is small.

    Parameters
    ----------
    scene : Scene
        Up to 100,000 triangles are rendered with hard shadows, from a copy, so that nothing is
        built in the scene itself; view and light are those of `softshadow.framing`, for all that is
        not flat. What cannot be rendered has no picture.
    """
    heads = ("name", "kind", "triangles", "bounds", "albedo", "opacity", "casts", "receives")
    rows = [_row(entry) for entry in scene.entries[:MOST_ENTRIES]]
    lines = ["".join(f"<td>{escape(cell)}</td>" for cell in row) for row in rows]
    body = "".join(f"<tr>{line}</tr>" for line in lines)
    titles = "".join(f"<th>{h}</th>" for h in heads)
    more = len(scene.entries) - len(rows)
    note = f"<p>and {more} more</p>" if more > 0 else ""
    table = f"<table><thead><tr>{titles}</tr></thead><tbody>{body}</tbody></table>"
    return f"<p>{escape(_summary(scene))}</p>{table}{note}{_picture(scene)}"


def image_png(image: Image) -> bytes | None:
    """Return an image's visibility as a PNG; of several lights their mean, then one after another.

    Parameters
    ----------
    image : Image

    Returns
    -------
    bytes or None
        None without the extra ``plot``.
    """
    try:
        from softshadow import plot

        if image.visibility.ndim == 2:
            return _png(plot.show(image))
        lights = image.visibility[:MOST_LIGHTS]
        panels = {f"light {i}": visibility for i, visibility in enumerate(lights)}
        return _png(plot.strip({"mean": image, **panels}))
    except ModuleNotFoundError:
        return None


def comparison_html(result: Comparison) -> str:
    """Return a comparison's table, the front marked, and a strip of pictures with their errors.

    Parameters
    ----------
    result : Comparison
        The strip has up to four methods of the front, or the first ones where there is no front.
    """
    table = comparing.shown(result).to_html(index=False, border=0)
    notes = "<br>".join(map(escape, comparing.notes(result)))
    try:
        from softshadow import plot

        images = {"reference": result.reference, **_of_the_front(result)}
        strip = html.image(_png(plot.strip(images)), "visibilities and their signed errors")
    except ModuleNotFoundError:
        strip = ""
    return f"{table}<p>{notes}</p>{strip}"


def _of_the_front(result: Comparison) -> dict[str, Image]:
    on = fronts.front(result.table)
    best = [label for label, star in zip(result.images, on, strict=True) if star]
    return {label: result.images[label] for label in (best or list(result.images))[:MOST_IMAGES]}


def _summary(scene: Scene) -> str:
    entries = len(scene.entries)
    return (
        f"Scene: {entries} entr{'y' if entries == 1 else 'ies'}, {scene.triangle_count} triangles"
    )


def _row(entry: Mesh | Spheres) -> list[str]:
    low, high = bounds_of(entry)
    if isinstance(entry, Spheres):
        kind, triangles = f"{len(entry.radii)} spheres", ""
    else:
        kind = f"{len(entry.offsets) - 1} curves" if isinstance(entry, Curves) else "mesh"
        triangles = str(len(entry.faces))
    return [
        entry.name,
        kind,
        triangles,
        f"{_triple(low)} to {_triple(high)}",
        _triple(entry.albedo),
        f"{entry.opacity:g}",
        "yes" if entry.casts else "no",
        "yes" if entry.receives else "no",
    ]


def _triple(
    values: tuple[float, float, float] | np.ndarray[tuple[int], np.dtype[np.float64]],
) -> str:
    return f"({', '.join(f'{value:.4g}' for value in values)})"


def _picture(scene: Scene) -> str:
    if not scene.entries or scene.triangle_count > MOST_TRIANGLES:
        return ""
    solid = tuple(e for e in scene.entries if np.ptp(bounds_of(e), axis=0).all())
    try:
        from softshadow import plot

        view = framing.frame(scene_of(solid or scene.entries), width=_SIZE[0], height=_SIZE[1])
        drawn = plot.show(render(scene.copy(), *view, method="hard"), "radiance")
        return html.image(_png(drawn), "the scene with hard shadows")
    except (ModuleNotFoundError, ValueError):  # of what the core refuses to render
        return ""


def _png(figure: Figure) -> bytes:
    """Return what a notebook shows of a figure, which is of few bytes."""
    return cast("OwnFigure", figure)._repr_png_()
