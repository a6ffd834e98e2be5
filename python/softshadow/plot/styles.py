"""Colours and marks that stay apart for colour-blind readers and in grey print."""

from __future__ import annotations

from collections.abc import Iterable

from softshadow.methods import method_names

__all__ = ["COLOURS", "MITSUBA", "line_styles", "style"]

COLOURS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9", "#CC79A7", "#8C7A00")
"""Of Okabe and Ito (2008), but a yellow that is dark enough for lines on white; black is
Mitsuba's and the reference's."""

_MARKERS = "osD^vPX<>ph*dH8"

MITSUBA = "mitsuba"
"""What the names of Mitsuba's rows begin with."""


def style(method: str, others: list[str]) -> tuple[str, str]:
    """Return a method's colour and mark: always the same, of every method another pair.

    Parameters
    ----------
    method : str
        A name of a method, or of what was measured beside them.
    others : list of str
        All names in the figure that are no methods; they come after the methods.
    """
    if method.startswith(MITSUBA):
        variants = [name for name in others if name.startswith(MITSUBA)]
        return "#000000", "x+12348"[variants.index(method) % 7] if method in variants else "x"
    # What hands other methods over comes last: the others keep what they have in older figures.
    methods = sorted(method_names(), key=lambda name: name == "auto")
    names = [*methods, *(name for name in others if not name.startswith(MITSUBA))]
    i = names.index(method) if method in names else 0
    return COLOURS[i % len(COLOURS)], _MARKERS[i % len(_MARKERS)]


def line_styles(labels: Iterable[str]) -> dict[str, tuple[str, str, str]]:
    """Return a colour, a mark and a line style for each label.

    Settings of one method, ``name(...)``, have its colour and mark, and lines of their own.

    Parameters
    ----------
    labels : iterable of str
        May repeat.
    """
    every = list(dict.fromkeys(labels))
    methods = [label.partition("(")[0] for label in every]
    others = [name for name in dict.fromkeys(methods) if name not in method_names()]
    found = {}
    for i, (label, method) in enumerate(zip(every, methods, strict=True)):
        dashes = ("-", "--", ":", "-.")[methods[:i].count(method) % 4]
        found[label] = (*style(method, others), dashes)
    return found
