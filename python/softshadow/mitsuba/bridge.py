"""Scenes as Mitsuba's dictionaries, and its radiance as arrays."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from softshadow.camera import Camera
from softshadow.entries import Mesh
from softshadow.extras import needs
from softshadow.light import (
    DiskLight,
    DistantLight,
    Light,
    LightLike,
    PolygonLight,
    SphereLight,
    as_lights,
)
from softshadow.mitsuba.image import MitsubaImage
from softshadow.mitsuba.llvm import find_llvm
from softshadow.scene import Scene

if TYPE_CHECKING:
    from types import ModuleType

__all__ = ["render", "scene_dict", "variant_set"]

_BATCHES = 32
"""Independent estimates that a variance is taken from: enough for Student's t with 31 degrees of
freedom to be near normal, few enough for the per-ray overhead of the scalar variants."""

_LAUNCH = 1 << 20
"""Rays in one launch of a vectorised variant, at least an image of them: its overhead of some
milliseconds is small beside a million rays, and they take some 100 MB."""

_FAR = 1e4
"""Scene diameters to the disk that stands for a distant light: far enough for directions to differ
by less than 1e-4 across the scene, near enough for single precision to tell them apart by less than
1e-6."""

_WIDEST = 170.0
"""Degrees that such a disk may span: its radius is eleven times its distance."""

_NEAR = 1e-3
"""Mitsuba's near clipping distance over the scene's diameter. Nearer surfaces are not seen on its
film (`render` with centre rays has no such limit); much smaller values cost its projection
digits."""


def _import() -> ModuleType:
    with needs("mitsuba", "softshadow.mitsuba"):
        import mitsuba

    module: ModuleType = mitsuba
    return module


@contextmanager
def variant_set(name: str | None) -> Iterator[ModuleType]:
    """Give Mitsuba with a variant set, and restore what the caller had set."""
    mi = _import()
    previous = mi.variant()
    wanted = name or previous or "scalar_rgb"
    if not wanted.endswith(("_rgb", "_mono")):
        raise ValueError(f"variant: expected one that ends in _rgb or _mono, got {wanted!r}")
    if wanted.startswith("llvm") and (llvm := find_llvm()) is not None:
        os.environ["DRJIT_LIBLLVM_PATH"] = llvm  # or an older one may be taken
    mi.set_variant(wanted)
    try:
        yield mi
    finally:
        if previous is not None:
            mi.set_variant(previous)


def scene_dict(scene: Scene, camera: Camera, light: LightLike, samples: int = 16) -> dict[str, Any]:
    """Return a dictionary that ``mitsuba.load_dict`` renders to the same picture.

    Meshes are placed with their transforms applied. Opaque scenes use the ``direct`` integrator
    with light sampling only; with any opacity below 1 it is ``volpath``, because ``direct`` knows
    no transparent shadows. The dictionary holds Mitsuba objects, so it belongs to the variant that
    is set when it is made (``scalar_rgb`` is set if none is).

    Parameters
    ----------
    scene : Scene
    camera : Camera
    light : light or sequence of lights
        With several in a scene, Mitsuba lets them shadow each other, and samples one at a time. A
        `DistantLight` becomes a disk far away, with an angle of 0 a ``directional`` emitter.
    samples : int
        Samples per pixel, each with one light sample.

    Returns
    -------
    dict
        With the keys ``type``, ``integrator``, ``sensor``, ``light`` (``light_<i>`` of a sequence)
        and one ``entry_<i>`` for every mesh, ``entry_<i>_<j>`` for every sphere, numbered as in
        ``scene.entries``. Meshes have the entries' names, and spheres have them as their ids, with
        ``[<j>]`` where there are several; `from_dict` makes the same scene of them.

    Raises
    ------
    ImportError
        If Mitsuba is not installed.
    ValueError
        If Mitsuba cannot express something: ``casts=False``, ``receives=False``, a light of size
        zero (a `DistantLight` may have an angle of 0, but none above 170 degrees), or a pinhole
        matrix with skew or two focal lengths.
    """
    mi = _import()
    if mi.variant() is None:
        mi.set_variant("scalar_rgb")
    if not scene.entries:
        raise ValueError("scene: it has no meshes or spheres")
    for entry in scene.entries:
        for flag in ("casts", "receives"):
            if not getattr(entry, flag):
                raise ValueError(f"mesh {entry.name!r}: Mitsuba cannot express {flag}=False")
    transparent = any(entry.opacity < 1 for entry in scene.entries)
    result: dict[str, Any] = {
        "type": "scene",
        "integrator": _integrator(transparent, 1),
        "sensor": _sensor(mi, scene, camera, samples),
    }
    lights, single = as_lights(light)
    for i, one in enumerate(lights):
        result["light" if single else f"light_{i}"] = _light(mi, one, scene)
    for i, entry in enumerate(scene.entries):
        bsdf = _bsdf(entry.albedo, entry.opacity)
        if isinstance(entry, Mesh):
            result[f"entry_{i}"] = _mesh(mi, entry, bsdf)
        else:
            for j, (center, radius) in enumerate(zip(entry.centers, entry.radii, strict=True)):
                result[f"entry_{i}_{j}"] = {
                    "type": "sphere",
                    "id": f"{entry.name}[{j}]" if len(entry.radii) > 1 else entry.name,
                    "center": center.tolist(),
                    "radius": float(radius),
                    "bsdf": bsdf,
                }
    return result


def _integrator(transparent: bool, light_samples: int) -> dict[str, Any]:
    if transparent:
        # One bounce; crossings of masks are not counted. Russian roulette never starts.
        return {"type": "volpath", "max_depth": 2, "rr_depth": 1000, "hide_emitters": True}
    return {
        "type": "direct",
        "emitter_samples": light_samples,
        "bsdf_samples": 0,
        "hide_emitters": True,
    }


def _sensor(mi: ModuleType, scene: Scene, camera: Camera, samples: int) -> dict[str, Any]:
    (fx, skew, cx), (_, fy, cy) = camera.K[0], camera.K[1]
    if skew != 0 or abs(fx - fy) > 1e-9 * abs(fy):
        raise ValueError(
            "camera: Mitsuba's perspective sensor has one focal length and no skew, "
            f"got fx={fx:g}, fy={fy:g}, skew={skew:g}"
        )
    # Its camera space has x to the left and y up; ours has x to the right and y down.
    to_world = camera.camera_to_world @ np.diag([-1.0, -1.0, 1.0, 1.0])
    low, high = scene.bounds
    near = _NEAR * float(np.linalg.norm(high - low))
    corners = np.maximum(np.abs(camera.eye - low), np.abs(camera.eye - high))
    return {
        "type": "perspective",
        "fov_axis": "y",
        "fov": float(np.degrees(2 * np.arctan(0.5 * camera.height / fy))),
        "principal_point_offset_x": float(0.5 - cx / camera.width),
        "principal_point_offset_y": float(0.5 - cy / camera.height),
        "near_clip": near,
        "far_clip": 2 * float(np.linalg.norm(corners)) + near,
        "to_world": mi.ScalarTransform4f(to_world),
        "film": {
            "type": "hdrfilm",
            "width": camera.width,
            "height": camera.height,
            "pixel_format": "rgba",
            "component_format": "float32",
            "rfilter": {"type": "box"},
        },
        "sampler": {"type": "independent", "sample_count": samples},
    }


def _distant(mi: ModuleType, light: DistantLight, scene: Scene) -> Any:
    if light.angle_deg == 0:
        irradiance = {"type": "rgb", "value": list(light.irradiance)}
        return {
            "type": "directional",
            "direction": list(light.direction),
            "irradiance": irradiance,
        }
    if light.angle_deg > _WIDEST:
        raise ValueError(
            f"DistantLight.angle_deg: a far disk stands for it in Mitsuba, up to {_WIDEST:g}, "
            f"got {light.angle_deg:g}"
        )
    low, high = scene.bounds
    distance = _FAR * float(np.linalg.norm(high - low))
    direction = np.asarray(light.direction) / np.linalg.norm(light.direction)
    half = np.radians(0.5 * light.angle_deg)
    radiance = np.asarray(light.irradiance) / (np.pi * np.sin(half) ** 2)
    center = 0.5 * (low + high) - distance * direction
    return _light(mi, DiskLight(center, direction, distance * np.tan(half), radiance), scene)


def _light(mi: ModuleType, light: Light, scene: Scene) -> Any:
    if isinstance(light, DistantLight):
        return _distant(mi, light, scene)
    emitter = {"type": "area", "radiance": {"type": "rgb", "value": list(light.radiance)}}
    if isinstance(light, PolygonLight):
        properties = mi.Properties()
        properties["emitter"] = mi.load_dict(emitter)
        faces = np.array(light._core.triangles())
        return _filled(mi, "light", np.array(light.vertices), faces, properties)
    if isinstance(light, SphereLight):
        _need_size(light.radius, "SphereLight.radius")
        return {
            "type": "sphere",
            "center": list(light.center),
            "radius": light.radius,
            "emitter": emitter,
        }
    to_world = np.eye(4)
    to_world[:3, 3] = light.center
    if isinstance(light, DiskLight):
        _need_size(light.radius, "DiskLight.radius")
        u, v, n = _frame(np.asarray(light.normal, dtype=np.float64))
        to_world[:3, :3] = np.stack([light.radius * u, light.radius * v, n], axis=1)
        shape = "disk"
    else:
        # The rectangle spans [-1, 1]² and takes any affine map, so a parallelogram is one, too.
        u, v = 0.5 * np.asarray(light.edge_u), 0.5 * np.asarray(light.edge_v)
        n = np.cross(u, v)
        to_world[:3, :3] = np.stack([u, v, n / np.linalg.norm(n)], axis=1)
        shape = "rectangle"
    return {"type": shape, "to_world": mi.ScalarTransform4f(to_world), "emitter": emitter}


def _need_size(radius: float, what: str) -> None:
    if not radius > 0:
        raise ValueError(f"{what}: Mitsuba's area lights need a size, got {radius:g}")


def _frame(
    normal: npt.NDArray[np.float64],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return a right-handed orthonormal frame whose third vector is along `normal`."""
    n = normal / np.linalg.norm(normal)
    u = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
    u /= np.linalg.norm(u)
    return u, np.cross(n, u), n


def _bsdf(albedo: tuple[float, float, float], opacity: float) -> dict[str, Any]:
    surface = {
        "type": "twosided",
        "diffuse": {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(albedo)}},
    }
    if opacity < 1:
        return {"type": "mask", "opacity": opacity, "surface": surface}
    return surface


def _mesh(mi: ModuleType, entry: Mesh, bsdf: dict[str, Any]) -> Any:
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(bsdf)
    return _filled(mi, entry.name, entry.world_vertices(), entry.faces, properties)


def _filled(
    mi: ModuleType,
    name: str,
    vertices: npt.NDArray[np.float64],
    faces: npt.NDArray[np.int64],
    properties: Any,
) -> Any:
    properties["face_normals"] = True
    mesh = mi.Mesh(name, len(vertices), len(faces), props=properties)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = np.ravel(vertices).astype(np.float32)
    parameters["faces"] = np.ravel(faces).astype(np.uint32)
    parameters.update()
    return mesh


def render(
    scene: Scene,
    camera: Camera,
    light: LightLike,
    samples: int = 256,
    variant: str | None = None,
    seed: int = 0,
    centre_rays: bool = True,
) -> MitsubaImage:
    """Render with Mitsuba.

    Parameters
    ----------
    scene : Scene
    camera : Camera
    light : light or sequence of lights
        Several lights are rendered one by one and summed, so that they cast no shadows.
    samples : int
        Independent light samples per pixel and light, at least 2.
    variant : str, optional
        A Mitsuba variant, for example ``"scalar_rgb"`` (anywhere, one core with centre rays) or
        ``"llvm_ad_rgb"`` (needs an LLVM library; set ``DRJIT_LIBLLVM_PATH``). Default: the one that
        is set, else ``"scalar_rgb"``. What was set is restored.
    seed : int
    centre_rays : bool
        One ray through every pixel's centre, as `softshadow.render` does, instead of the film's
        footprints.

    Returns
    -------
    MitsubaImage

    Raises
    ------
    ImportError
        If Mitsuba is not installed.
    ValueError
        If `samples` is below 2, the variant is spectral or polarised, or as in `scene_dict`.
    """
    if samples < 2:
        raise ValueError(f"samples: expected at least 2, got {samples}")
    lights, _ = as_lights(light)
    shape = (camera.height, camera.width)
    radiance, variance = np.zeros((2, *shape, 3))
    mask = np.zeros(shape, dtype=bool)
    normal = np.zeros((*shape, 3), dtype=np.float32)
    batches = samples
    seconds = 0.0
    with variant_set(variant) as mi:
        for number, one in enumerate(lights):
            description = scene_dict(scene, camera, one)
            transparent = description["integrator"]["type"] == "volpath"
            # One call of `direct` takes many light samples; `volpath` takes one, and of a parallel
            # light `direct` counts each in full (3.9.1).
            parallel = isinstance(one, DistantLight) and one.angle_deg == 0
            batches = samples if transparent or parallel else _divisor(samples, _BATCHES)
            if not centre_rays:
                batches = _divisor(samples, _BATCHES)
            else:
                description["integrator"] = _integrator(transparent, samples // batches)
            loaded = mi.load_dict(description)
            start = time.perf_counter()
            args = (loaded, batches, seed + (number << 20))
            if not centre_rays:
                mean, of_mean, hit = _render_film(mi, *args, samples // batches)
            elif mi.variant().startswith("scalar"):
                mean, of_mean, hit = _centre_rays_scalar(mi, *args, camera)
            else:
                mean, of_mean, hit = _centre_rays_wavefront(mi, *args, camera)
            seconds += time.perf_counter() - start
            radiance += mean
            variance += of_mean
            mask |= hit
            if number == 0:
                normal = _centre_normals(mi, loaded, camera)
    return MitsubaImage(radiance, variance, mask, normal, samples, batches, seconds)


def _divisor(samples: int, wanted: int) -> int:
    """Return the divisor of `samples`, at least 2, that is nearest to `wanted` as a ratio."""
    divisors = [d for d in range(2, samples + 1) if samples % d == 0]
    return min(divisors, key=lambda d: max(d / wanted, wanted / d))


class _Moments:
    """Running mean and sum of squared deviations (Welford)."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.mean = np.zeros(shape)
        self._squares = np.zeros(shape)
        self._count = 0

    def add(self, value: npt.NDArray[np.float64]) -> None:
        self._count += 1
        delta = value - self.mean
        self.mean += delta / self._count
        self._squares += delta * (value - self.mean)

    def variance_of_mean(self) -> npt.NDArray[np.float64]:
        return self._squares / ((self._count - 1) * self._count)


_Estimate = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.bool_]]


def _centre_rays_scalar(
    mi: ModuleType, scene: Any, batches: int, seed: int, camera: Camera
) -> _Estimate:
    integrator = scene.integrator()
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed)
    eye = camera.eye.tolist()
    directions = camera.rays().reshape(-1, 3).tolist()
    mean = np.empty((len(directions), 3))
    variance = np.empty((len(directions), 3))
    mask = np.empty(len(directions), dtype=bool)
    sample = integrator.sample
    for i, direction in enumerate(directions):
        ray = mi.RayDifferential3f(eye, direction)
        spectra = []
        for _ in range(batches):
            spectrum, valid, _ = sample(scene, sampler, ray)
            spectra.append(spectrum)
        values = np.array(spectra, dtype=np.float64)
        mean[i] = values.mean(axis=0)
        variance[i] = values.var(axis=0, ddof=1) / batches
        mask[i] = valid
    shape = (camera.height, camera.width)
    return mean.reshape(*shape, 3), variance.reshape(*shape, 3), mask.reshape(shape)


def _centre_rays_wavefront(
    mi: ModuleType, scene: Any, batches: int, seed: int, camera: Camera
) -> _Estimate:
    integrator = scene.integrator()
    shape = (camera.height, camera.width)
    pixels = camera.height * camera.width
    # Several batches are sampled side by side, because small launches cost more than their work.
    together = max(
        d for d in range(1, batches + 1) if batches % d == 0 and d * pixels <= max(_LAUNCH, pixels)
    )
    directions = np.tile(camera.rays().reshape(-1, 3).T.astype(np.float32), together)
    ray = mi.RayDifferential3f(mi.Point3f(*camera.eye.tolist()), mi.Vector3f(directions))
    sampler = mi.load_dict({"type": "independent"})
    moments = _Moments((*shape, 3))
    mask = np.zeros(shape, dtype=bool)
    launches = batches // together
    for launch in range(launches):
        sampler.seed(seed * launches + launch, together * pixels)
        spectrum, valid, _ = integrator.sample(scene, sampler, ray)
        values = np.array(spectrum, dtype=np.float64).reshape(-1, together, *shape)
        for value in np.moveaxis(values, 0, -1):
            moments.add(np.broadcast_to(value, (*shape, 3)))
        mask |= np.array(valid, dtype=bool).reshape(together, *shape).any(axis=0)
    return moments.mean, moments.variance_of_mean(), mask


def _centre_normals(mi: ModuleType, scene: Any, camera: Camera) -> npt.NDArray[np.float32]:
    shape = (camera.height, camera.width, 3)
    directions = camera.rays().reshape(-1, 3).astype(np.float32)
    if mi.variant().startswith("scalar"):
        eye = camera.eye.tolist()
        hits = (scene.ray_intersect(mi.Ray3f(eye, d)) for d in directions.tolist())
        normals = np.array([hit.n if hit.is_valid() else (0, 0, 0) for hit in hits])
    else:
        origin = mi.Point3f(*camera.eye.tolist())
        hit = scene.ray_intersect(mi.Ray3f(origin, mi.Vector3f(directions.T)))
        normals = np.where(np.array(hit.is_valid())[:, None], np.array(hit.n).T, 0)
    away = (normals * directions).sum(axis=-1, keepdims=True) > 0
    turned: npt.NDArray[np.float32] = np.where(away, -normals, normals).astype(np.float32)
    return turned.reshape(shape)


def _render_film(mi: ModuleType, scene: Any, batches: int, seed: int, per_batch: int) -> _Estimate:
    height, width = (int(n) for n in reversed(scene.sensors()[0].film().size()))
    moments = _Moments((height, width, 3))
    mask = np.zeros((height, width), dtype=bool)
    for batch in range(batches):
        pixels = np.array(mi.render(scene, spp=per_batch, seed=seed * batches + batch))
        moments.add(np.broadcast_to(pixels[..., :-1], (height, width, 3)).astype(np.float64))
        mask |= pixels[..., -1] > 0
    return moments.mean, moments.variance_of_mean(), mask
