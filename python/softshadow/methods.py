"""The methods: one frozen dataclass each, holding its parameters, and a table of their names."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Literal, TypeAlias

from softshadow import _core


@dataclass(frozen=True)
class Method:
    """What all methods share; not itself a method."""

    name: ClassVar[str]
    """The name that ``method=`` takes."""
    transparent: ClassVar[bool] = False
    """Whether opacities below 1 are honoured."""
    points: ClassVar[bool] = False
    """Whether it answers at a user's own points, without a camera."""
    needs_area: ClassVar[bool] = False
    """Whether a light of size zero is an error."""

    def parameters(self) -> dict[str, Any]:
        """Return the parameters by name."""
        return asdict(self)

    def _to_core(self) -> _core.Method:
        raise TypeError(f"{type(self).__name__} cannot be rendered")


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

    def _to_core(self) -> _core.Method:
        return _core.Method.accumulation(self)


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

    def _to_core(self) -> _core.Method:
        return _core.Method.convolution(self)


@dataclass(frozen=True)
class Hard(Method):
    """Hard shadows: one shadow ray to the light's centre.

    Visibility is the transmittance along that ray, capped by the part of the light above the
    receiver's tangent plane.
    """

    name: ClassVar[str] = "hard"
    transparent: ClassVar[bool] = True
    points: ClassVar[bool] = True

    def _to_core(self) -> _core.Method:
        return _core.Method.hard()


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

    def _to_core(self) -> _core.Method:
        return _core.Method.ray_traced(self.samples, self.seed, self.pattern, self.cull)


@dataclass(frozen=True)
class Mvsm(Method):
    """Ray-traced multi-view shadow maps (Agrawala, Ramamoorthi, Heirich and Moll 2000).

    Shadow maps from the light's centre and its corners; what of a ray one of them does not see is
    followed through the next. See ``docs/methods/mvsm.md``.

    Parameters
    ----------
    resolution : int
        Texels along the longer side of each map, 16 to 16384.
    views : int
        Points of the light that maps are drawn from, 1 to 9: its centre, four corners, and the
        middles of its sides.
    samples : int
        Light samples per receiver, 1 to 65536.
    seed : int
        Of the light samples, 0 to 2**64 - 1.
    gap : float, optional
        Largest difference of depth between neighbouring texels that counts as one surface, world
        units. By default two texels' width.
    bias : float, optional
        How far off their receiver rays start, world units. By default three texels' width.
    opacity : {"opaque"}, optional
        ``"opaque"`` lets every mesh with an opacity above 0 block all light; without, transparent
        meshes that cast are an error.
    """

    resolution: int = 1024
    views: int = 5
    samples: int = 256
    seed: int = 0
    gap: float | None = None
    bias: float | None = None
    opacity: Literal["opaque"] | None = None

    name: ClassVar[str] = "mvsm"
    points: ClassVar[bool] = True

    def _to_core(self) -> _core.Method:
        return _core.Method.mvsm(self)


@dataclass(frozen=True)
class Pcf(Method):
    """Percentage-closer soft shadows, the *Antz* method (in Xie, Tabellion and Pearce 2007).

    A shadow map filtered as widely as the light is seen past what it holds: a first pass over the
    region that can hide the light finds the blockers' depth, a second one counts in the region that
    follows from it. Fast, and wrong by more the larger the light; see ``docs/methods/pcf.md``.

    Parameters
    ----------
    resolution : int
        Texels along the longer side of each map, 16 to 16384.
    layers : int
        Depths kept a texel, 1 to 64; each layer is filtered at its own blockers' depth.
    samples : int
        Light samples per receiver in each pass, 1 to 65536.
    seed : int
        Of the light samples, 0 to 2**64 - 1.
    estimate : {"nearest", "mean"}
        Which depth stands for all blockers: the one nearest to the light (the paper), or the mean
        of their inverse depths.
    bias : float, optional
        How far above a receiver's tangent plane blockers have to be, world units; without a normal,
        how much nearer to the light. By default a texel's width at the receiver.
    opacity : {"opaque"}, optional
        ``"opaque"`` lets every mesh with an opacity above 0 block all light; without, transparent
        meshes that cast are an error.
    """

    resolution: int = 1024
    layers: int = 1
    samples: int = 64
    seed: int = 0
    estimate: Literal["nearest", "mean"] = "nearest"
    bias: float | None = None
    opacity: Literal["opaque"] | None = None

    name: ClassVar[str] = "pcf"
    points: ClassVar[bool] = True

    def _to_core(self) -> _core.Method:
        return _core.Method.pcf(self)


@dataclass(frozen=True)
class DeepShadow(Method):
    """Deep shadow maps (Lokovic and Veach 2000), filtered as `Pcf` filters depths.

    Every texel holds how the light fades with depth along its ray: for fur, and for what is
    translucent. See ``docs/methods/deep.md``.

    Parameters
    ----------
    resolution : int
        Texels along the longer side of each map, 16 to 16384.
    layers : int
        Vertices kept of a texel's fading, 1 to 64.
    samples : int
        Light samples per receiver in each pass, 1 to 65536.
    seed : int
        Of the light samples, 0 to 2**64 - 1.
    error : float
        Largest error of a texel's visibility that leaving vertices out may make, 0 to 1; more where
        they are too many for `layers`.
    estimate, bias
        As of `Pcf`.
    """

    resolution: int = 1024
    layers: int = 8
    samples: int = 64
    seed: int = 0
    error: float = 0.02
    estimate: Literal["nearest", "mean"] = "nearest"
    bias: float | None = None

    name: ClassVar[str] = "deep"
    transparent: ClassVar[bool] = True
    points: ClassVar[bool] = True

    def _to_core(self) -> _core.Method:
        return _core.Method.deep(self)


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

    def _to_core(self) -> _core.Method:
        return _core.Method.shadow_volume(self.counting, self.opacity, self.cull)


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

    def _to_core(self) -> _core.Method:
        return _core.Method.single_sample(self)


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
    opacity : {"opaque"}, optional
        ``"opaque"`` lets every mesh with an opacity above 0 block all light; without, transparent
        meshes that cast are an error.
    """

    resolution: int = 1024
    steps: int = 3
    falloff: Literal["light", "linear", "smooth"] = "light"
    interpolate: bool = True
    thin: bool = True
    opacity: Literal["opaque"] | None = None

    name: ClassVar[str] = "ssoc"
    points: ClassVar[bool] = True

    def _to_core(self) -> _core.Method:
        return _core.Method.ssoc(self)


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

    def _to_core(self) -> _core.Method:
        return _core.Method.wedges(self)


@dataclass(frozen=True)
class Slsm(Method):
    """Ray-traced single-layer shadow maps (Xie, Tabellion and Pearce 2007, Section 4).

    One shadow map, drawn from behind the light; segments from a receiver to points of the light are
    traced through it. What the first surface hides from the light's centre is missing and lets
    light through; see ``docs/methods/mtsm.md``.

    Parameters
    ----------
    resolution : int, optional
        Texels along the longer side of each map, 16 to 16384. ``None``: from the number of
        triangles, 1024 or 2048.
    samples : int
        Light samples per receiver, 1 to 65536.
    seed : int
        Of the light samples, 0 to 2**64 - 1.
    z_threshold : float, optional
        Thickness of surfaces to either side, world units. By default none: a texel's piece of a
        surface has its triangle's slope, and covers without gaps.
    bias : float
        How far above a receiver's tangent plane occluders have to be, world units, beside what the
        texels' slopes ask for.
    detail : float
        Texels across the light, as a receiver sees it, that are told apart, 1 to 65536: where
        there are more, coarser levels of the map answer.
    opacity : {"opaque"}, optional
        ``"opaque"`` lets every mesh with an opacity above 0 block all light; without, transparent
        meshes that cast are an error.
    """

    resolution: int | None = 1024
    samples: int = 256
    seed: int = 0
    z_threshold: float | None = None
    bias: float = 0.0
    detail: float = 20.0
    opacity: Literal["opaque"] | None = None

    name: ClassVar[str] = "slsm"
    points: ClassVar[bool] = True
    # What the kernel asks of all three and users of `Mtsm` choose.
    layers: ClassVar[int] = 1
    error: ClassVar[float] = 0.0
    threshold: ClassVar[float] = 0.0
    resets: ClassVar[int] = 0
    crossing: ClassVar[str] = "multiply"

    def _to_core(self) -> _core.Method:
        return _core.Method.slsm(self)


@dataclass(frozen=True)
class Mlsm(Method):
    """Ray-traced multilayer shadow maps (Xie, Tabellion and Pearce 2007, Section 4).

    As `Slsm`, with the nearest few surfaces of every texel; see ``docs/methods/mtsm.md``.

    Parameters
    ----------
    resolution : int, optional
        Texels along the longer side of each map, 16 to 16384. ``None``: from the number of
        triangles, 1024 or 2048.
    layers : int, optional
        Surfaces kept of a texel, 1 to 64. ``None``: from the scene's depth complexity, 1 to 8.
    samples, seed, z_threshold, bias, detail, opacity
        As of `Slsm`.
    """

    resolution: int | None = None
    layers: int | None = None
    samples: int = 256
    seed: int = 0
    z_threshold: float | None = None
    bias: float = 0.0
    detail: float = 20.0
    opacity: Literal["opaque"] | None = None

    name: ClassVar[str] = "mlsm"
    points: ClassVar[bool] = True
    error: ClassVar[float] = 0.0
    threshold: ClassVar[float] = 0.0
    resets: ClassVar[int] = 0
    crossing: ClassVar[str] = "multiply"

    def _to_core(self) -> _core.Method:
        return _core.Method.mlsm(self)


@dataclass(frozen=True)
class Mtsm(Method):
    """Ray-traced multilayer transparent shadow maps (Xie, Tabellion and Pearce 2007, Section 5).

    As `Mlsm`, and layers may let light through: where a texel's ray crosses more surfaces than
    there are layers, runs of them become one layer that knows how many it stands for. Of an opaque
    scene it is the same to the last bit. See ``docs/methods/mtsm.md``.

    Parameters
    ----------
    resolution, layers, samples, seed, z_threshold, bias, detail
        As of `Mlsm`.
    error : float
        Largest error of a texel's visibility that making crossings one layer may cause, 0 to 1;
        more where they are too many for `layers`.
    threshold : float
        Transmittance, 0 to 1, at and below which a light sample counts as hidden.
    resets : int
        How often a texel's visibility starts from 1 again behind what is opaque, 0 to 64.
    crossing : {"multiply", "subtract"}
        Whether a crossing multiplies a segment's transmittance, or subtracts what it takes from the
        texel's own ray (the paper's equation 3 as printed: too light where a segment has not
        crossed the layers before).
    opacity : {"opaque"}, optional
        ``"opaque"`` lets every mesh with an opacity above 0 block all light.
    """

    resolution: int | None = None
    layers: int | None = None
    samples: int = 256
    seed: int = 0
    z_threshold: float | None = None
    bias: float = 0.0
    detail: float = 20.0
    error: float = 0.02
    threshold: float = 1 / 512
    resets: int = 4
    crossing: Literal["multiply", "subtract"] = "multiply"
    opacity: Literal["opaque"] | None = None

    name: ClassVar[str] = "mtsm"
    transparent: ClassVar[bool] = True
    points: ClassVar[bool] = True

    def _to_core(self) -> _core.Method:
        return _core.Method.mtsm(self)


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
