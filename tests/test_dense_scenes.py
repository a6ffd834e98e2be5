"""The scenes of many triangles: their sizes, seeds, and how much of them is penumbra."""

from __future__ import annotations

import numpy as np
import pytest
import softshadow as ss
from shapes import is_closed

DENSE = {
    "fur_ball": {"triangles": 60_000},
    "fur_ribbons": {"triangles": 30_000},
    "tree": {"leaves": 20_000},
    "statue": {"subdivisions": 0},
}
SIZES = {"fur_ball": 1_000_000, "fur_ribbons": 480_000, "tree": 300_000, "statue": 300_000}


@pytest.mark.parametrize("name", DENSE)
def test_the_defaults_have_the_triangles_and_a_sixth_of_the_picture_is_penumbra(name):
    setup = getattr(ss.scenes, name)(128, 128)
    assert setup.scene.triangle_count >= SIZES[name]
    image = ss.render(setup.scene, setup.camera, setup.light, ss.RayTraced(64))
    seen = image.visibility[image.mask]
    assert ((seen > 0) & (seen < 1)).mean() > 0.15
    assert (seen == 0).any()
    assert (seen == 1).any()
    casting = [m.world_vertices() for m in setup.scene.meshes if m.name != "ground"]
    assert 0.9 < np.ptp(np.concatenate(casting), axis=0).max() < 1.5


@pytest.mark.parametrize("name", DENSE)
@pytest.mark.parametrize("light", ["rect", "disk", "sphere"])
def test_sizes_lights_and_seeds_are_parameters(name, light):
    make = getattr(ss.scenes, name)
    setups = [make(16, 16, light, light_size=0.3, seed=s, **DENSE[name]) for s in (0, 0, 1)]
    assert all(s.scene.triangle_count < 120_000 for s in setups)
    images = [ss.render(s.scene, s.camera, s.light, ss.RayTraced(4)) for s in setups]
    assert np.array_equal(images[0].visibility, images[1].visibility)
    assert not np.array_equal(images[0].position, images[2].position)


def test_opacity_is_that_of_fur_and_leaves_alone():
    for name, part in [("fur_ball", "fur"), ("tree", "leaves")]:
        make = getattr(ss.scenes, name)
        dark, clear = (make(64, 64, opacity=o, **DENSE[name]) for o in (1.0, 0.3))
        opacities = {e.name: e.opacity for e in clear.scene.entries}
        assert opacities.pop(part) == 0.3
        assert set(opacities.values()) == {1.0}
        seen = [
            ss.render(s.scene, s.camera, s.light, ss.RayTraced(16)).visibility
            for s in (dark, clear)
        ]
        assert (seen[1] >= seen[0] - 1e-6).all()
        assert seen[1].mean() > seen[0].mean() + 0.005


def test_fewer_hairs_and_leaves_cover_about_as_much():
    for name in ("fur_ball", "tree"):
        key, few = next(iter(DENSE[name].items()))
        seen = []
        for count in (few, 4 * few):
            setup = getattr(ss.scenes, name)(96, 96, **{key: count})
            image = ss.render(setup.scene, setup.camera, setup.light, ss.RayTraced(16))
            seen.append(1 - image.visibility[image.mask & (image.mesh_id == 0)].mean())
        # Measured: 5 % and 7 % apart.
        assert abs(seen[1] / seen[0] - 1) < 0.15, name


def test_fur_and_wood_are_closed_tubes():
    fur = ss.scenes.fur_ball(8, 8, triangles=26_000).scene
    wood = ss.scenes.tree(8, 8, leaves=10).scene
    for scene, name in [(fur, "fur"), (wood, "wood")]:
        mesh = next(e for e in scene.entries if e.name == name)
        assert is_closed(mesh.faces)
