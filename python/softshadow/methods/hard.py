"""Hard shadows by one ray."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from softshadow.methods.base import Method

__all__ = ["Hard"]


@dataclass(frozen=True)
class Hard(Method):
    """Hard shadows: one shadow ray to the light's centre.

    Visibility is the transmittance along that ray, capped by the part of the light above the
    receiver's tangent plane. See ``docs/methods/hard.md``.
    """

    name: ClassVar[str] = "hard"
    transparent: ClassVar[bool] = True
    points: ClassVar[bool] = True
