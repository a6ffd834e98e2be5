"""`render`, `visibility` and `prepare`: what turns a scene into arrays."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from softshadow import _core, checks, kernels
from softshadow.arguments import Bar, Progress, as_points
from softshadow.camera import Camera
from softshadow.entries import Mesh, Spheres
from softshadow.light import Light, LightLike, as_lights, strength
from softshadow.methods import Auto, Method, MethodLike, resolve
from softshadow.scene import Scene, scene_of

if TYPE_CHECKING:
    from softshadow.auto import Step
    from softshadow.judging import ErrorEstimate

Png: TypeAlias = bytes
"""A file's contents; the name `bytes` is a field of `Image`."""


@dataclass(frozen=True, eq=False, repr=False)
class Image:
    """What `render` returns; arrays are indexed ``[y, x]``, row 0 on top.

    An image equals itself only: compare its arrays. Notebooks show its visibility.

    Attributes
    ----------
    visibility : ndarray, shape (H, W) or (L, H, W), float32
        Fraction of the light that each pixel's surface point sees, 0 to 1; 1 where nothing was
        hit. With a sequence of L lights the first axis is the light.
    radiance : ndarray, shape (H, W, 3), float32
        Diffuse direct light, linear RGB, the lights summed; 0 where nothing was hit.
    mask : ndarray, shape (H, W), bool
        Whether a surface was hit.
    position : ndarray, shape (H, W, 3), float64
        World-space surface points; NaN-free, 0 where nothing was hit.
    normal : ndarray, shape (H, W, 3), float32
        Geometric unit normals, turned to the camera; 0 where nothing was hit.
    depth : ndarray, shape (H, W), float32
        Distance along the viewing axis (not along the ray), world units; inf where nothing was hit.
    mesh_id : ndarray, shape (H, W), int32
        Index into ``scene.entries``; -1 where nothing was hit.
    triangle_id : ndarray, shape (H, W), int32
        Face index within its mesh (sphere index within its spheres); -1 where nothing was hit.
    seconds : dict
        Wall-clock seconds by stage: ``prepare`` (per scene, paid once), ``frame`` (all per-frame
        work) and the method's own stages.
    bytes : int
        Bytes of the method's own data structures that are kept for further frames: hierarchy, maps,
        textures. A process grows by more: while maps and textures are built by up to 2.7 times
        that, with the scene by up to 400 bytes a triangle (measured at a million: 302 for
        ``hard``, 380 for ``ray_traced``), and by 256 bytes a pixel of the image.
    error : ErrorEstimate, optional
        How wrong it is: of images by ``auto``.
    choice : tuple of Step
        What ``auto`` tried, in order; of other images empty.
    by_rays : float
        The share of pixels and lights that the method answered by rays to all their light samples
        where its own way could not, 0 to 1. Only ``counted`` does that.

    Examples
    --------
    >>> import softshadow as ss
    >>> setup = ss.scenes.half_plane(32, 24)
    >>> image = ss.render(setup.scene, setup.camera, setup.light)
    >>> lit = image.visibility[image.mask]
    >>> bool(lit.min() == 0), bool(lit.max() == 1)
    (True, True)
    >>> image.seconds["frame"] > 0
    True
    """

    visibility: npt.NDArray[np.float32]
    radiance: npt.NDArray[np.float32]
    mask: npt.NDArray[np.bool_]
    position: npt.NDArray[np.float64]
    normal: npt.NDArray[np.float32]
    depth: npt.NDArray[np.float32]
    mesh_id: npt.NDArray[np.int32]
    triangle_id: npt.NDArray[np.int32]
    seconds: dict[str, float]
    bytes: int
    by_rays: float = 0.0
    error: ErrorEstimate | None = None
    choice: tuple[Step, ...] = ()

    def __repr__(self) -> str:
        height, width = self.mask.shape
        lights = len(self.visibility) if self.visibility.ndim == 3 else 1
        seen = self.visibility[..., self.mask]
        mean = f"mean visibility {seen.mean():.3f}" if seen.size else "no surface hit"
        return f"Image({width}x{height}, {lights} light{'s' if lights > 1 else ''}, {mean})"

    def _repr_png_(self) -> Png | None:
        from softshadow import showing

        return showing.image_png(self)


class Prepared:
    """A method with what it builds once for a scene and its lights; made by `prepare`.

    It sees the scene as it was when it was prepared: what is done to the scene later changes
    nothing here. On the other side of a process boundary it is prepared again, with the same bits.
    It cannot be changed, so copies are the same object, and it equals itself only.
    """

    def __init__(
        self, scene: Scene, light: LightLike, method: MethodLike, progress: Progress = False
    ) -> None:
        if not isinstance(scene, Scene):
            raise TypeError(f"scene: expected softshadow.Scene, got {type(scene).__name__}")
        self._method: Method = resolve(method)
        lights, self._single = as_lights(light)
        self._lights = tuple(lights)
        self._entries, self._instances = scene.entries, scene.instances
        method_core = self.method._to_core()
        with Bar(progress, f"{self.method.name}: prepare") as report:
            self._core: _core.Prepared = _core.prepare(
                scene._core, [x._core for x in self.lights], method_core, report
            )

    def __reduce__(self) -> tuple[Any, ...]:
        light: LightLike = self.lights[0] if self._single else self.lights
        return _prepare_again, (self._entries, light, self.method, self._instances)

    def __copy__(self) -> Prepared:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Prepared:
        return self

    @property
    def method(self) -> Method:
        """The method."""
        return self._method

    @property
    def lights(self) -> tuple[Light, ...]:
        """The lights."""
        return self._lights

    @property
    def seconds(self) -> dict[str, float]:
        """Wall-clock seconds that preparing took, by stage; ``prepare`` is their sum."""
        return self._core.seconds

    def render(self, camera: Camera, progress: Progress = False) -> Image:
        """Render an image.

        Parameters
        ----------
        camera : Camera
        progress : bool or callable
            ``True`` for a progress bar, or a function that is told the finished fraction, 0 and 1
            at least; an exception of its ends the call and is what the caller gets.

        Returns
        -------
        Image

        Raises
        ------
        TypeError
            If `camera` is no camera.
        ValueError
            If the method cannot answer for this camera, which it says.

        Examples
        --------
        >>> import softshadow as ss
        >>> setup = ss.scenes.half_plane(32, 24)
        >>> prepared = ss.prepare(setup.scene, setup.light, "hard")
        >>> prepared.render(setup.camera).radiance.shape
        (24, 32, 3)
        """
        if not isinstance(camera, Camera):
            raise TypeError(f"camera: expected softshadow.Camera, got {type(camera).__name__}")
        with Bar(progress, f"{self.method.name}: frame") as report:
            raw = self._core.render(camera._core, report)
        visibility = raw["visibility"]
        return Image(
            visibility=visibility[0] if self._single else visibility,
            radiance=raw["radiance"],
            mask=raw["mask"],
            position=raw["position"],
            normal=raw["normal"],
            depth=raw["depth"],
            mesh_id=raw["mesh_id"],
            triangle_id=raw["triangle_id"],
            seconds=raw["seconds"],
            bytes=raw["bytes"],
            by_rays=raw["by_rays"],
        )

    def visibility(
        self,
        points: npt.ArrayLike,
        normals: npt.ArrayLike | None = None,
        progress: Progress = False,
    ) -> npt.NDArray[np.float32]:
        """Return the visibility of the lights from points.

        Parameters
        ----------
        points : array_like, shape (N, 3)
            World positions.
        normals : array_like, shape (N, 3), optional
            Surface normals of any length but zero; a light point below a normal's tangent plane
            counts as blocked. Without normals there is no tangent plane, and a point that lies on
            a surface may or may not be hidden by it.
        progress : bool or callable
            As in `render`.

        Returns
        -------
        ndarray, shape (N,) or (L, N), float32
            (L, N) when the lights are a sequence.

        Raises
        ------
        ValueError
            If shapes do not fit, a value is not finite, or the method needs a camera.

        Examples
        --------
        >>> import softshadow as ss
        >>> setup = ss.scenes.half_plane(32, 24)
        >>> prepared = ss.prepare(setup.scene, setup.light, ss.RayTraced(samples=64))
        >>> prepared.visibility([(-2, 0, 0), (2, 0, 0)], [(0, 0, 1), (0, 0, 1)]).tolist()
        [0.0, 1.0]
        """
        if not self.method.points:
            raise ValueError(f"method {self.method.name!r} needs a camera: use render")
        p, n = self._points(points, normals)
        with Bar(progress, f"{self.method.name}: visibility") as report:
            result = self._core.visibility(p, n, report)
        return result[0] if self._single else result

    @staticmethod
    def _points(
        points: npt.ArrayLike, normals: npt.ArrayLike | None
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64] | None]:
        """Return points and normals as the core takes them, checked."""
        p = as_points(points, "points")
        n: npt.NDArray[np.float64] | None = None
        if normals is not None:
            n = checks.numbers(normals, "normals")
            if n.shape != p.shape:
                raise ValueError(f"normals: expected shape {p.shape} as the points, got {n.shape}")
        return p, n

    def irradiance(
        self, points: npt.ArrayLike, normals: npt.ArrayLike, progress: Progress = False
    ) -> npt.NDArray[np.float32]:
        """Return the irradiance of the lights at points.

        It is the closed form of what a whole light gives, times its visibility over the part above
        the tangent plane: what ``radiance`` of an image has, over albedo / π. Images of
        ``ray_traced`` and ``counted`` weight each sample: other values in penumbrae of wide lights.

        Parameters
        ----------
        points : array_like, shape (N, 3)
            World positions.
        normals : array_like, shape (N, 3)
            Surface normals of any length but zero.
        progress : bool or callable
            As in `render`.

        Returns
        -------
        ndarray, shape (N, 3), float32
            Linear RGB, the lights summed.

        Raises
        ------
        ValueError
            As `visibility`; or if there are no normals, or it overflows single precision.

        Examples
        --------
        >>> import softshadow as ss
        >>> setup = ss.scenes.half_plane(32, 24)
        >>> prepared = ss.prepare(setup.scene, setup.light, "hard")
        >>> lit = prepared.irradiance([(-2, 0, 0), (2, 0, 0)], [(0, 0, 1), (0, 0, 1)])
        >>> lit.shape, bool(lit[0].any()), bool(lit[1].all())
        ((2, 3), False, True)
        """
        if normals is None:
            raise ValueError("normals: irradiance needs them, got None")
        seen = np.atleast_2d(self.visibility(points, normals, progress))
        p, n = as_points(points, "points"), as_points(normals, "normals")
        total = np.zeros((len(p), 3))
        for light, visible in zip(self.lights, seen, strict=True):
            total += shadowed_irradiance(light, p, n, visible)[:, None] * np.array(strength(light))
        with np.errstate(over="ignore"):  # found at once
            result = total.astype(np.float32)
        if not np.all(np.isfinite(result)):
            raise _core.ParameterError(
                f"irradiance: it overflows single precision, {checks.MOST_SINGLE:.3e}; lower the "
                "lights' radiance"
            )
        return result


def shadowed_irradiance(
    light: Light,
    positions: npt.NDArray[np.float64],
    normals: npt.NDArray[np.float64],
    visibility: npt.NDArray[np.float32],
) -> npt.NDArray[np.float64]:
    """Return the closed form of the unshadowed irradiance, times visibility over its part.

    Of a light of radiance 1 (a distant one: of irradiance 1); positions and normals have one axis
    more than the visibility.
    """
    p, n = positions.reshape(-1, 3), np.ascontiguousarray(normals.reshape(-1, 3))
    part = kernels.light_fraction_above(light, p, n)
    whole = kernels.unshadowed_irradiance(light, p, n)
    ratio = np.divide(visibility.reshape(-1), part, out=np.zeros_like(part), where=part > 0)
    return (whole * ratio).reshape(visibility.shape)


@contextmanager
def _prepared(
    scene: Scene, light: LightLike, method: MethodLike, progress: Progress, rest: str
) -> Iterator[tuple[Prepared, Progress]]:
    """Prepare with the first half of a progress; hand out its other half, under this name."""
    chosen = resolve(method)
    bar = Bar(progress, chosen.name)
    with bar:
        prepared = prepare(scene, light, chosen, bar.part(0, 0.5, f"{chosen.name}: prepare"))
        yield prepared, bar.part(0.5, 1, f"{chosen.name}: {rest}")


def _prepare_again(
    entries: tuple[Mesh | Spheres, ...], light: LightLike, m: Method, instances: str
) -> Prepared:
    return prepare(scene_of(entries, instances), light, m)


def prepare(
    scene: Scene, light: LightLike, method: MethodLike = "ray_traced", progress: Progress = False
) -> Prepared:
    """Build once what a method needs for a scene and its lights.

    Parameters
    ----------
    scene : Scene
    light : light or sequence of lights
    method : str or method
        A name (see `method_names`) or a configured object.
    progress : bool or callable
        ``True`` for a progress bar, or a function that is told the finished fraction.

    Returns
    -------
    Prepared

    Raises
    ------
    ValueError
        If the scene is empty, or the method cannot do what the scene or light needs.

    Examples
    --------
    >>> import softshadow as ss
    >>> setup = ss.scenes.half_plane(32, 24)
    >>> prepared = ss.prepare(setup.scene, [setup.light, setup.light], "wedges")
    >>> [prepared.render(setup.camera).visibility.shape for _ in range(2)]
    [(2, 24, 32), (2, 24, 32)]
    """
    chosen = resolve(method)
    if isinstance(chosen, Auto):
        from softshadow.auto import PreparedAuto  # which renders by what stands here

        return PreparedAuto(scene, light, chosen, progress)
    return Prepared(scene, light, chosen, progress)


def render(
    scene: Scene,
    camera: Camera,
    light: LightLike,
    method: MethodLike = "ray_traced",
    progress: Progress = False,
) -> Image:
    """Render the scene's direct light and visibility.

    Parameters
    ----------
    scene : Scene
    camera : Camera
    light : light or sequence of lights
    method : str or method
        A name (see `method_names`) or a configured object.
    progress : bool or callable
        ``True`` for a progress bar, or a function that is told the finished fraction.

    Returns
    -------
    Image
        Its ``seconds`` include ``prepare``.

    Examples
    --------
    >>> import softshadow as ss
    >>> setup = ss.scenes.half_plane(32, 24)
    >>> image = ss.render(setup.scene, setup.camera, setup.light, ss.RayTraced(samples=64))
    >>> image.visibility.shape, image.visibility.dtype
    ((24, 32), dtype('float32'))
    """
    with _prepared(scene, light, method, progress, "frame") as (prepared, rest):
        return prepared.render(camera, rest)


def visibility(
    scene: Scene,
    points: npt.ArrayLike,
    normals: npt.ArrayLike | None,
    light: LightLike,
    method: MethodLike = "ray_traced",
    progress: Progress = False,
) -> npt.NDArray[np.float32]:
    """Return the visibility of the lights from points.

    Parameters
    ----------
    scene : Scene
    points, normals
        As of `Prepared.visibility`.
    light : light or sequence of lights
    method : str or method
        A name (see `method_names`) or a configured object, which answers at points.
    progress : bool or callable
        As in `render`.

    Returns
    -------
    ndarray, shape (N,) or (L, N), float32
        (L, N) when the lights are a sequence.

    Raises
    ------
    ValueError
        As `prepare` and `Prepared.visibility`.

    Examples
    --------
    >>> import softshadow as ss
    >>> setup = ss.scenes.half_plane(32, 24)
    >>> points, normals = [(-2, 0, 0), (2, 0, 0)], [(0, 0, 1), (0, 0, 1)]
    >>> ss.visibility(setup.scene, points, normals, setup.light, "hard").tolist()
    [0.0, 1.0]
    """
    with _prepared(scene, light, method, progress, "visibility") as (prepared, rest):
        return prepared.visibility(points, normals, rest)


def irradiance(
    scene: Scene,
    points: npt.ArrayLike,
    normals: npt.ArrayLike,
    light: LightLike,
    method: MethodLike = "ray_traced",
    progress: Progress = False,
) -> npt.NDArray[np.float32]:
    """Return the irradiance of the lights at points.

    Parameters
    ----------
    scene : Scene
    points, normals
        As of `Prepared.irradiance`.
    light : light or sequence of lights
    method : str or method
        A name (see `method_names`) or a configured object, which answers at points.
    progress : bool or callable
        As in `render`.

    Returns
    -------
    ndarray, shape (N, 3), float32
        Linear RGB, the lights summed.

    Raises
    ------
    ValueError
        As `prepare` and `Prepared.irradiance`.

    Examples
    --------
    >>> import math, softshadow as ss
    >>> scene, light = ss.Scene(), ss.SphereLight((0, 0, 10), 1, radiance=4)
    >>> ground = scene.add(ss.scenes.square(1))
    >>> lit = ss.irradiance(scene, [(0, 0, 0)], [(0, 0, 1)], light)
    >>> math.isclose(lit[0, 0], 4 * math.pi * (1 / 10) ** 2, rel_tol=1e-6)
    True
    """
    with _prepared(scene, light, method, progress, "irradiance") as (prepared, rest):
        return prepared.irradiance(points, normals, rest)
