"""No ray escapes from a closed body, and no convex body shadows itself, whatever size and place.

The bodies are closed surfaces of 80 thousand to a million triangles. Their vertices lie on a grid
of multiples of a power of two, and so do the origins of the rays, so that rays can be aimed
*exactly* at vertices and edges: these coordinates and their small multiples are exact in single
precision. Bodies that are scaled by powers of ten lose that exactness, and are shot at anyway.

A closed surface that winds around the origin of a ray once, and does not reach the ray's end, is
crossed by it at least once; where the origin lies behind every triangle's plane, exactly once. Both
preconditions are checked, not assumed.
"""

from __future__ import annotations

import functools

import numpy as np
import pytest
import softshadow as ss
from shapes import bumpy, geodesic, is_closed, on_grid

RAYS = 1_000_000
BITS = 14  # a million triangles on a unit sphere are 60 grid steps wide
INNER = 0.25  # origins lie in this ball
REACH = 4  # rays end at origin + 4 (aim - origin), outside every body used here


@functools.lru_cache(maxsize=2)
def _body(kind):
    if kind == "sphere 82k":
        vertices, faces = geodesic(64)
    elif kind == "bumpy 82k":
        vertices, faces = bumpy(64, seed=1)
    elif kind == "bumpy 328k":
        vertices, faces = bumpy(128, seed=2)
    else:
        vertices, faces = bumpy(224, seed=3)
    vertices = on_grid(vertices, BITS)
    assert is_closed(faces)
    normals = np.cross(
        vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]]
    )
    height = np.einsum("ij,ij->i", normals, vertices[faces[:, 0]])
    # Every point of the ball of origins is behind every triangle: each ray leaves exactly once.
    assert (height > INNER * np.linalg.norm(normals, axis=1)).all()
    # |origin + 4 (aim - origin)| >= 4 |aim| - 3 |origin|
    radii = np.linalg.norm(vertices, axis=1)
    assert 4 * 0.99 * radii.min() - 3 * INNER > radii.max()
    vertices.flags.writeable = faces.flags.writeable = False  # others have it, too
    return vertices, faces


@functools.lru_cache(maxsize=2)
def _scene_of(kind, opacity=1.0):
    """With the hierarchy that the first ray builds."""
    return _scene(*_body(kind), opacity)


def _rays(vertices, faces, aim, count, seed=0):
    """Origins in the ball and ends beyond the surface, on the grid (random aims apart)."""
    rng = np.random.default_rng(seed)
    origins = on_grid(rng.uniform(-INNER, INNER, (count, 3)) / np.sqrt(3), 10)
    if aim == "vertices":
        aims = vertices[rng.integers(len(vertices), size=count)]
    elif aim == "edges":
        face, side = rng.integers(len(faces), size=count), rng.integers(3, size=count)
        aims = 0.5 * (vertices[faces[face, side]] + vertices[faces[face, (side + 1) % 3]])
    else:
        weights = rng.dirichlet((1, 1, 1), size=count)
        aims = np.einsum(
            "ij,ijk->ik", weights, vertices[faces[rng.integers(len(faces), size=count)]]
        )
    return origins, origins + REACH * (aims - origins)


def _scene(vertices, faces, opacity=1.0):
    scene = ss.Scene()
    scene.add((vertices, faces), name="body", opacity=opacity)
    return scene


@pytest.mark.parametrize("aim", ["random", "edges", "vertices"])
@pytest.mark.parametrize("kind", ["sphere 82k", "bumpy 82k", "bumpy 328k", "bumpy 1M"])
def test_no_ray_escapes_from_a_closed_body(kind, aim):
    origins, ends = _rays(*_body(kind), aim, RAYS)
    through = ss.kernels.transmittance(_scene_of(kind), origins, ends)
    assert through.shape == (RAYS,)
    assert not through.any(), f"{np.count_nonzero(through)} of {RAYS} rays escaped"


PLACES = [
    pytest.param(scale, offset, id=f"scale {scale:g}{', moved' if offset else ''}")
    for scale in (1e-4, 1.0, 1e4)
    for offset in (0.0, 1e4)
    if (scale, offset) != (1.0, 0.0)
]


@pytest.mark.parametrize("aim", ["random", "edges", "vertices"])
@pytest.mark.parametrize(("scale", "offset"), PLACES)
def test_no_ray_escapes_from_a_body_that_is_large_small_or_far_away(scale, offset, aim):
    vertices, faces = _body("bumpy 82k")
    move = scale * offset * np.array([1.0, -0.7, 0.3])
    origins, ends = _rays(vertices, faces, aim, RAYS // 2)
    scene = _scene(vertices * scale + move, faces)
    through = ss.kernels.transmittance(scene, origins * scale + move, ends * scale + move)
    assert not through.any(), f"{np.count_nonzero(through)} rays escaped"


@pytest.mark.parametrize("aim", ["random", "edges", "vertices"])
@pytest.mark.parametrize("kind", ["sphere 82k", "bumpy 328k"])
def test_every_ray_crosses_a_translucent_body_exactly_once_on_its_way_out(kind, aim):
    origins, ends = _rays(*_body(kind), aim, RAYS // 4)
    through = ss.kernels.transmittance(_scene_of(kind, 0.5), origins, ends)
    assert (through == 0.5).all(), np.unique(through, return_counts=True)


@pytest.mark.parametrize("aim", ["random", "edges", "vertices"])
def test_every_ray_through_a_translucent_body_crosses_it_exactly_twice(aim):
    origins, ends = _rays(*_body("sphere 82k"), aim, RAYS // 4)
    starts = origins - REACH * (ends - origins)  # beyond the far side, by the same argument
    through = ss.kernels.transmittance(_scene_of("sphere 82k", 0.5), starts, ends)
    assert (through == 0.25).all(), np.unique(through, return_counts=True)


def test_rays_that_stay_inside_or_outside_are_free():
    scene = _scene_of("bumpy 82k")
    origins, ends = _rays(*_body("bumpy 82k"), "random", RAYS // 4)
    rng = np.random.default_rng(5)
    assert (ss.kernels.transmittance(scene, origins, rng.permutation(origins)) == 1).all()
    # Beyond the body and on, away from it: the same ray from its end to twice as far.
    assert (ss.kernels.transmittance(scene, ends, 2 * ends - origins) == 1).all()


# ---------------------------------------------------------------- self-shadowing

OFFSETS = [0.0, 1e4]
SCALES = [1e-6, 1e-3, 1.0, 1e3, 1e6]


def _convex(kind):
    if kind == "cube":
        v = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=np.float64)
        f = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)]
        f += [(2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]
        return v - 0.5, np.array(f)
    if kind == "needle":  # an octahedron, a thousand times as long as it is wide
        v = np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1000), (0, 0, -1000)])
        f = [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]
        return v * 1e-3, np.array(f)
    return geodesic(20)


LIGHTS = {
    "rect": lambda s, m: ss.RectLight(
        s * np.array([2.0, 0.4, 3.0]) + m, (0, 2.0 * s, 0), (2.0 * s, 0, 0.5 * s)
    ),
    "disk": lambda s, m: ss.DiskLight(s * np.array([0.3, -3.0, 0.4]) + m, (0, 1, 0), 1.5 * s),
    "sphere": lambda s, m: ss.SphereLight(s * np.array([-2.0, 1.0, -1.0]) + m, 0.8 * s),
}


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("kind", ["cube", "needle", "geodesic"])
@pytest.mark.parametrize("offset", OFFSETS)
@pytest.mark.parametrize("scale", SCALES)
def test_a_convex_body_does_not_shadow_itself(kind, light, scale, offset):
    vertices, faces = _convex(kind)
    move = scale * offset * np.array([0.9, -1.0, 0.4])
    world = vertices * scale + move
    centroids = world[faces].mean(axis=1)
    # From the unmoved vertices: the offset would cost the normals four digits.
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    source = LIGHTS[light](scale, move)
    scene = _scene(world, faces)
    above = ss.kernels.light_fraction_above(source, centroids, normals)
    whole = above > 1 - 1e-12  # a clipped polygon's area is rounded
    assert above.min() == 0
    assert whole.any()
    few = ss.RayTraced(samples=64)
    seen = ss.visibility(scene, centroids, normals, source, few)
    # Nothing else is in the scene, so a sample is blocked if and only if it is under the tangent
    # plane: as in a scene of the same receivers and samples, where nothing casts.
    bare = ss.Scene()
    bare.add((world, faces), name="body", casts=False)
    assert np.array_equal(seen, ss.visibility(bare, centroids, normals, source, few))
    assert (seen[whole] == 1).all()
    assert (seen[above == 0] == 0).all()

    hard = ss.visibility(scene, centroids, normals, source, "hard")
    to_center = np.asarray(source.center) - centroids
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1)
    area = np.linalg.norm(normals, axis=1)  # twice
    sine = np.einsum("ij,ij->i", normals, to_center) / np.linalg.norm(to_center, axis=1) / area
    # Rays start four ulps of the scene's half-extent, rounded up to a power of two, over the
    # surface; one that sinks by less than twice that until the triangle ends may pass over it.
    lift = 4 * 2.0**-23 * np.ptp(vertices, axis=0).max()
    grazing = (sine <= 0) & (-sine * area / sides.sum(axis=1) < 2 * lift)
    assert grazing.mean() < 0.01
    expected = np.where(sine > 0, above, 0).astype(np.float32)
    # h is computed in other units here: to half an ulp of single precision.
    assert np.abs(hard - expected)[~grazing].max() <= 2.0**-24
