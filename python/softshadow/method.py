"""What all methods share."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, ClassVar

from softshadow import _core

__all__ = ["Method"]


@dataclass(frozen=True)
class Method:
    """What all methods share; not itself a method."""

    name: ClassVar[str]
    """The name that ``method=`` takes."""
    transparent: ClassVar[bool] = False
    """Whether opacities below 1 are honoured."""
    points: ClassVar[bool] = False
    """Whether it answers at a user's own points, without a camera."""
    needs_area: ClassVar[bool] = False
    """Whether a light of size zero is an error."""

    def parameters(self) -> dict[str, Any]:
        """Return the parameters by name."""
        return asdict(self)

    def _to_core(self) -> _core.Method:
        raise TypeError(f"{type(self).__name__} cannot be rendered")
