"""Whether an image has the mean that Mitsuba samples: its ray offset, and a test of every pixel.

The test is Mitsuba's own for its renders: a z-test on mean and variance with Šidák's correction for
the number of pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from softshadow import checks
from softshadow.camera import Camera
from softshadow.entries import Mesh
from softshadow.extras import needs
from softshadow.light import Light, LightLike
from softshadow.methods import RayTraced
from softshadow.render import Image, prepare, render
from softshadow.scene import Scene

if TYPE_CHECKING:
    from softshadow.mitsuba.image import MitsubaImage

__all__ = ["RayOffset", "ZTest", "ray_offset", "sidak", "unshadowed", "z_test"]

_RAY_EPSILON = 1500 * 2.0**-24
"""How far off the surface Mitsuba starts its rays, over ``1 + max|p|`` (``math::RayEpsilon`` in
single precision)."""

_CONTACT = 0.02
"""Share of the unshadowed radiance by which lifting the receiver that far may change a pixel before
it counts as in contact: beyond, the change is a jump over an occluder rather than a slope."""


@dataclass(frozen=True, eq=False)
class RayOffset:
    """What `ray_offset` returns.

    Attributes
    ----------
    change : ndarray, shape (H, W), float64
        Radiance that a pixel gains if its receiver is lifted along its normal by Mitsuba's ray
        offset, over its unshadowed radiance; 0 where nothing was hit.
    contact : ndarray, shape (H, W), bool
        Pixels where lifting by the offset, or twice the offset (single precision adds some),
        changes more than 0.02: below feet, in the seams between walls and ground, on double walls.
        Leave them out.
    """

    change: npt.NDArray[np.float64]
    contact: npt.NDArray[np.bool_]

    def lift(self, radiance: npt.ArrayLike, unshadowed: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return an image's radiance with its receivers lifted.

        Parameters
        ----------
        radiance, unshadowed : array_like, shape (H, W, 3)
            With and without occluders (see `unshadowed`).

        Returns
        -------
        ndarray, shape (H, W, 3), float64
        """
        change = self.change[..., None] * checks.numbers(unshadowed, "unshadowed")
        lifted: npt.NDArray[np.float64] = checks.numbers(radiance, "radiance") + change
        return np.maximum(lifted, 0)


@dataclass(frozen=True, eq=False)
class ZTest:
    """What `z_test` returns.

    Attributes
    ----------
    z : ndarray, shape (H, W), float64
        Deviation (image minus reference) in standard errors, of the channel where it is largest;
        0 where not tested.
    p_value : ndarray, shape (H, W), float64
        Chance of a deviation at least this large if both have the same mean; 1 where not tested.
    threshold : float
        The p-value below which a pixel fails: `alpha`, corrected for the number of pixels.
    pixels : int
        Pixels tested.
    failures : int
        Pixels below the threshold.
    largest : float
        Largest absolute deviation in radiance among the tested pixels.
    mean : float
        Mean deviation in radiance over the tested pixels.
    mean_z : float
        That mean in standard errors; far more sensitive to an overall bias than any single pixel.
    passed : bool
        Whether no pixel fails.
    """

    z: npt.NDArray[np.float64]
    p_value: npt.NDArray[np.float64]
    threshold: float
    pixels: int
    failures: int
    largest: float
    mean: float
    mean_z: float

    @property
    def passed(self) -> bool:
        """Whether no pixel fails."""
        return self.failures == 0


def ray_offset(scene: Scene, image: Image, light: Light, samples: int = 1024) -> RayOffset:
    """Return what Mitsuba's ray offset does to every pixel, found with our own rays.

    Its shadow rays start ``8.9e-5 · (1 + max|p|)`` off the surface: nearer occluders are not seen,
    and the edges of all shadows are where they would be on a receiver that lies higher by as much.
    In a city of two units, where a house is 0.02 units high, that is seen in the mean of a picture.

    Parameters
    ----------
    scene : Scene
    image : Image
        Of that scene; gives the receivers.
    light : RectLight, DiskLight, SphereLight, PolygonLight or DistantLight
    samples : int
        Light samples per receiver and position.

    Returns
    -------
    RayOffset
    """
    points, normals = image.position[image.mask], image.normal[image.mask]
    lift = _RAY_EPSILON * (1 + np.abs(points).max(axis=-1, keepdims=True)) * normals
    prepared = prepare(scene, light, RayTraced(samples=samples))
    seen = [prepared.visibility(points + k * lift, normals).astype(np.float64) for k in (0, 1, 2)]
    above = prepare(_without_occluders(scene), light, "hard").visibility(points, normals)
    change, twice = (
        np.divide(s - seen[0], above, out=np.zeros_like(s), where=above > 0) for s in seen[1:]
    )
    result = RayOffset(np.zeros(image.mask.shape), np.zeros(image.mask.shape, dtype=bool))
    result.change[image.mask] = change
    result.contact[image.mask] = np.maximum(abs(change), abs(twice)) > _CONTACT
    return result


def unshadowed(scene: Scene, camera: Camera, light: LightLike) -> npt.NDArray[np.float64]:
    """Return the radiance without occluders, in closed form.

    Parameters
    ----------
    scene : Scene
    camera : Camera
    light : light or sequence of lights

    Returns
    -------
    ndarray, shape (H, W, 3), float64
        Linear RGB.
    """
    return render(_without_occluders(scene), camera, light, "hard").radiance.astype(np.float64)


def _without_occluders(scene: Scene) -> Scene:
    bare = Scene()
    for entry in scene.entries:
        if isinstance(entry, Mesh):
            name = bare.add((entry.vertices, entry.faces), entry.name, entry.albedo, casts=False)
            bare.set_transform(name, entry.transform)
        else:
            bare.add_spheres(entry.centers, entry.radii, entry.name, entry.albedo, casts=False)
    return bare


def sidak(alpha: float, tests: int) -> float:
    """Return the level of each of `tests` independent tests whose joint level is `alpha`.

    Parameters
    ----------
    alpha : float
        The joint level, 0 to 1.
    tests : int

    Returns
    -------
    float
    """
    return float(-np.expm1(np.log1p(-alpha) / max(tests, 1)))


def z_test(
    image: npt.ArrayLike,
    reference: MitsubaImage,
    own_variance: npt.ArrayLike | None = None,
    mask: npt.NDArray[np.bool_] | None = None,
    alpha: float = 0.01,
    unshadowed: npt.ArrayLike | None = None,
) -> ZTest:
    """Test at every pixel whether an image has the mean that Mitsuba samples.

    The deviation is divided by its standard error and held against Student's t distribution, at a
    level that the Šidák correction makes `alpha` for all pixels together. (Channels see the same
    samples, so the worst one counts as one test.)

    Sampled variances miss rare events: a pixel of which 0.1 % of the light is hidden mostly comes
    out with none of its samples blocked and a variance near zero. Given `unshadowed`, the variance
    is no less than that of a blocked-or-not sample with the image's own share ``v`` of unshadowed
    radiance, and the standard error has Bernstein's term for bounded samples where ``0 < v < 1``,
    ``sqrt(variance + unshadowed · |deviation| / (3 · samples))``. Both vanish as samples grow.

    Parameters
    ----------
    image : array_like, shape (H, W, 3)
        Radiance.
    reference : MitsubaImage
    own_variance : array_like, shape (H, W, 3), optional
        Variance of the image's own mean; 0 when not given.
    mask : ndarray, shape (H, W), bool, optional
        Pixels to test; by default those where `reference` hit a surface.
    alpha : float
        Chance that any pixel fails although both agree, 0 to 1.
    unshadowed : array_like, shape (H, W, 3), optional
        Radiance without occluders.

    Returns
    -------
    ZTest

    Raises
    ------
    ValueError
        If shapes differ or no pixel is left to test.
    """
    with needs("mitsuba", "z_test"):
        from scipy.stats import t as student

    own = checks.numbers(image, "image")
    if own.shape != reference.radiance.shape:
        raise ValueError(f"image: expected shape {reference.radiance.shape}, got {own.shape}")
    tested = reference.mask if mask is None else np.asarray(mask, dtype=bool)
    pixels = int(np.count_nonzero(tested))
    if not pixels:
        raise ValueError("mask: no pixel to test")
    deviation = own - reference.radiance
    variance = reference.variance.copy()
    if unshadowed is not None:
        full = checks.numbers(unshadowed, "unshadowed")
        share = np.clip(np.divide(own, full, out=np.zeros_like(own), where=full > 0), 0, 1)
        partly = (share > 0) & (share < 1)
        variance = np.maximum(variance, share * (1 - share) * full**2 / reference.samples)
        variance += np.where(partly, full * np.abs(deviation) / (3 * reference.samples), 0)
    if own_variance is not None:
        variance += checks.numbers(own_variance, "own_variance")
    # Mitsuba's radiance is in single precision; a dozen operations leave a few ulps of it.
    error = np.sqrt(variance) + 2.0**-21 * np.abs(own)
    z = np.divide(deviation, error, out=np.zeros_like(own), where=error > 0)
    z[(error == 0) & (deviation != 0)] = np.inf
    z[~tested] = 0
    worst = np.take_along_axis(z, np.abs(z).argmax(axis=-1)[..., None], axis=-1)[..., 0]
    p_value = 2 * student.sf(np.abs(worst), reference.batches - 1)
    threshold = sidak(alpha, pixels)
    difference = deviation[tested].mean(axis=-1)
    mean_error = np.sqrt(error[tested].max(axis=-1) ** 2 @ np.ones(pixels)) / pixels
    mean = float(difference.mean())
    return ZTest(
        z=worst,
        p_value=p_value,
        threshold=threshold,
        pixels=pixels,
        failures=int(np.count_nonzero(p_value[tested] < threshold)),
        largest=float(np.abs(deviation[tested]).max()),
        mean=mean,
        mean_z=float(mean / mean_error) if mean_error > 0 else 0.0,
    )
