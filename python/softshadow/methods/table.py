"""The methods by their names."""

from __future__ import annotations

from typing import TypeAlias

from softshadow.methods.accumulation import Accumulation
from softshadow.methods.auto import Auto
from softshadow.methods.base import Method
from softshadow.methods.convolution import Convolution
from softshadow.methods.counted import Counted
from softshadow.methods.filtered import DeepShadow, Pcf
from softshadow.methods.hard import Hard
from softshadow.methods.layered import Mlsm, Mtsm, Slsm
from softshadow.methods.mvsm import Mvsm
from softshadow.methods.ray_traced import RayTraced
from softshadow.methods.single_sample import SingleSample
from softshadow.methods.ssoc import Ssoc
from softshadow.methods.wedges import ShadowVolume, Wedges

__all__ = ["METHODS", "MethodLike", "method_names", "resolve"]

METHODS: dict[str, type[Method]] = {
    m.name: m
    for m in (
        Accumulation,
        Auto,
        Convolution,
        Counted,
        DeepShadow,
        Hard,
        Mlsm,
        Mtsm,
        Mvsm,
        Pcf,
        RayTraced,
        ShadowVolume,
        SingleSample,
        Slsm,
        Ssoc,
        Wedges,
    )
}
"""A line a method; `softshadow._core` has the same names, but for `Auto`."""

MethodLike: TypeAlias = "str | Method"
"""A method's name, or a configured method."""


def method_names() -> tuple[str, ...]:
    """Return the names that ``method=`` takes.

    Returns
    -------
    tuple of str
        In alphabetical order.

    Examples
    --------
    >>> import softshadow as ss
    >>> "ray_traced" in ss.method_names()
    True
    """
    return tuple(METHODS)


def resolve(method: MethodLike) -> Method:
    """Return the method object for a name or a configured method.

    Raises
    ------
    ValueError
        If the name is unknown.
    TypeError
        If `method` is neither a string nor a method.
    """
    if isinstance(method, str):
        try:
            return METHODS[method]()
        except KeyError:
            names = ", ".join(METHODS)
            raise ValueError(f"method: unknown name {method!r}; expected one of {names}") from None
    if isinstance(method, Method):
        return method
    raise TypeError(f"method: expected a name or a method object, got {type(method).__name__}")
