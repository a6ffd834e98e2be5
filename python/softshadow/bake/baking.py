"""`bake` and what it returns."""

from __future__ import annotations

import copy
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, overload

import numpy as np
import numpy.typing as npt

from softshadow import checks, images
from softshadow.arguments import Bar, Progress
from softshadow.bake.sources import (
    POINT_BYTES,
    Accumulated,
    AtPoints,
    Job,
    planar_chart,
    receiver_polygons,
    unwrapped_chart,
)
from softshadow.bake.textures import BakedTexture, Polygon, Side
from softshadow.entries import Mesh
from softshadow.light import LightLike, as_lights
from softshadow.methods import Accumulation, Method, MethodLike, resolve
from softshadow.scene import Scene, mesh_of

if TYPE_CHECKING:
    from softshadow.bake.gltf import Up

__all__ = ["Bake", "bake", "bake_layout"]


class Bake(Sequence[BakedTexture]):
    """What `bake` returns: a sequence of textures, which `Accumulation` can refine.

    A copy is independent; in it, as on the other side of a process boundary, `Accumulation` draws
    all light points again, with the same bits. It equals itself only.

    Attributes
    ----------
    method : Method
    samples : int or None
        Light points drawn so far, by `Accumulation`.
    seconds : dict
        Wall-clock seconds: ``prepare``, and ``textures`` for all that was drawn so far.
    bytes : int
        Of all textures' sums (accumulation) or of the points (other methods).
    """

    def __init__(self, job: Job, method: Method) -> None:
        self._job = job
        self._method = method
        self._known: dict[int, BakedTexture] = {}

    def __copy__(self) -> Bake:
        return copy.deepcopy(self)  # refining one would otherwise refine the other

    @property
    def method(self) -> Method:
        """The method, with the parameters that it began with."""
        return self._method

    @property
    def seconds(self) -> dict[str, float]:
        """Wall-clock seconds, by stage."""
        return dict(self._job.seconds)

    @property
    def bytes(self) -> int:
        """Of all textures' sums (accumulation) or of the points (other methods)."""
        return self._job.bytes

    @property
    def samples(self) -> int | None:
        """Light points drawn so far, by `Accumulation`."""
        return self._job.samples

    def __len__(self) -> int:
        return len(self._job)

    @overload
    def __getitem__(self, index: int) -> BakedTexture: ...

    @overload
    def __getitem__(self, index: slice) -> list[BakedTexture]: ...

    def __getitem__(self, index: int | slice) -> BakedTexture | list[BakedTexture]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        i = range(len(self))[index]
        if i not in self._known:
            self._known[i] = self._job.texture(i)
        return self._known[i]

    def __iter__(self) -> Iterator[BakedTexture]:
        return (self[i] for i in range(len(self)))

    def of(self, receiver: str) -> list[BakedTexture]:
        """Return the textures of one receiver.

        Parameters
        ----------
        receiver : str
            Name of the scene's entry.

        Returns
        -------
        list of BakedTexture

        Raises
        ------
        ValueError
            If it has none.
        """
        found = [self[i] for i in range(len(self)) if self._job.receiver(i) == receiver]
        if not found:
            raise ValueError(f"bake: no textures of {receiver!r}")
        return found

    def refine(self, samples: int | None = None, progress: Progress = False) -> None:
        """Draw more light points; what was drawn stays.

        Twice as many as before keep the stratification: of ``2 n`` points, ``n`` are those of
        ``n``. The result is that of a bake with `samples` from the start, to the bit.

        Parameters
        ----------
        samples : int, optional
            Points in all; twice as many as before when not given.
        progress : bool or callable

        Raises
        ------
        ValueError
            If the method is not `Accumulation`, the points are fewer than there are, or eight bits
            cannot be divided among so many.

        Examples
        --------
        >>> import softshadow as ss
        >>> setup = ss.scenes.half_plane(32, 24)
        >>> method = ss.Accumulation(samples=16, max_size=32)
        >>> textures = ss.bake(setup.scene, setup.light, "receiver", method)
        >>> textures.refine()
        >>> textures.samples
        32
        """
        self._job.refine(samples, progress)
        self._known.clear()

    def save(
        self,
        folder: str | os.PathLike[str],
        suffix: str = ".png",
        what: Literal["radiance", "modulation", "visibility"] = "radiance",
        exposure: float | None = None,
    ) -> list[Path]:
        """Write every texture as ``<receiver>_<number><suffix>`` into an existing folder.

        For PNGs of radiance all textures are exposed alike: by `exposure`, or by the one that suits
        the brightest of them.

        Parameters
        ----------
        folder : path
            Must exist.
        suffix : {".png", ".exr", ".npy"}
            As of `softshadow.images.write`.
        what : {"radiance", "modulation", "visibility"}
            Which of a texture's arrays.
        exposure : float, optional
            Of radiance in PNGs.

        Returns
        -------
        list of Path
            What was written.

        Raises
        ------
        ValueError, OSError
            As `softshadow.images.write`.
        """
        if what == "radiance" and exposure is None and suffix.lower() == ".png":
            exposure = self._exposure()
        written = []
        for name, texture in zip(self._names(), self, strict=True):
            path = Path(folder) / f"{name}{suffix}"
            texture.save(path, what, exposure)
            written.append(path)
        return written

    def to_glb(
        self, path: str | os.PathLike[str], exposure: float | None = None, up: Up = "z"
    ) -> None:
        """Write all textures with the triangles that they lie on as a binary glTF 2.0 file.

        Viewers, game engines and ``trimesh`` open it. Each texture becomes a mesh with a material,
        ``<receiver>_<number>``, whose base colour is the radiance, sRGB-encoded in eight bits, and
        to which viewers add no light (KHR_materials_unlit). Triangles of planar receivers are wound
        so that they are seen from the side that was baked; casters that were not baked are not in
        the file.

        Parameters
        ----------
        path : path
            Ends in ``.glb``; its folder must exist.
        exposure : float, optional
            Of all textures alike; the one that suits the brightest of them when not given.
        up : {"z", "y"}
            The scene's axis that points up. In glTF that is y; a z-up scene is turned by its nodes,
            and its vertices stay what they are.

        Raises
        ------
        ValueError
            If the file's type is another, the exposure is not positive, or `up` is none of these.
        OSError
            If the file cannot be written.

        Examples
        --------
        >>> import softshadow as ss
        >>> setup = ss.scenes.half_plane(32, 24)
        >>> textures = ss.bake(setup.scene, setup.light, max_size=32)
        >>> textures.to_glb("baked.glb")  # doctest: +SKIP
        """
        file = images.check_path(path, (".glb",))
        if up not in ("y", "z"):
            raise ValueError(f"up: expected 'y' or 'z', got {up!r}")
        from softshadow.bake.gltf import write_glb

        pieces = (
            (n, self._job.entries[t.receiver], t) for n, t in zip(self._names(), self, strict=True)
        )
        write_glb(file, pieces, self._exposure() if exposure is None else exposure, up)

    def _names(self) -> list[str]:
        digits = len(str(max(len(self) - 1, 0)))
        return [f"{_file_name(self._job.receiver(i))}_{i:0{digits}d}" for i in range(len(self))]

    def _exposure(self) -> float:
        return min((images.auto_exposure(t.radiance) for t in self), default=1.0)


def _file_name(name: str) -> str:
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in name) or "receiver"


def _names(scene: Scene, receivers: str | Sequence[str] | None) -> list[str]:
    if not isinstance(scene, Scene):
        raise TypeError(f"scene: expected softshadow.Scene, got {type(scene).__name__}")
    if receivers is None:
        names = [m.name for m in scene.meshes if m.receives]
        if not names:
            raise ValueError("scene: it has no mesh that receives")
        return names
    names = [receivers] if isinstance(receivers, str) else list(receivers)
    if not names:
        raise ValueError("receivers: expected at least one name")
    for name in names:
        if not mesh_of(scene, name).receives:
            raise ValueError(f"receivers: mesh {name!r} does not receive (receives=False)")
    return names


def _corner_uv(entry: Mesh, uv: npt.ArrayLike) -> npt.NDArray[np.float64]:
    array = checks.numbers(uv, f"uv of {entry.name!r}")
    if array.shape == (len(entry.vertices), 2):
        array = array[entry.faces]
    if array.shape != (len(entry.faces), 3, 2):
        raise ValueError(
            f"uv of {entry.name!r}: expected shape ({len(entry.vertices)}, 2), one a vertex, or "
            f"({len(entry.faces)}, 3, 2), got {np.shape(uv)}"
        )
    if not np.isfinite(array).all() or array.min() < 0 or array.max() > 1:
        raise ValueError(f"uv of {entry.name!r}: expected numbers from 0 to 1")
    return array


def _layout_method(method: Method, texel: float | None, max_size: int | None) -> Accumulation:
    layout = method if isinstance(method, Accumulation) else Accumulation(samples=1)
    if texel is not None:
        layout = replace(layout, texel=texel)
    return layout if max_size is None else replace(layout, max_size=max_size)


def bake_layout(
    scene: Scene,
    light: LightLike,
    receivers: str | Sequence[str] | None = None,
    method: MethodLike = "accumulation",
    *,
    texel: float | None = None,
    max_size: int | None = None,
    side: Side = "light",
) -> tuple[list[Polygon], int]:
    """Return what `bake` would draw on planar receivers, and its memory, without drawing it.

    Parameters
    ----------
    scene, light, receivers, method, texel, max_size, side
        As in `bake`.

    Returns
    -------
    polygons : list of Polygon
    bytes : int
        Of all textures' sums.

    Raises
    ------
    ValueError
        As `bake`; also if the textures take more than the method's `memory_limit`.
    """
    names = _names(scene, receivers)
    lights, _ = as_lights(light)
    layout = _layout_method(resolve(method), texel, max_size)
    core, polygons = receiver_polygons(scene, lights, names, layout, side, False)
    return polygons, core.bytes


def bake(
    scene: Scene,
    light: LightLike,
    receivers: str | Sequence[str] | None = None,
    method: MethodLike = "accumulation",
    *,
    uv: Mapping[str, npt.ArrayLike] | None = None,
    size: int | tuple[int, int] = 512,
    padding: int = 2,
    texel: float | None = None,
    max_size: int | None = None,
    side: Side = "light",
    progress: Progress = False,
) -> Bake:
    """Bake light and shadow into textures.

    Without texture coordinates, every connected set of coplanar triangles of a receiver has a
    texture over the parallelogram around it (Herf and Heckbert 1996). `Accumulation` draws hard
    shadows into it and averages them; other methods answer at the texels' centres.

    Parameters
    ----------
    scene : Scene
    light : light or sequence of lights
    receivers : str or sequence of str, optional
        Names of meshes; all that receive when not given.
    method : str or method
        `Accumulation`, or a method that needs no camera.
    uv : mapping of str to array_like, optional
        Texture coordinates, 0 to 1, of receivers that have their own: shape (V, 2), one a vertex,
        or (F, 3, 2), one a corner of a face. Their textures come from methods that answer at
        points; where triangles overlap in the texture, the first counts.
    size : int or pair of ints
        Width and height of textures with texture coordinates.
    padding : int
        Texels around those that triangles cover that repeat the nearest, so that interpolation
        does not reach what is empty.
    texel, max_size
        Texel size in world units and most texels along a side of planar receivers; those of
        `Accumulation` when not given.
    side : {"light", "front", "back"}
        Which side of planar receivers: the one that more of the lights' centres are on, or the one
        that is wound counterclockwise, or the other. Meshes with `uv` have their front baked.
    progress : bool or callable
        ``True`` for a progress bar, or a function that is told the finished fraction.

    Returns
    -------
    Bake

    Raises
    ------
    ValueError
        If a name is unknown or not of a mesh that receives, texture coordinates do not fit, the
        method needs a camera, or the textures take more memory than `Accumulation.memory_limit`.

    Examples
    --------
    >>> import softshadow as ss
    >>> setup = ss.scenes.half_plane(32, 24)
    >>> textures = ss.bake(setup.scene, setup.light, "receiver", max_size=32)
    >>> textures[0].radiance.shape
    (32, 32, 3)
    """
    chosen = resolve(method)
    names = _names(scene, receivers)
    lights, single = as_lights(light)
    own = dict(uv or {})
    for name in own:
        if name not in names:
            raise ValueError(f"uv: {name!r} is not among the receivers {names}")
    layout = _layout_method(chosen, texel, max_size)
    given: LightLike = lights[0] if single else lights
    if isinstance(chosen, Accumulation):
        if own:
            raise ValueError(
                "uv: accumulation bakes planar polygons with a layout of their own; bake meshes "
                "with texture coordinates by a method that answers at points, such as ray_traced"
            )
        return Bake(Accumulated(scene, given, names, layout, side, progress), layout)
    if not chosen.points:
        raise ValueError(f"method {chosen.name!r} needs a camera and cannot bake")
    width, height = checks.size(size, "size", 65536)
    padding = checks.integer(padding, "padding", 0, 65536)
    unwrapped = {name: _corner_uv(mesh_of(scene, name), own[name]) for name in own}
    planar = [name for name in names if name not in own]
    bar = Bar(progress, "bake")
    with bar:
        core, polygons = None, list[Polygon]()
        if planar:
            first = bar.part(0, 0.1, "bake: layout")
            core, polygons = receiver_polygons(scene, lights, planar, layout, side, first)
        texels = sum(p.size[0] * p.size[1] for p in polygons) + len(own) * width * height
        if POINT_BYTES * texels > layout.memory_limit:
            raise ValueError(
                f"bake: {texels} texels take {POINT_BYTES * texels / 1e9:.2f} GB, more than "
                f"{layout.memory_limit / 1e9:.2f} GB; a larger texel or a smaller size takes less"
            )
        charts = [planar_chart(p, core.mask(i)) for i, p in enumerate(polygons) if core is not None]
        for name, corners in unwrapped.items():
            mesh = mesh_of(scene, name)
            charts.append(unwrapped_chart(mesh, corners, (width, height), padding))
        return Bake(AtPoints(scene, given, charts, chosen, bar.part(0.1, 1, "bake")), chosen)
