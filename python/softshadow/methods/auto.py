"""The cheapest answer under an error that the user states."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from softshadow import _core, checks
from softshadow.methods.base import Method, check_parameters

__all__ = ["Auto"]


@dataclass(frozen=True)
class Auto(Method):
    """The cheapest answer under an error that the user states, judged by probes.

    It answers by `RayTraced` with an error or by `Counted`, whichever takes less as it is measured
    on a small part. The reference judges the answer at some hundreds of receivers, and where the
    upper end of the interval is above what was asked, it goes on. ``Image.error`` has the estimate,
    ``Image.choice`` what answered. See ``docs/methods/auto.md``.

    Parameters
    ----------
    error : float
        Root mean square error of visibility over the pixels that hit a surface, or over all
        points, 0.0005 to 1.
    confidence : float
        Of the interval whose upper end is to be below `error`, 0.5 to 0.9999.
    seed : int
        Of the light samples and of the probes, 0 to 2**64 - 1.
    seconds : float, optional
        When to stop with the best answer by then, whose interval may end above `error`; above 0. It
        does not count preparing. What is there at least, by 4 light samples, and what judges it are
        not stopped. When not given: no limit.
    engine : {"cheapest", "ray_traced", "counted"}
        Which method answers. What is cheapest depends on times, and so may change from one call to
        the next; with an engine given, the same seed gives the same bits.

    Raises
    ------
    ParameterError
        If a parameter is out of its range.

    Examples
    --------
    >>> import softshadow as ss
    >>> setup = ss.scenes.half_plane(32, 24)
    >>> image = ss.render(setup.scene, setup.camera, setup.light, ss.Auto(error=0.02))
    >>> image.error.high <= 0.02
    True
    >>> len(image.choice)  # pictures that were made until it held
    1
    """

    error: float = 0.01
    confidence: float = 0.95
    seed: int = 0
    seconds: float | None = None
    engine: Literal["cheapest", "ray_traced", "counted"] = "cheapest"

    name: ClassVar[str] = "auto"
    transparent: ClassVar[bool] = True
    points: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Check the parameters; the core knows none of them."""
        check_parameters(self)
        for what, low, high in (("error", 5e-4, 1.0), ("confidence", 0.5, 0.9999)):
            if not low <= getattr(self, what) <= high:
                raise _core.ParameterError(
                    f"Auto.{what}: expected a number from {low} to {high}, got "
                    f"{checks.shown(getattr(self, what))}"
                )
        if self.seconds is not None and not self.seconds > 0:
            raise _core.ParameterError(
                f"Auto.seconds: expected a positive number or None, got {self.seconds}"
            )

    def _to_core(self) -> _core.Method:
        raise TypeError("Auto has no kernel: it hands other methods over, softshadow.prepare does")
