"""The collection of hard cases, and what methods make of them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING

from softshadow import metrics
from softshadow._core import UnsupportedError
from softshadow.arguments import Bar, Progress
from softshadow.compare import Comparison, label_of, parameters_text
from softshadow.extras import needs
from softshadow.methods import (
    Accumulation,
    Auto,
    Convolution,
    DeepShadow,
    Method,
    MethodLike,
    Mlsm,
    Mtsm,
    Mvsm,
    Pcf,
    Slsm,
    Ssoc,
    method_names,
    resolve,
)
from softshadow.render import Image, render
from softshadow.scenes.hard_cases.case import REFERENCE, SIZE, Answer, HardCase

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["HardCases"]

_SMALLER: dict[str, Method] = {
    m.name: m
    for m in (
        Accumulation(samples=64),
        Auto(error=0.003, engine="ray_traced"),
        Convolution(max_size=256),
        DeepShadow(resolution=256),
        Mlsm(resolution=256),
        Mtsm(resolution=256),
        Mvsm(resolution=256, samples=64),
        Pcf(resolution=256),
        Slsm(resolution=256),
        Ssoc(resolution=256),
    )
}
"""Maps and textures that suit pictures of ``SIZE``, and take a tenth of a second for a light; and
what makes ``auto`` give the same bits every time."""


class HardCases(Mapping[str, HardCase]):
    """Hard cases by name; `softshadow.scenes.hard` is the one there is.

    Parameters
    ----------
    cases : iterable of HardCase
        In the order that they are listed in.

    Examples
    --------
    >>> import softshadow as ss
    >>> case = ss.scenes.hard["half_plane"]
    >>> answer = case.answer()
    >>> image = ss.render(answer.setup.scene, answer.setup.camera, answer.setup.lights, "wedges")
    >>> answer.error(image) < case.tolerance("wedges")
    True
    """

    def __init__(self, cases: Iterable[HardCase]) -> None:
        self._cases = {case.name: case for case in cases}

    def __getitem__(self, name: str) -> HardCase:
        """Return a case by its name."""
        try:
            return self._cases[name]
        except KeyError:
            known = ", ".join(self._cases)
            raise KeyError(f"no hard case {name!r}; there are {known}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._cases)

    def __len__(self) -> int:
        return len(self._cases)

    def __repr__(self) -> str:
        return f"HardCases({', '.join(self._cases)})"

    @property
    def methods(self) -> dict[str, Method]:
        """All methods by name, at the settings for which tolerances hold."""
        return {name: _SMALLER.get(name) or resolve(name) for name in method_names()}

    def compare(
        self,
        names: Iterable[str] | None = None,
        methods: Iterable[MethodLike] | None = None,
        progress: Progress = False,
        width: int = SIZE[0],
        height: int = SIZE[1],
    ) -> dict[str, Comparison]:
        """Render hard cases by several methods.

        The result is what `softshadow.report` and, case by case, `softshadow.plot.strip` take.

        Parameters
        ----------
        names : iterable of str, optional
            Of the cases; all when not given.
        methods : iterable of str or method, optional
            All of `methods` when not given.
        progress : bool or callable
            ``True`` for a progress bar, or a function that is told the finished fraction.
        width, height : int
            Pixels.

        Returns
        -------
        dict of str to Comparison
            By case. Tables have the columns ``method``, ``parameters``, ``prepare_seconds``,
            ``frame_seconds``, ``penumbra_mae``, ``shadow_error`` (`Answer.error`), ``tolerance``
            (NaN at another size, and at settings other than those of `methods`) and ``excuse``.
            Methods that refuse a case are in `Comparison.skipped`.
        """
        chosen = list(self._cases if names is None else names)
        own = self.methods
        given = list(own.values()) if methods is None else [resolve(m) for m in methods]
        found = {}
        with Bar(progress, "hard cases") as tell:
            for i, name in enumerate(chosen):
                case = self[name]
                found[name] = _compared(case, given, case.answer(width, height), own)
                if tell:
                    tell((i + 1) / len(chosen))
        return found

    def table(
        self,
        names: Iterable[str] | None = None,
        methods: Iterable[MethodLike] | None = None,
        progress: Progress = False,
    ) -> pd.DataFrame:
        """Return one row for each case and method, those that refuse it included.

        Parameters
        ----------
        names, methods, progress
            As of `compare`.

        Returns
        -------
        pandas.DataFrame
            The columns of `compare` after ``scene``, and ``refused``: what a method said that
            refused the scene, or an empty text.
        """
        with needs("metrics", "hard.table"):
            import pandas as pd

        tables = []
        for name, result in self.compare(names, methods, progress).items():
            refused = pd.DataFrame(
                [_refused(self[name], label, said) for label, said in result.skipped.items()]
            )
            both = pd.concat([result.table.assign(refused=""), refused], ignore_index=True)
            both.insert(0, "scene", name)
            tables.append(both)
        joined: pd.DataFrame = pd.concat(tables, ignore_index=True)
        return joined


def _compared(
    case: HardCase, methods: list[Method], answer: Answer, own: Mapping[str, Method]
) -> Comparison:
    with needs("metrics", "hard.compare"):
        import pandas as pd

    setup = answer.setup
    rows, images, skipped = [], {}, {}
    for method in methods:
        label = label_of(method)
        try:
            image = render(setup.scene, setup.camera, setup.lights, method)
        except UnsupportedError as error:
            skipped[label] = str(error)
            continue
        images[label] = image
        size = (setup.camera.width, setup.camera.height)
        held = size == SIZE and method == own[method.name]
        rows.append(_row(case, answer, method, image, held))
    by = None if case.closed_form else REFERENCE
    return Comparison(pd.DataFrame(rows), images, answer.image, skipped, by)


def _row(
    case: HardCase, answer: Answer, method: Method, image: Image, held: bool
) -> dict[str, object]:
    exact = answer.image.visibility
    partly = metrics.penumbra_mask(exact, where=answer.where)
    return {
        "method": method.name,
        "parameters": parameters_text(method),
        "prepare_seconds": image.seconds["prepare"],
        "frame_seconds": image.seconds["frame"],
        "penumbra_mae": metrics.mae(image.visibility, exact, partly) if partly.any() else math.nan,
        "shadow_error": answer.error(image),
        "tolerance": case.tolerance(method.name) if held else math.nan,
        "excuse": _reason(case, method.name),
    }


def _refused(case: HardCase, label: str, said: str) -> dict[str, object]:
    method, _, parameters = label.removesuffix(")").partition("(")
    excuse = _reason(case, method)
    return {"method": method, "parameters": parameters, "excuse": excuse, "refused": said}


def _reason(case: HardCase, method: str) -> str:
    excuse = case.excuses.get(method)
    return "" if excuse is None else excuse.reason
