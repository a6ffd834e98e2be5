"""What all methods share, and the one place that checks their parameters."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields
from types import NoneType
from typing import Any, ClassVar, Literal, TypeAlias, get_args, get_origin, get_type_hints

from softshadow import _core, checks

__all__ = ["LEAST_ERROR", "RANGES", "Method", "check_parameters", "kinds_of"]

RANGES = {
    "layers": (1, 64),
    "max_size": (1, 8192),
    "quads": (1, 256),
    "rays": (1, 65536),
    "resets": (0, 64),
    "resolution": (16, 16384),
    "samples": (1, 65536),
    "seed": (0, 2**64 - 1),
    "steps": (1, 8),
    "views": (1, 9),
}
"""Of every parameter that is a whole number; the same name is the same thing in all methods."""

LEAST_ERROR = 1e-4
"""That methods of the core which take an ``error`` can be asked for."""


@dataclass(frozen=True)
class Method:
    """What all methods share; not itself a method.

    The compiled core makes a method from its `name` and its fields.

    Parameters are checked when a method is made: of the right kind and in their range, or a
    ``TypeError`` or ``ValueError`` that says which and what is allowed.
    """

    name: ClassVar[str]
    """The name that ``method=`` takes."""
    transparent: ClassVar[bool] = False
    """Whether opacities below 1 are honoured."""
    points: ClassVar[bool] = False
    """Whether it answers at a user's own points, without a camera."""

    def __post_init__(self) -> None:
        """Check the parameters and store them as plain numbers, flags and text."""
        check_parameters(self)
        self._to_core()  # knows the ranges of fractions, and what does not go together

    def parameters(self) -> dict[str, Any]:
        """Return the parameters by name.

        Returns
        -------
        dict of str to int, float, bool, str or None
        """
        return asdict(self)

    def _to_core(self) -> _core.Method:
        if type(self) is Method:
            raise TypeError("Method is what methods share, not itself a method")
        return _core.Method(self.name, self)


def check_parameters(thing: Any) -> None:
    """Check the fields of a frozen dataclass by their types and names, and store plain values.

    Raises
    ------
    TypeError, ValueError
        Which says what is allowed.
    """
    for name, (kinds, choices) in kinds_of(type(thing)).items():
        what = f"{type(thing).__name__}.{name}"
        value = _checked(getattr(thing, name), what, name, kinds, choices)
        object.__setattr__(thing, name, value)


_Kinds: TypeAlias = "dict[str, tuple[tuple[Any, ...], tuple[str, ...]]]"
_KNOWN: dict[type[Any], _Kinds] = {}


def kinds_of(method: type[Any]) -> _Kinds:
    """Return each parameter's types, and the names that it may be."""
    if method in _KNOWN:
        return _KNOWN[method]
    hints = get_type_hints(method)
    kinds: _Kinds = {}
    for field in fields(method):
        hint = hints[field.name]
        parts = (hint,) if get_origin(hint) is Literal else get_args(hint) or (hint,)
        literals = [part for part in parts if get_origin(part) is Literal]
        choices = tuple(choice for part in literals for choice in get_args(part))
        kinds[field.name] = (parts, choices)
    return _KNOWN.setdefault(method, kinds)


def _checked(
    value: Any, what: str, name: str, kinds: tuple[Any, ...], choices: tuple[str, ...]
) -> Any:
    optional = NoneType in kinds
    if value is None and optional:
        return None
    otherwise = " or None" if optional else ""
    if bool in kinds:
        return checks.flag(value, what)
    if int in kinds:
        low, high = RANGES[name]
        return checks.integer(value, what, low, high, otherwise)
    if float in kinds:
        return checks.number(value, what, f"a number{otherwise}", finite=False)
    names = ", ".join(f'"{choice}"' for choice in choices)
    allowed = f"one of {names}{otherwise}"
    if not isinstance(value, str):
        raise TypeError(f"{what}: expected {allowed}, got {checks.shown(value)}")
    if value not in choices:
        raise _core.ParameterError(f"{what}: expected {allowed}, got {json.dumps(value)}")
    return str(value)
