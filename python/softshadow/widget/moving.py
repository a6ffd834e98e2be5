"""`ShadowWidget`, the kernel's side of `softshadow.widget`; the browser's is ``moving.js``."""

from __future__ import annotations

import base64
import io
import math
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from softshadow.arguments import Vector
from softshadow.camera import Camera
from softshadow.checks import shown
from softshadow.extras import needs
from softshadow.images import auto_exposure, to_srgb
from softshadow.light import DiskLight, PlacedLight, PolygonLight, RectLight, SphereLight
from softshadow.methods import Method
from softshadow.render import Image, prepare
from softshadow.scene import Scene

with needs("widget", "ss.widget"):
    import traitlets
    from anywidget import AnyWidget
    from PIL import Image as Pixels

__all__ = ["ShadowWidget", "dragged"]

_QUALITY = 90
"""Of the JPEG that is sent: no step is seen in a penumbra. At 512² it takes 1 ms and 27 kB, where a
PNG of zlib's lowest level takes 6 ms and 97 kB."""

_WIDTHS = (0.05, 4.0)
"""How small and how large the light can be made, of its width at the start."""

_HERE = Path(__file__).parent


class ShadowWidget(AnyWidget):
    """A picture whose light is moved; made by `softshadow.widget`.

    Attributes
    ----------
    center : tuple of 3 floats
        Of the light, in world units.
    width : float
        Of the light, in world units: its diameter, or a rectangle's longer edge.
    method : str
        One of ``methods``.
    methods : list of str
        What can be chosen.
    what : str
        ``"radiance"`` or ``"visibility"``.
    error : str
        Why there is no picture of this state; empty if there is one.
    picture : bytes
        What is shown, as JPEG.
    answers : int
        How often it was redrawn, or could not be.
    """

    _esm = _HERE / "moving.js"
    _css = _HERE / "moving.css"

    center = traitlets.Tuple(*(traitlets.Float() for _ in range(3))).tag(sync=True)
    width = traitlets.Float().tag(sync=True)
    widths = traitlets.Tuple(traitlets.Float(), traitlets.Float()).tag(sync=True)
    method = traitlets.Unicode().tag(sync=True)
    methods = traitlets.List(traitlets.Unicode()).tag(sync=True)
    what = traitlets.Enum(["radiance", "visibility"], "radiance").tag(sync=True)
    text = traitlets.Unicode().tag(sync=True)
    error = traitlets.Unicode().tag(sync=True)
    picture = traitlets.Bytes().tag(sync=True)
    answers = traitlets.Int().tag(sync=True)

    def __init__(
        self,
        scene: Scene,
        camera: Camera,
        light: PlacedLight,
        methods: Mapping[str, Method],
        method: str,
        what: str,
    ) -> None:
        width = width_of(light)
        if not width > 0:
            raise ValueError(f"light: expected one with a size that can be changed, got {light}")
        self._scene, self._camera, self._start = scene, camera, light
        self._choices = dict(methods)
        self._exposure: float | None = None
        self._image: Image | None = None
        self._asked = False
        super().__init__(
            center=light.center,
            width=width,
            widths=(_WIDTHS[0] * width, _WIDTHS[1] * width),
            method=method,
            methods=list(methods),
            what=what,
        )
        self.observe(self._changed, ["center", "width", "method", "what"])
        self.on_msg(self._answer)
        self.redraw()

    @property
    def light(self) -> PlacedLight:
        """The light as it is now."""
        return placed(self._start, self.center, self.width)

    @property
    def image(self) -> Image:
        """The last image that was rendered."""
        assert self._image is not None  # made with the widget, which is an error otherwise
        return self._image

    def redraw(self) -> None:
        """Render again, after a change of the scene.

        Raises
        ------
        ValueError, MemoryError
            What `softshadow.render` raises; it is shown below the picture, too.
        """
        with self._refusals_shown():
            self._draw()

    @traitlets.validate("method")
    def _known(self, proposal: Any) -> Any:
        if proposal["value"] not in self._choices:
            names = ", ".join(self._choices)
            raise traitlets.TraitError(
                f"method: expected one of {names}, got {shown(proposal['value'])}"
            )
        return proposal["value"]

    @traitlets.validate("width")
    def _positive(self, proposal: Any) -> Any:
        if not 0 < proposal["value"] < math.inf:
            raise traitlets.TraitError(
                f"width: expected a positive number, got {proposal['value']}"
            )
        return proposal["value"]

    def _changed(self, _: object) -> None:
        if not self._asked:
            self.redraw()

    def _answer(self, _: object, asked: dict[str, Any], __: object) -> None:
        """Draw the state that the browser asks for, once; it waits until `answers` changes."""
        self._asked = True
        try:
            # Shown to the one who asked; an error in a message's handler reaches nobody else.
            with suppress(Exception), self._refusals_shown():
                if "drag" in asked:
                    self.center = dragged(self._camera, **asked["drag"])
                for name in ("width", "method", "what"):
                    if name in asked:
                        setattr(self, name, asked[name])
                self._draw()
        finally:
            self._asked = False

    @contextmanager
    def _refusals_shown(self) -> Iterator[None]:
        try:
            yield
        except BaseException as error:  # an interrupt ends this picture, too
            with self.hold_sync():
                self.error = str(error) or type(error).__name__
                self.answers += 1
            raise

    def _draw(self) -> None:
        start = time.perf_counter()
        light = self.light
        method = self._choices[self.method]
        image = prepare(self._scene, light, method).render(self._camera)
        picture = self._encoded(image)
        milliseconds = 1e3 * (time.perf_counter() - start)
        place = ", ".join(f"{x:.3g}" for x in light.center)
        self._image = image
        with self.hold_sync():
            self.picture, self.error = picture, ""
            self.text = (
                f"{self.method}: {milliseconds:.0f} ms a picture. "
                f"The light is {self.width:.3g} wide, at ({place})."
            )
            self.answers += 1

    def _encoded(self, image: Image) -> bytes:
        if self.what == "radiance":
            if self._exposure is None and image.radiance.any():
                self._exposure = auto_exposure(image.radiance)
            levels = 255 * to_srgb(image.radiance, self._exposure)
        else:
            levels = np.multiply(255, image.visibility, dtype=np.float64)
        file = io.BytesIO()
        # Colours at the full resolution, as a tinted shadow's edge is one of colour.
        Pixels.fromarray(np.rint(levels).astype(np.uint8)).save(
            file, "JPEG", quality=_QUALITY, subsampling=0
        )
        return file.getvalue()

    def __repr__(self) -> str:
        return f"ShadowWidget(method={self.method!r}, what={self.what!r}, light={self.light})"

    def _repr_mimebundle_(self, **kwargs: Any) -> Any:
        """Add the picture, for pages where no kernel runs."""
        bundle = super()._repr_mimebundle_(**kwargs)
        if bundle is None:
            return None
        data, metadata = bundle
        return {**data, "image/jpeg": base64.b64encode(self.picture).decode("ascii")}, metadata


def width_of(light: PlacedLight) -> float:
    """Return a light's diameter, or a rectangle's longer edge, in world units.

    A polygon's is twice the distance from its centroid to its farthest corner.
    """
    if isinstance(light, RectLight):
        return max(math.hypot(*light.edge_u), math.hypot(*light.edge_v))
    if isinstance(light, PolygonLight):
        return 2 * max(math.dist(v, light.center) for v in light.vertices)
    return 2 * light.radius


def placed(light: PlacedLight, center: Vector, width: float) -> PlacedLight:
    """Return a light of the same power with another centre and width."""
    factor = width / width_of(light)
    radiance = np.divide(light.radiance, factor**2)
    if isinstance(light, RectLight):
        u, v = np.multiply(factor, (light.edge_u, light.edge_v))
        return RectLight(center, u, v, radiance)
    if isinstance(light, PolygonLight):
        corners = np.subtract(light.vertices, light.center) * factor
        return PolygonLight(np.add(center, corners), radiance)
    if isinstance(light, DiskLight):
        return DiskLight(center, light.normal, width / 2, radiance)
    return SphereLight(center, width / 2, radiance)


def dragged(
    camera: Camera, start: npt.ArrayLike, pixels: tuple[float, float], away: bool
) -> tuple[float, float, float]:
    """Return where a drag takes a light.

    Parameters
    ----------
    camera : Camera
    start : array_like, shape (3,)
        Where it was when the drag began, world units.
    pixels : pair of floats
        How far the pointer has moved since, to the right and down, in the camera's pixels.
    away : bool
        Whether moving up moves it away along the view, instead of up.

    Returns
    -------
    tuple of 3 floats
        It moves in the picture as far as the pointer, seen at its distance from the eye.
    """
    place = np.asarray(start, dtype=np.float64)
    right, down, forward = camera.camera_to_world[:3, :3].T
    distance = np.linalg.norm(place - camera.eye)
    across, along = np.divide(pixels, np.diag(camera.K)[:2]) * distance
    x, y, z = place + across * right + along * (-forward if away else down)
    return float(x), float(y), float(z)
