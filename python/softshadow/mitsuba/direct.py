"""Mitsuba beside the methods: visibility, with the time that it takes, and denoised."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from softshadow import checks
from softshadow.camera import Camera
from softshadow.extras import needs
from softshadow.light import Light, LightLike, as_lights
from softshadow.methods.base import check_parameters
from softshadow.mitsuba.bridge import scene_dict, variant_set
from softshadow.mitsuba.llvm import find_llvm
from softshadow.mitsuba.sampling import Sampled, sampled_visibility
from softshadow.parallel import thread_count
from softshadow.renderers import Rendered
from softshadow.scene import Scene

if TYPE_CHECKING:
    from types import ModuleType

__all__ = ["Direct"]

_SCALAR_LIGHT_SAMPLES = 64
"""Light samples per camera ray of the scalar variants: the fastest, as in
``benches/mitsuba_speed.py``."""


@dataclass(frozen=True)
class Direct:
    """Visibility by Mitsuba's light samples: no method, but `softshadow.sweep` takes it as one.

    A frame is what Mitsuba does: rays through the pixels' centres, a light sample and a shadow ray
    for each sample. Loading the scene is ``prepare``; a launch before it, in which kernels are
    compiled, is not counted. It runs on as many threads as `softshadow.thread_count` says.

    With `film`, and always with the scalar variants, which would take one ray at a time from
    Python, the time is that of a film by Mitsuba's own integrator: ``direct`` with light samples
    only (``volpath`` where something is translucent), on all threads, with a ray through a place of
    its own in the pixel for each stratified sample. The picture is still that of the pixels'
    centres with as many samples. That of the scalar variants comes from ``llvm_ad_mono``, which has
    the same samples, where LLVM is found; otherwise ray by ray, slowly.

    Parameters
    ----------
    variant : {"llvm_ad_mono", "llvm_ad_rgb", "scalar_rgb"}
        The LLVM ones need LLVM 19.
    samples : int
        Light samples per pixel, 1 to 65536.
    sampler : {"multijitter", "independent"}
        Mitsuba's stratified samples, for which `samples` has to be a product of two like numbers,
        or independent ones, its default.
    denoise : bool
        Whether Open Image Denoise filters the visibility, guided by the normals, free of noise, at
        the pixels' centres. (Visibility has no albedo: it is given white, which is better than the
        surfaces' own.) Its time is part of the frame.
    film : bool
        Whether a frame is what ``mitsuba.render`` takes, not shadow rays alone.
    seed : int
        Of the light samples, 0 to 2**32 - 1.

    Raises
    ------
    TypeError, ValueError
        If a parameter is of another kind or out of its range.

    Examples
    --------
    >>> import softshadow as ss
    >>> ss.mitsuba.Direct(samples=16, denoise=True).name
    'mitsuba llvm_ad_mono denoised'
    """

    variant: Literal["llvm_ad_mono", "llvm_ad_rgb", "scalar_rgb"] = "llvm_ad_mono"
    samples: int = 64
    sampler: Literal["multijitter", "independent"] = "multijitter"
    denoise: bool = False
    film: bool = False
    seed: int = 0

    def __post_init__(self) -> None:
        check_parameters(self)
        checks.integer(self.seed, "Direct.seed", 0, 2**32 - 1)

    @property
    def name(self) -> str:
        """What tables call it: all but the number of samples and the seed."""
        words = ["mitsuba", self.variant]
        words += [self.sampler] * (self.sampler != "multijitter") + ["denoised"] * self.denoise
        words += ["film"] * self.film
        return " ".join(words)

    @property
    def version(self) -> str:
        """The versions of Mitsuba, Dr.Jit and the denoiser, as far as they are used."""
        said = f"Mitsuba {version('mitsuba')}, Dr.Jit {version('drjit')}"
        if not self.denoise:
            return said
        oidn = _denoiser()
        return f"{said}, Open Image Denoise {oidn.Device(oidn.DeviceType.CPU).version}"

    def parameters(self) -> dict[str, Any]:
        """Return the parameters by name.

        Returns
        -------
        dict of str to int, bool or str
        """
        return asdict(self)

    def render(self, scene: Scene, camera: Camera, light: LightLike) -> Rendered:
        """Load the scene into Mitsuba and render its visibility.

        Parameters
        ----------
        scene : Scene
        camera : Camera
        light : light or sequence of lights
            Each in a scene of its own, so that they cast no shadows.

        Returns
        -------
        Rendered
            Its ``seconds`` have ``prepare``, ``frame``, and of the latter ``shade`` and
            ``denoise``; its ``bytes`` are None, Mitsuba does not tell.

        Raises
        ------
        ModuleNotFoundError
            If Mitsuba or the denoiser is not installed, or LLVM is not.
        ValueError
            As `scene_dict`; or if the sampler cannot have that many samples.
        """
        if not self._scalar and find_llvm() is None:
            raise ModuleNotFoundError(
                f"{self.variant} needs LLVM 19, which was not found: install libllvm19, "
                "or set DRJIT_LIBLLVM_PATH"
            )
        lights, single = as_lights(light)
        with _threads():
            found = [self._one(scene, camera, x, self.seed + i) for i, x in enumerate(lights)]
        visibility = np.array([sampled.visibility for sampled, _ in found])
        seconds = {name: sum(times[name] for _, times in found) for name in found[0][1]}
        return Rendered(visibility[0] if single else visibility, found[0][0].mask, seconds)

    @property
    def _scalar(self) -> bool:
        return self.variant.startswith("scalar")

    def _one(
        self, scene: Scene, camera: Camera, light: Light, seed: int
    ) -> tuple[Sampled, dict[str, float]]:
        """Return what is seen of one light, and the seconds by stage."""
        sampled, prepare, shade = self._picture(scene, camera, light, seed % 2**32)
        if self.film or self._scalar:
            prepare, shade = self._film_seconds(scene, camera, light, seed % 2**32)
        seconds = {"prepare": prepare, "frame": shade, "shade": shade}
        if self.denoise:
            _denoised(sampled)  # makes the filter and finds its memory
            start = time.perf_counter()
            sampled = _denoised(sampled)
            seconds["denoise"] = time.perf_counter() - start
            seconds["frame"] += seconds["denoise"]
        return sampled, seconds

    def _picture(
        self, scene: Scene, camera: Camera, light: Light, seed: int
    ) -> tuple[Sampled, float, float]:
        """Return what is seen, and the seconds of loading and of sampling."""
        vectorised = not self._scalar or find_llvm() is not None
        with variant_set("llvm_ad_mono" if self._scalar and vectorised else self.variant) as mi:
            start = time.perf_counter()
            loaded = mi.load_dict(_description(mi, scene, camera, light))
            prepare = time.perf_counter() - start
            sampler = mi.load_dict({"type": self.sampler, "sample_count": self.samples})
            if sampler.sample_count() != self.samples:
                raise ValueError(
                    f"Direct.samples: {self.sampler} cannot have {self.samples} samples, "
                    f"but {sampler.sample_count()}"
                )
            args = (mi, loaded, camera, _transparent(scene), sampler, seed)
            if vectorised:
                sampled_visibility(*args, only_first=True)  # compiles the kernels
            start = time.perf_counter()
            return sampled_visibility(*args), prepare, time.perf_counter() - start

    def _film_seconds(
        self, scene: Scene, camera: Camera, light: Light, seed: int
    ) -> tuple[float, float]:
        """Return the seconds of loading a scene, and of rendering its film."""
        rays, together = self.samples, 1
        if self.sampler == "independent" and not _transparent(scene):
            together = max(d for d in range(1, _SCALAR_LIGHT_SAMPLES + 1) if rays % d == 0)
            rays //= together
        with variant_set(self.variant) as mi:
            start = time.perf_counter()
            description = _description(mi, scene, camera, light)
            description["sensor"]["sampler"] = {"type": self.sampler, "sample_count": rays}
            if not _transparent(scene):
                description["integrator"]["emitter_samples"] = together
            loaded = mi.load_dict(description)
            prepare = time.perf_counter() - start
            # Meets cold memory, and compiles the kernels of the vectorised variants.
            mi.render(loaded, spp=1 if self._scalar else rays)
            start = time.perf_counter()
            np.array(mi.render(loaded, spp=rays, seed=seed))
            return prepare, time.perf_counter() - start


def _transparent(scene: Scene) -> bool:
    return any(entry.opacity < 1 for entry in scene.entries)


def _description(mi: ModuleType, scene: Scene, camera: Camera, light: Light) -> dict[str, Any]:
    """Return the scene's dictionary, with a film that has what the variant computes."""
    description = scene_dict(scene, camera, light)
    mono = "mono" in mi.variant()
    description["sensor"]["film"]["pixel_format"] = "luminance" if mono else "rgb"
    return description


@contextmanager
def _threads() -> Iterator[None]:
    """Give Mitsuba and the denoiser as many threads as the methods have."""
    with needs("mitsuba", "softshadow.mitsuba"):
        import drjit as dr

    before = dr.thread_count()
    dr.set_thread_count(thread_count())
    try:
        yield
    finally:
        dr.set_thread_count(before)


def _denoiser() -> ModuleType:
    with needs("denoise", "denoising"):
        import mitsuba_oidn

    module: ModuleType = mitsuba_oidn
    return module


def _denoised(sampled: Sampled) -> Sampled:
    filtered: npt.NDArray[np.float32] = np.asarray(
        _denoiser().denoise(
            sampled.visibility,
            albedo=np.ones_like(sampled.normal),
            normal=sampled.normal,
            clean_aux=True,
        )
    )
    return Sampled(np.where(sampled.mask, filtered, np.float32(1)), sampled.mask, sampled.normal)
