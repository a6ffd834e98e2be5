"""Visibility by Mitsuba's scene, light samples and rays: what its ``direct`` integrator weights.

Radiance over unshadowed radiance is not visibility: it weights the light's points by cosines and
distances, by which the two differ by 0.01 to 0.03 (root mean square) under lights as wide as a half
of their distance. So the samples are counted here, uniform in area (of spheres: in solid angle), as
`softshadow.render` defines visibility.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from softshadow.camera import Camera

if TYPE_CHECKING:
    from types import ModuleType

__all__ = ["Sampled", "launches", "sampled_visibility"]

_LAUNCH = 1 << 20
"""Shadow rays in one launch, at least a picture of them: its overhead of a millisecond is small
beside a million rays, and they take some 100 MB."""


@dataclass(frozen=True, eq=False)
class Sampled:
    """What `sampled_visibility` returns.

    Attributes
    ----------
    visibility : ndarray, shape (H, W), float32
        1 where nothing was hit.
    mask : ndarray, shape (H, W), bool
    normal : ndarray, shape (H, W, 3), float32
        Turned to the camera; 0 where nothing was hit.
    """

    visibility: npt.NDArray[np.float32]
    mask: npt.NDArray[np.bool_]
    normal: npt.NDArray[np.float32]


def launches(samples: int, pixels: int) -> int:
    """Return how many launches a picture takes, which divides its samples.

    Parameters
    ----------
    samples, pixels : int
    """
    most = max(1, _LAUNCH // pixels)
    return min(n for n in range(1, samples + 1) if samples % n == 0 and samples // n <= most)


def sampled_visibility(
    mi: ModuleType,
    scene: Any,
    camera: Camera,
    transparent: bool,
    sampler: Any,
    seed: int,
    only_first: bool = False,
) -> Sampled:
    """Sample the visibility of a scene's only light at every pixel's centre.

    Parameters
    ----------
    mi : module
        Mitsuba, with the scene's variant set.
    scene : mitsuba.Scene
    camera : Camera
    transparent : bool
        Whether opacities below 1 are honoured, at every crossing; it takes longer.
    sampler : mitsuba.Sampler
        With as many samples as a pixel is to have.
    seed : int
    only_first : bool
        Stop after the first launch: what compiles all that there is.
    """
    if mi.variant().startswith("scalar"):
        return _one_by_one(mi, scene, camera, transparent, sampler, seed)
    import drjit as dr

    samples, pixels = sampler.sample_count(), camera.width * camera.height
    directions = mi.Vector3f(camera.rays().reshape(-1, 3).T.astype(np.float32))
    hit = _first_hit(mi, scene, mi.Ray3f(mi.Point3f(*camera.eye.tolist()), directions))
    valid = hit.is_valid()
    normal = mi.Normal3f(dr.select(dr.dot(hit.n, directions) > 0, -hit.n, hit.n))
    point = hit.p
    dr.eval(point, normal, valid)
    count = launches(samples, pixels)
    together = samples // count
    sampler.set_samples_per_wavefront(together)
    sampler.seed(seed, pixels * together)
    pixel = dr.arange(mi.UInt32, pixels * together) // together
    total = dr.zeros(mi.Float, pixels)
    for _ in range(1 if only_first else count):
        seen = _seen(
            mi,
            scene,
            dr.gather(mi.Point3f, point, pixel),
            dr.gather(mi.Normal3f, normal, pixel),
            dr.gather(mi.Bool, valid, pixel),
            sampler.next_2d(),
            transparent,
        )
        total += dr.block_sum(seen, together)
        sampler.advance()
        sampler.schedule_state()
        dr.eval(total)
    shape = (camera.height, camera.width)
    mask = np.array(valid, dtype=bool).reshape(shape)
    mean = np.array(total, dtype=np.float32).reshape(shape) / np.float32(samples)
    normals = np.array(normal, dtype=np.float32).T.reshape(*shape, 3) * mask[..., None]
    return Sampled(np.where(mask, mean, np.float32(1)), mask, np.ascontiguousarray(normals))


def _one_by_one(
    mi: ModuleType, scene: Any, camera: Camera, transparent: bool, sampler: Any, seed: int
) -> Sampled:
    """Sample with a scalar variant, which takes one ray at a time."""
    shape = (camera.height, camera.width)
    eye, directions = mi.Point3f(camera.eye.tolist()), camera.rays()
    result = Sampled(
        np.ones(shape, dtype=np.float32),
        np.zeros(shape, dtype=bool),
        np.zeros((*shape, 3), dtype=np.float32),
    )
    samples = sampler.sample_count()
    for number, (y, x) in enumerate(np.ndindex(shape)):
        direction = directions[y, x].tolist()
        hit = _first_hit(mi, scene, mi.Ray3f(eye, direction))
        if not hit.is_valid():
            continue
        normal = hit.n if np.dot(hit.n, direction) <= 0 else -hit.n
        sampler.seed(seed + number)
        total = 0.0
        for _ in range(samples):
            total += _seen(mi, scene, hit.p, normal, True, sampler.next_2d(), transparent)
            sampler.advance()
        result.visibility[y, x] = total / samples
        result.mask[y, x] = True
        result.normal[y, x] = normal
    return result


def _first_hit(mi: ModuleType, scene: Any, ray: Any) -> Any:
    """Return where rays meet a surface; lights are not seen, at neither of their sides."""
    import drjit as dr

    hit = scene.ray_intersect(ray)
    for _ in range(2):
        light = hit.is_valid() & (hit.emitter(scene) != None)  # noqa: E711 - of many at once
        behind = scene.ray_intersect(hit.spawn_ray(ray.d), light)
        hit = dr.select(light, behind, hit)
    return hit


def _seen(
    mi: ModuleType,
    scene: Any,
    point: Any,
    normal: Any,
    active: Any,
    sample: Any,
    transparent: bool,
) -> Any:
    """Return the transmittance to the light's point that a sample picks, 0 where it faces away."""
    import drjit as dr

    receiver = dr.zeros(mi.Interaction3f)
    receiver.p, receiver.n = point, normal
    light, _ = scene.sample_emitter_direction(receiver, sample, False, active)
    active = active & (dr.dot(light.d, light.n) < 0) & (dr.dot(light.d, normal) > 0)
    ray = receiver.spawn_ray_to(light.p)
    if not transparent:
        seen = dr.select(scene.ray_test(ray, active), mi.Float(0), mi.Float(1))
        return dr.select(active, seen, mi.Float(0))

    def cross(through: Any, ray: Any, active: Any) -> tuple[Any, Any, Any]:
        hit = scene.ray_intersect(ray, active)
        active = active & hit.is_valid()
        if active is False:  # a scalar variant's, which has no surface to ask
            return through, ray, active
        left = through * hit.bsdf().eval_null_transmission(hit, active)[0]
        through = dr.select(active, left, through)
        return through, hit.spawn_ray_to(light.p), active & (through > 0)

    def going(through: Any, ray: Any, active: Any) -> Any:
        return active

    through = dr.while_loop((mi.Float(1), ray, active), going, cross)[0]
    return dr.select(active, through, mi.Float(0))
