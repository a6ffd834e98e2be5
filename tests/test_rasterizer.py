"""The rasteriser against an independent ray caster, and what an image says about its surfaces."""

from __future__ import annotations

import numpy as np
import pytest
import softshadow as ss
import trimesh
from shapes import QUAD, bumpy, geodesic, quad

EPS = 2.0**-53
SIZE = 320  # pixels a side
PART = 500_000  # pairs of triangle and pixel that are looked at together: 200 MB
NEAR = 1e-7  # of the scene's half-extent rounded up to a power of two: the near plane


class Local:
    """Vertices as the core has them: relative to the middle, scaled, in single precision."""

    def __init__(self, vertices, faces):
        vertices, self.faces = np.asarray(vertices, dtype=np.float64), np.asarray(faces)
        used = vertices[np.unique(self.faces)]
        low, high = used.min(axis=0), used.max(axis=0)
        self.origin = 0.5 * low + 0.5 * high
        self.unit = 2.0 ** np.ceil(np.log2((0.5 * high - 0.5 * low).max()))
        inside = np.clip((vertices - self.origin) / self.unit, -2, 2)
        self.corners = inside.astype(np.float32).astype(np.float64)[self.faces]

    def __call__(self, points):
        return (points - self.origin) / self.unit


def _directions(camera):
    """Rays of camera-space depth 1 through all pixel centres, (H * W, 3)."""
    rays = camera.rays().reshape(-1, 3)
    return rays / (rays @ camera.camera_to_world[:3, 2])[:, None]


def _pairs(local, camera):
    """Triangles and pixels that may meet: pixels in the bounds of a triangle's image."""
    view = np.linalg.inv(camera.camera_to_world)[:3, :3]
    p = (local.corners - local(camera.eye)) @ view.T @ camera.K.T
    behind = (p[..., 2] < NEAR).any(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        image = p[..., :2] / p[..., 2:]
    # One pixel more on every side than the centres in the bounds.
    size = np.array([camera.width, camera.height])
    low = np.where(behind[:, None], 0, np.floor(image.min(axis=1) - 1.5))
    high = np.where(behind[:, None], size - 1, np.ceil(image.max(axis=1) + 0.5))
    low = np.clip(low, 0, size).astype(np.int64)
    high = np.clip(high, -1, size - 1).astype(np.int64)
    extent = np.maximum(high - low + 1, 0)
    extent[(p[..., 2] < NEAR).all(axis=1)] = 0
    total = np.cumsum(extent.prod(axis=1))
    parts = np.searchsorted(total, np.arange(PART, total[-1], PART))
    for chosen in np.split(np.arange(len(total)), parts):
        count = extent[chosen].prod(axis=1)
        triangle = np.repeat(chosen, count)
        number = np.arange(len(triangle)) - np.repeat(np.cumsum(count) - count, count)
        x = low[triangle, 0] + number % np.maximum(extent[triangle, 0], 1)
        y = low[triangle, 1] + number // np.maximum(extent[triangle, 0], 1)
        yield triangle, y * camera.width + x


def _meet(local, camera, directions, triangle, pixel):
    """Möller and Trumbore 1997: depth, and the barycentric coordinates (the least of the three)."""
    a, b, c = (local.corners[triangle, k] for k in range(3))
    d, s = directions[pixel], local(camera.eye) - a
    e1, e2 = b - a, c - a
    p, q = np.cross(d, e2), np.cross(s, e1)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / np.einsum("ij,ij->i", p, e1)
        u, v = np.einsum("ij,ij->i", p, s) * inverse, np.einsum("ij,ij->i", q, d) * inverse
        depth = np.einsum("ij,ij->i", q, e2) * inverse
        least = np.minimum(np.minimum(u, v), 1 - u - v)
    return depth, least


def _cast(local, camera):
    """Nearest triangle and depth (local) for every pixel, without a hierarchy."""
    directions = _directions(camera)
    found = []
    for triangle, pixel in _pairs(local, camera):
        depth, least = _meet(local, camera, directions, triangle, pixel)
        hit = np.isfinite(depth) & (least >= 0) & (depth >= NEAR)
        found.append((triangle[hit], depth[hit], pixel[hit]))
    triangle, depth, pixel = (np.concatenate(x) for x in zip(*found, strict=True))
    order = np.lexsort((triangle, depth, pixel))
    seen, first = np.unique(pixel[order], return_index=True)
    ids, depths = np.full(len(directions), -1), np.full(len(directions), np.inf)
    ids[seen], depths[seen] = triangle[order[first]], depth[order[first]]
    shape = (camera.height, camera.width)
    return ids.reshape(shape), depths.reshape(shape)


def _check(vertices, faces, camera):
    """Compare with the ray caster; return ids, and the differences on edges and in ties."""
    ids, depth = ss.kernels.rasterize(vertices, faces, camera)
    local = Local(vertices, faces)
    expected, expected_depth = _cast(local, camera)
    directions = _directions(camera)
    on_edge = ties = 0
    for pixel in np.flatnonzero((ids != expected).ravel()):
        claimed, other = ids.ravel()[pixel], expected.ravel()[pixel]
        both = np.array([t for t in (claimed, other) if t >= 0])
        z, least = _meet(local, camera, directions, both, np.full(len(both), pixel))
        # Both round their edge tests by some 1e-15 of a triangle; 1e-10 is still on its edge.
        if np.abs(least).min() < 1e-10:
            on_edge += 1
        else:
            # Faces that overlap in one plane: both triangles are hit, at one depth to rounding.
            assert len(both) == 2, (pixel, claimed, other, z, least)
            assert least.min() > 0, (pixel, claimed, other, z, least)
            assert abs(z[0] - z[1]) < 1e-13 * z[0] / min(1, _slope(local, camera, both, pixel))
            ties += 1
    same = (ids == expected) & (ids >= 0)
    # Both sides work in double precision, the answer is in single.
    error = np.abs(depth[same] / (expected_depth[same] * local.unit) - 1)
    assert error.max(initial=0) < 2.0**-24 + 1e-9
    assert np.isinf(depth[ids < 0]).all()
    return ids, on_edge, ties


def _slope(local, camera, triangles, pixel):
    """Least cosine between a pixel's ray and the triangles' normals."""
    a, b, c = (local.corners[triangles, k] for k in range(3))
    n = np.cross(b - a, c - a)
    d = camera.rays().reshape(-1, 3)[pixel]
    return np.abs(n @ d / np.linalg.norm(n, axis=1)).min()


def _bunny():
    mesh = ss.scenes.bunny_on_plane().scene.entries[1]
    return mesh.vertices, mesh.faces, _camera((0.1, -1.9, 1.1), (0, 0, 0.5))


def _city(name):
    setup = ss.scenes.city(name, SIZE, SIZE)
    mesh = setup.scene.entries[0]
    return mesh.vertices, mesh.faces, setup.camera


def _far_away():
    vertices, faces, camera = _bunny()
    move = np.array([1e4, -2e4, 5e3])
    return vertices + move, faces, _camera(camera.eye + move, np.add(move, (0, 0, 0.5)))


def _camera(eye, target, fov=45.0, size=None):
    return ss.Camera(eye, target, fov_y_deg=fov, width=size or SIZE, height=size or SIZE)


MODELS = {
    "bunny": _bunny,
    "bunny far away": _far_away,
    "munich": lambda: _city("munich"),
    "bumpy body": lambda: (*bumpy(64), _camera((2.2, 1.5, 1.7), (0, 0, 0))),
    "inside a bumpy body": lambda: (*bumpy(10), _camera((0.1, 0.2, 0.3), (1, 0, 0.5), 100)),
}


@pytest.mark.parametrize("name", MODELS)
def test_a_pixel_belongs_to_the_triangle_that_its_ray_hits_first(name):
    vertices, faces, camera = MODELS[name]()
    ids, on_edge, ties = _check(vertices, faces, camera)
    assert (ids >= 0).mean() > 0.2
    # An edge test of f64 rounding against another: none is expected in 1e5 pixels, two are allowed.
    assert on_edge <= 2
    # Measured: 15 of 262,144 pixels of Munich, where houses share walls; no other model has any.
    assert ties <= (60e-6 * 4 * ids.size if name == "munich" else 0)


# ---------------------------------------------------------------- centres on edges and vertices


def _grid(cells, rng):
    """A square grid at depth 1, its vertices exactly at pixel centres; mixed diagonals."""
    x, y = np.meshgrid(np.arange(cells + 1), np.arange(cells + 1))
    points = np.stack([x, y], axis=-1).reshape(-1, 2)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    a, b, c, d = corner, corner + 1, corner + cells + 2, corner + cells + 1
    flip = rng.random(len(corner)) < 0.5
    one = np.where(flip[:, None], np.stack([a, b, c], 1), np.stack([a, b, d], 1))
    two = np.where(flip[:, None], np.stack([a, c, d], 1), np.stack([b, c, d], 1))
    faces = np.concatenate([one, two])
    # Random windings: neither order nor orientation may matter.
    turned = rng.random(len(faces)) < 0.5
    faces[turned] = faces[turned][:, ::-1]
    return points, rng.permutation(faces)


def _exact_camera():
    """Looks along +z; a point (x, y, 1) is at pixel coordinates (64 x + 32, 64 y + 32), exactly."""
    K = [[64, 0, 32], [0, 64, 32], [0, 0, 1]]
    return ss.Camera.from_matrix(K, np.eye(4), 64, 64)


def test_centres_on_shared_edges_and_vertices_belong_to_exactly_one_triangle():
    rng = np.random.default_rng(3)
    points, faces = _grid(40, rng)
    vertices = np.column_stack([(points + 10.5 - 32) / 64, np.ones(len(points))])
    camera = _exact_camera()
    whole, depth = ss.kernels.rasterize(vertices, faces, camera)
    covered = whole >= 0
    # 41 by 41 centres are on the grid; of two opposite sides one counts.
    assert covered.sum() == 40 * 40
    assert (depth[covered] == 1).all()
    rows, columns = np.flatnonzero(covered.any(axis=1)), np.flatnonzero(covered.any(axis=0))
    assert len(rows) == len(columns) == 40
    # In parts, triangles cover only the pixels that they have in the whole: none is hit twice.
    # The corners that hold the frame of coordinates lie out of sight.
    far = np.array([[-64, -64, -64], [64, 64, 64], [64, -64, -64.0]])
    hits = np.zeros(whole.shape, dtype=int)
    for part in np.array_split(np.arange(len(faces)), 400):
        chosen = np.concatenate([faces[part], [[-3, -2, -1]]]) % (len(vertices) + 3)
        ids, _ = ss.kernels.rasterize(np.concatenate([vertices, far]), chosen, camera)
        ids[ids == len(part)] = -1
        hits += ids >= 0
        assert (part[ids[ids >= 0]] == whole[ids >= 0]).all()
    assert np.array_equal(hits, covered)


def test_a_fan_around_a_pixel_centre_has_no_gap():
    camera = _exact_camera()
    hub = np.array([0.5 / 64, 0.5 / 64, 1.0])
    angles = 2 * np.pi * np.arange(360) / 360
    rim = hub + 2 * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(360)])
    k = np.arange(360)
    faces = np.column_stack([np.full(360, 360), k, (k + 1) % 360])
    ids, _ = ss.kernels.rasterize(np.concatenate([rim, [hub]]), faces, camera)
    assert (ids >= 0).all()


# ---------------------------------------------------------------- the near plane, hard cases


def test_triangles_around_the_camera_are_clipped_without_gaps():
    vertices, faces = geodesic(6)
    for fov in (45.0, 120.0, 170.0):
        ids, on_edge, ties = _check(
            vertices, faces, _camera((0.3, -0.2, 0.4), (1, 0.2, 0), fov, 96)
        )
        assert (ids >= 0).all()
        assert on_edge + ties <= 2


@pytest.mark.parametrize("height", [3.0, 1.0, 0.1, 0.01])
def test_a_floor_that_reaches_behind_the_camera_is_flat(height):
    scene = ss.Scene()
    scene.add(quad((0, 0, 0), (20, 0, 0), (0, 20, 0)), "floor")
    camera = ss.Camera((0.3, -5, height), (0.2, 8, 0), fov_y_deg=60, width=128, height=128)
    image = ss.render(scene, camera, ss.SphereLight((0, 0, 5), 0.1), "hard")
    mask = image.mask
    assert mask.mean() > 0.4
    # A dozen roundings of local coordinates up to 1, in a unit of 16.
    assert np.abs(image.position[mask][:, 2]).max() < 16 * EPS * 16
    expected = -height / _directions(camera).reshape(*mask.shape, 3)[mask][:, 2]
    assert np.abs(image.depth[mask] / expected - 1).max() < 2.0**-24 + 1e-12
    assert (image.visibility[mask] == 1).all()


@pytest.mark.parametrize("at", ["vertex", "edge", "face"])
@pytest.mark.parametrize("look", ["in", "out", "along"])
def test_a_camera_on_the_mesh_sees_the_rest_of_it(at, look):
    vertices, faces = geodesic(6)
    vertices = np.round(vertices * 2**12) / 2**12
    corners = vertices[faces[17]]
    eye = corners[: {"vertex": 1, "edge": 2, "face": 3}[at]].mean(axis=0)
    outward = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    aim = {"in": -outward, "out": outward, "along": corners[1] + corners[2] - 2 * corners[0]}[look]
    camera = _camera(eye, eye + aim, 60.0, 64)
    ids, depth = ss.kernels.rasterize(vertices, faces, camera)
    assert not np.isnan(depth).any()
    assert (depth > 0).all()
    inward = camera.rays() @ outward / np.linalg.norm(outward) < 0
    # A face through the eye is not seen; the ring around a vertex bends by less than 0.3.
    steep = np.abs(camera.rays() @ outward / np.linalg.norm(outward)) > 0.3
    assert (ids >= 0)[inward & steep].all()
    assert (ids < 0)[~inward & steep].all()


def test_a_mesh_behind_the_camera_is_not_seen():
    vertices, faces = geodesic(6)
    ids, depth = ss.kernels.rasterize(vertices, faces, _camera((0, -3, 0), (0, -9, 0), 120, 64))
    assert (ids == -1).all()
    assert np.isinf(depth).all()


def test_degenerate_triangles_are_never_seen_and_change_nothing():
    vertices, faces = bumpy(10)
    camera = _camera((2.2, 1.5, 1.7), (0, 0, 0), size=128)
    plain, plain_depth = ss.kernels.rasterize(vertices, faces, camera)
    rng = np.random.default_rng(0)
    a, b = rng.integers(len(vertices), size=(2, 500))
    middle = np.arange(500) + len(vertices)
    collinear = np.column_stack([a, b, middle])  # in f64; in f32 some become slivers
    points = np.concatenate([vertices, (vertices[a] + vertices[b]) / 2])
    flat = np.concatenate([np.column_stack([a, a, b]), np.column_stack([a, b, a])])
    flat = np.concatenate([flat, np.column_stack([a, a, a])])
    ids, depth = ss.kernels.rasterize(vertices, np.concatenate([flat, faces]), camera)
    assert np.array_equal(np.where(ids >= 0, ids - len(flat), -1), plain)
    assert np.array_equal(depth, plain_depth)
    ids, depth = ss.kernels.rasterize(points, np.concatenate([faces, collinear]), camera)
    sliver = ids >= len(faces)
    # As wide as the rounding of their middle: a pixel's centre falls into one by chance 1e-5.
    assert sliver.sum() <= 2
    assert np.array_equal(ids[~sliver], plain[~sliver])


def test_of_duplicate_faces_the_first_is_seen():
    vertices, faces = geodesic(4)
    camera = _camera((2, 1, 1), (0, 0, 0), size=64)
    once, depth = ss.kernels.rasterize(vertices, faces, camera)
    twice, again = ss.kernels.rasterize(vertices, np.concatenate([faces, faces]), camera)
    assert np.array_equal(once, twice)
    assert np.array_equal(depth, again)


# ---------------------------------------------------------------- what an image says


def _image(name):
    vertices, faces, camera = MODELS[name]()
    scene = ss.Scene()
    scene.add((vertices, faces), name="model")
    light = ss.SphereLight(np.add(camera.eye, (0.1, 0.2, 0.3)), 0.05)
    return ss.render(scene, camera, light, "hard"), Local(vertices, faces), camera


@pytest.mark.parametrize("name", ["bunny", "bunny far away", "munich"])
def test_positions_lie_on_their_triangles_and_agree_with_depth_and_normal(name):
    image, local, camera = _image(name)
    mask = image.mask
    ids = image.triangle_id[mask]
    a, b, c = (local.corners[ids, k] for k in range(3))
    n = np.cross(b - a, c - a)
    area = np.linalg.norm(n, axis=1, keepdims=True)
    p = local(image.position[mask])
    off = np.abs(np.einsum("ij,ij->i", p - a, n / area))
    # A plane's distance from products of coordinates up to `size`, rounded: a dozen roundings; thin
    # triangles turn their rounded normal by sides² / area; the way to the world and back is rounded
    # at the world's coordinates.
    size = np.abs(local(camera.eye)).max() + 1
    sides = np.linalg.norm(b - a, axis=1) * np.linalg.norm(c - a, axis=1) / area[:, 0]
    world = np.abs(image.position[mask]).max() / local.unit
    assert (off < 16 * EPS * (size * np.maximum(sides, 1) + world)).all()

    directions = _directions(camera).reshape(*mask.shape, 3)[mask]
    depth = image.depth[mask].astype(np.float64)
    along = (image.position[mask] - camera.eye) @ camera.camera_to_world[:3, 2]
    assert np.abs(along / depth - 1).max() < 2.0**-23
    back = (image.position[mask] - camera.eye) / along[:, None]
    assert np.abs(back - directions).max() < 64 * EPS * (1 + world * local.unit / along.min())

    normal = image.normal[mask].astype(np.float64)
    assert np.abs(np.linalg.norm(normal, axis=1) - 1).max() < 2.0**-22
    facing = np.einsum("ij,ij->i", normal, directions)
    assert (facing <= 2.0**-22).all()
    cosine = np.abs(np.einsum("ij,ij->i", normal, n / area))
    assert (1 - cosine < 2.0**-22).all()


def test_an_image_has_the_ids_and_depths_of_the_rasteriser():
    vertices, faces, camera = MODELS["bunny"]()
    image, _, _ = _image("bunny")
    ids, depth = ss.kernels.rasterize(vertices, faces, camera)
    assert np.array_equal(image.triangle_id, ids)
    assert np.array_equal(image.depth, depth)
    assert np.array_equal(image.mask, ids >= 0)
    assert np.array_equal(image.mesh_id, np.where(ids >= 0, 0, -1))
    for array in (image.position, image.normal, image.radiance):
        assert (array[~image.mask] == 0).all()
    assert (image.visibility[~image.mask] == 1).all()


def test_mesh_ids_are_indices_of_entries_and_triangle_ids_of_their_faces():
    scene = ss.Scene()
    scene.add((quad((0, 0, 0), (6, 0, 0), (0, 6, 0))[0], QUAD), "ground")
    scene.add_spheres([(-1, 0, 0.5), (1, 0, 0.5)], [0.5, 0.4], "balls")
    box = trimesh.creation.box((0.6, 0.6, 0.6)).apply_translation((0, 1.2, 0.3))
    scene.add(box, "box")
    camera = ss.Camera((0, -4, 3), (0, 0, 0.2), width=96, height=64)
    image = ss.render(scene, camera, ss.SphereLight((0, 0, 4), 0.3), "hard")
    assert set(np.unique(image.mesh_id)) == {-1, 0, 1, 2}
    p = image.position
    ground, balls, boxes = (image.mesh_id == k for k in range(3))
    assert np.abs(p[ground][:, 2]).max() < 1e-12
    upper = p[ground][:, 0] < p[ground][:, 1]  # face 1 is the half beyond the diagonal
    assert np.array_equal(image.triangle_id[ground] == 1, upper)
    centers, radii = np.array([(-1, 0, 0.5), (1, 0, 0.5)]), np.array([0.5, 0.4])
    k = image.triangle_id[balls]
    assert set(k) == {0, 1}
    offset = p[balls] - centers[k]
    assert np.abs(np.linalg.norm(offset, axis=1) - radii[k]).max() < 1e-14
    assert np.abs(offset / radii[k][:, None] - image.normal[balls]).max() < 2.0**-23
    assert np.abs(np.abs(p[boxes] - [0, 1.2, 0.3]).max(axis=1) - 0.3).max() < 1e-7
    assert set(image.triangle_id[boxes]) <= set(range(12))


def test_spheres_are_seen_where_rays_meet_them():
    centers = np.array([(-1, 0, 0.5), (1, 0.3, 0.5), (0.2, 1.5, 1.0), (0.4, 0, 0.5)])
    radii = np.array([0.5, 0.4, 0.9, 0.5])
    scene = ss.Scene()
    scene.add_spheres(centers, radii)
    camera = ss.Camera((0.3, -4, 2), (0, 0, 0.5), width=160, height=120)
    image = ss.render(scene, camera, ss.SphereLight((0, 0, 4), 0.3), "hard")
    d = camera.rays()[..., None, :]
    q = camera.eye - centers
    b = (d * q).sum(-1)
    discriminant = b**2 - (q**2).sum(-1) + radii**2
    with np.errstate(invalid="ignore"):
        t = np.where(discriminant >= 0, -b - np.sqrt(discriminant), np.inf)
    near = np.abs(discriminant).min(axis=-1) < 1e-12  # a ray that is tangent to rounding
    assert near.sum() == 0
    expected = np.where(np.isfinite(t.min(axis=-1)), t.argmin(axis=-1), -1)
    assert np.array_equal(image.triangle_id, expected)
    hit = expected >= 0
    p = camera.eye + d[..., 0, :] * np.where(hit, t.min(axis=-1), 0)[..., None]
    # Near an outline the root of a small discriminant amplifies rounding: 1e-15 to its root.
    assert np.abs(p - image.position)[hit].max() < 1e-7


def test_a_camera_inside_a_sphere_sees_its_inside():
    scene = ss.Scene()
    scene.add_spheres((1, 2, 3), 2.0)
    camera = ss.Camera((1.5, 2, 3), (0, 0, 0), width=32, height=32)
    image = ss.render(scene, camera, ss.SphereLight((1, 2, 3), 0.1), "hard")
    assert image.mask.all()
    assert np.abs(np.linalg.norm(image.position - [1, 2, 3], axis=-1) - 2).max() < 1e-14
    assert ((image.normal * camera.rays()).sum(axis=-1) < 0).all()
    assert (image.visibility == 1).all()
