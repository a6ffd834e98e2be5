"""The methods: one frozen dataclass each, holding its parameters, and a table of their names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, TypeAlias

from softshadow.map_methods import DeepShadow, Mlsm, Mtsm, Mvsm, Pcf, Slsm
from softshadow.method import Method

__all__ = [
    "Accumulation",
    "Convolution",
    "DeepShadow",
    "Hard",
    "Method",
    "MethodLike",
    "Mlsm",
    "Mtsm",
    "Mvsm",
    "Pcf",
    "RayTraced",
    "ShadowVolume",
    "SingleSample",
    "Slsm",
    "Ssoc",
    "Wedges",
    "method_names",
    "resolve",
]


@dataclass(frozen=True)
class Accumulation(Method):
    """Averaged hard-shadow textures (Herf and Heckbert 1996).

    Every receiver polygon (coplanar connected triangles of a mesh) has a texture: the mean of the
    hard shadows from points of the light, drawn by flattening the occluders onto the polygon. At
    texels' centres that is `RayTraced` with ``pattern="fixed"`` and the same samples and seed;
    pictures interpolate between them. See ``docs/methods/accumulation.md``, and `bake` for the
    textures themselves.

    Parameters
    ----------
    samples : int
        Light points, 1 to 65536: a texture has ``samples + 1`` levels. Powers of two are stratified
        best.
    seed : int
        Of the light points, 0 to 2**64 - 1.
    texture : {"radiance", "modulation", "eight_bit"}
        Whether textures hold the irradiance from every light point, with its own cosines and
        distance; only the fraction of points that is seen, the unshadowed light coming from its
        closed form; or that fraction in eight bits, drawn by adding ``(256 - a) / samples`` for
        every point seen (`samples` must divide ``256 - a``, ``a = round(256 ambient)``).
    ambient : float
        What textures hold without any light: a level of modulation, 0 to 1, or of a radiance
        texture the radiance that comes from everywhere. Only in the textures of `bake`, not in
        pictures.
    texel : float, optional
        World size of a texel; by default the scene's largest extent over `max_size`. Textures have
        powers of two as sides, so texels are up to twice as small.
    max_size : int
        Most texels along a side, a power of two up to 8192 (the paper: 256).
    interpolation : {"linear", "nearest"}
        Whether pictures interpolate between the four texels around a pixel.
    memory_limit : float
        Bytes that textures may take; more is an error before any is taken.
    opacity : {"opaque"}, optional
        ``"opaque"`` lets every mesh with an opacity above 0 block all light. Without, each crossing
        multiplies transmittance.
    """

    samples: int = 128
    seed: int = 0
    texture: Literal["radiance", "modulation", "eight_bit"] = "radiance"
    ambient: float = 0.0
    texel: float | None = None
    max_size: int = 1024
    interpolation: Literal["linear", "nearest"] = "linear"
    memory_limit: float = 4e9
    opacity: Literal["opaque"] | None = None

    name: ClassVar[str] = "accumulation"
    transparent: ClassVar[bool] = True


@dataclass(frozen=True)
class Convolution(Method):
    """Hard-shadow textures convolved with the light's image (Soler and Sillion 1998).

    Exact, to a texel, where the light, what casts and the receiver lie in parallel planes; see
    ``docs/methods/convolution.md`` for where it is wrong. Receivers are polygons, as of
    `Accumulation`.

    Parameters
    ----------
    error : float
        The hard shadow is split by the depth of what casts it until no part puts visibility before
        a straight edge off by more than this; above 0, at most 1. With 1 every receiver takes the
        average depth of all that casts on it.
    texel : float, optional
        World size of a texel; by default the scene's largest extent over `max_size`.
    max_size : int
        Most texels along a side, a power of two up to 8192.
    interpolation : {"linear", "nearest"}
        Whether pictures interpolate between the four texels around a pixel.
    memory_limit : float
        Bytes that textures may take; more is an error before any is taken.
    opacity : {"opaque"}, optional
        ``"opaque"`` lets every mesh with an opacity above 0 block all light; without, transparent
        meshes that cast are an error.
    """

    error: float = 0.05
    texel: float | None = None
    max_size: int = 512
    interpolation: Literal["linear", "nearest"] = "linear"
    memory_limit: float = 4e9
    opacity: Literal["opaque"] | None = None

    name: ClassVar[str] = "convolution"


@dataclass(frozen=True)
class Hard(Method):
    """Hard shadows: one shadow ray to the light's centre.

    Visibility is the transmittance along that ray, capped by the part of the light above the
    receiver's tangent plane.
    """

    name: ClassVar[str] = "hard"
    transparent: ClassVar[bool] = True
    points: ClassVar[bool] = True


@dataclass(frozen=True)
class RayTraced(Method):
    """The reference: stratified light samples traced against a bounding volume hierarchy.

    Parameters
    ----------
    samples : int
        Light samples per receiver, 1 to 65536. Powers of two are stratified best.
    seed : int
        Of the light samples, 0 to 2**64 - 1. Same seed, same bits.
    pattern : {"per_receiver", "fixed"}
        Whether every receiver has its own scrambling of the light samples (noise), or all share
        the same light points (banding, and the light points that the shadow-map methods use).
    cull : bool
        Settle groups of light samples that no silhouette edge separates with one ray. The result
        is the same to the last bit; ``False`` traces every sample, to measure what it gains.
    """

    samples: int = 256
    seed: int = 0
    pattern: Literal["per_receiver", "fixed"] = "per_receiver"
    cull: bool = True

    name: ClassVar[str] = "ray_traced"
    transparent: ClassVar[bool] = True
    points: ClassVar[bool] = True


@dataclass(frozen=True)
class ShadowVolume(Method):
    """Hard shadows by shadow volumes: layers between light and surface, counted along view rays.

    The case of a light of radius zero of `Wedges`: visibility of the light's centre.

    Parameters
    ----------
    counting : {"zpass", "zfail"}
        Whether layers are counted from the eye, starting with those over it, or from behind the
        surface, the volumes closed by caps. Both are right for a viewer in shadow.
    opacity : {"opaque"}, optional
        ``"opaque"`` lets every mesh with an opacity above 0 block all light; without, transparent
        meshes that cast are an error.
    cull : bool
        Skip what cannot reach a tile of the image; ``False`` measures what that gains.
    """

    counting: Literal["zpass", "zfail"] = "zpass"
    opacity: Literal["opaque"] | None = None
    cull: bool = True

    name: ClassVar[str] = "shadow_volume"


@dataclass(frozen=True)
class SingleSample(Method):
    """Single sample soft shadows (Parker, Shirley and Smits 1998).

    One shadow ray to the light's centre, against occluders that are wrapped in larger outer objects
    with soft edges. Little dearer than hard shadows, continuous in space and time, and with
    penumbrae that grow from zero at a contact; the umbra is too large, and the shadows of small
    things are too dark. See ``docs/methods/single_sample.md``.

    Parameters
    ----------
    falloff : {"light", "linear", "smooth"}
        How visibility falls off from the outer to the inner object: by the area of a disk beyond a
        line, in closed form; linearly; or as ``3 t**2 - 2 t**3`` (the paper).
    overlap : {"minimum", "multiply", "add"}
        How the shadows of different objects combine: the darkest counts (the paper), what they
        leave visible is multiplied, or what they hide is added.
    parts : {"objects", "triangles"}
        What ``"multiply"`` and ``"add"`` take for an object: a connected mesh or a sphere, or every
        triangle (then fine meshes come out too dark). ``"minimum"`` is the same for both.
    opacity : {"opaque"}, optional
        ``"opaque"`` lets every mesh with an opacity above 0 block all light; without, transparent
        meshes that cast are an error.
    """

    falloff: Literal["light", "linear", "smooth"] = "light"
    overlap: Literal["minimum", "multiply", "add"] = "minimum"
    parts: Literal["objects", "triangles"] = "objects"
    opacity: Literal["opaque"] | None = None

    name: ClassVar[str] = "single_sample"
    points: ClassVar[bool] = True


@dataclass(frozen=True)
class Ssoc(Method):
    """The soft shadow occlusion camera (Mo, Popescu and Wyman 2007).

    A shadow map from the light's centre and two distortion maps beside it, which say for every
    texel which silhouette edge is nearest: a receiver's place in that edge's penumbra is how far it
    has to be moved in the map to be seen. Fast, and for lights that are small against their
    distance; see ``docs/methods/ssoc.md`` for where it is wrong.

    Parameters
    ----------
    resolution : int
        Texels along the longer side of each map, 16 to 16384.
    steps : int
        Distortions tried for a receiver, 1 to 8, so that penumbrae that overlap combine; 1 is the
        paper's naive lookup.
    falloff : {"light", "linear", "smooth"}
        How visibility falls off across a penumbra: by the area of the light beyond a line, in
        closed form; linearly; or as ``3 s**2 - 2 s**3`` (the paper).
    interpolate : bool
        Interpolate the lookups from the four texels around a receiver, as the paper; ``False``
        takes the one that it lies in.
    thin : bool
        Look for light past the other side of occluders that are thinner than the penumbra (not in
        the paper's method; a wider search, as its Section 6 suggests).
    distorted : bool
        Compare distorted receivers with what the camera's distorted rays see (the reference image
        of the paper's Section 4), instead of with what the shadow map has at the distorted place.
        Removes false umbrae where what lies behind an edge varies quickly in depth, and takes most
        of the guessing out of points without normals; costs a ray for every texel near an edge.
    opacity : {"opaque"}, optional
        ``"opaque"`` lets every mesh with an opacity above 0 block all light; without, transparent
        meshes that cast are an error.
    """

    resolution: int = 1024
    steps: int = 3
    falloff: Literal["light", "linear", "smooth"] = "light"
    interpolate: bool = True
    thin: bool = True
    distorted: bool = False
    opacity: Literal["opaque"] | None = None

    name: ClassVar[str] = "ssoc"
    points: ClassVar[bool] = True


@dataclass(frozen=True)
class Wedges(Method):
    """Penumbra wedges (Akenine-Möller and Assarsson 2002).

    Every silhouette edge that the light's centre sees becomes a wedge in which the light fades.
    Exact where all of the light sees the same silhouette; see ``docs/methods/wedges.md`` for where
    it is wrong.

    Parameters
    ----------
    falloff : {"light", "line", "linear", "smooth"}
        How the light fades across a wedge. ``"light"``: by the area of the light that the edge,
        with its ends, cuts off, in closed form. The others are the paper's interpolation between
        front, back and side planes (its equations 1 to 3), then taken as the area of the light that
        a line at that offset cuts off, as it is, or as ``3 s**2 - 2 s**3``.
    quads : int, optional
        Draw every wedge as this many quads of constant intensity (the paper's Figure 15), 1 to 256,
        instead of a falloff: cheap, with steps.
    overlap : {"multiply", "add", "minimum"}
        How the shadows of different objects (connected meshes) combine: what they leave visible is
        multiplied, what they hide is added (the paper), or the darkest counts. Overlapping shadows
        of one object are added.
    buffer : {"float", "integer"}
        Whether the light-intensity buffer holds numbers, or the paper's integers: every wedge's
        share is rounded to 1/255 (of n lights, to n/255).
    counting : {"zpass", "zfail"}
        As of `ShadowVolume`.
    vertex_angle : float
        Degrees, 1 to 180: where neighbouring silhouette edges turn by more, further wedges are set
        around their vertex (the paper's Figure 7). Not used by ``falloff="light"``.
    planes : {"tangent", "paper"}
        Whether front and back planes touch the light, or go through the paper's points ``c ± r n``
        of a sphere, which are a little inside it. Not used by ``falloff="light"``.
    opacity : {"opaque"}, optional
        As of `ShadowVolume`.
    cull : bool
        Skip what cannot reach a tile of the image or a group of its pixels; ``False`` measures what
        that gains.
    """

    falloff: Literal["light", "line", "linear", "smooth"] = "light"
    quads: int | None = None
    overlap: Literal["multiply", "add", "minimum"] = "multiply"
    buffer: Literal["float", "integer"] = "float"
    counting: Literal["zpass", "zfail"] = "zpass"
    vertex_angle: float = 30.0
    planes: Literal["tangent", "paper"] = "tangent"
    opacity: Literal["opaque"] | None = None
    cull: bool = True

    name: ClassVar[str] = "wedges"


_METHODS: dict[str, type[Method]] = {
    m.name: m
    for m in (
        Accumulation,
        Convolution,
        DeepShadow,
        Hard,
        Mlsm,
        Mtsm,
        Mvsm,
        Pcf,
        RayTraced,
        ShadowVolume,
        SingleSample,
        Slsm,
        Ssoc,
        Wedges,
    )
}

MethodLike: TypeAlias = "str | Method"
"""A method's name, or a configured method."""


def method_names() -> tuple[str, ...]:
    """Return the names that ``method=`` takes."""
    return tuple(_METHODS)


def resolve(method: MethodLike) -> Method:
    """Return the method object for a name or a configured method.

    Raises
    ------
    ValueError
        If the name is unknown.
    TypeError
        If `method` is neither a string nor a method.
    """
    if isinstance(method, str):
        try:
            return _METHODS[method]()
        except KeyError:
            names = ", ".join(_METHODS)
            raise ValueError(f"method: unknown name {method!r}; expected one of {names}") from None
    if isinstance(method, Method):
        return method
    raise TypeError(f"method: expected a name or a method object, got {type(method).__name__}")
