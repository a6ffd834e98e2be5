"""The papers' figures as scenes: what their models must be like for the methods to be judged."""

from __future__ import annotations

import numpy as np
import pytest
import softshadow as ss
import trimesh
from shapes import is_closed

FIGURES = [
    "acute_triangle",
    "growing_light",
    "landscape",
    "overlapping_boards",
    "two_cylinders",
    "two_lights",
]


def _silhouette_edges(setup):
    return sum(
        len(ss.kernels.silhouette_edges(m.world_vertices(), m.faces, setup.light.center)[0])
        for m in setup.scene.meshes
        if m.casts
    )


@pytest.mark.parametrize("name", FIGURES)
@pytest.mark.parametrize("light", ["rect", "disk", "sphere"])
def test_every_figure_is_near_unit_size_and_has_all_kinds_of_pixels(name, light):
    setup = getattr(ss.scenes, name)(64, 64, light)
    image = ss.render(setup.scene, setup.camera, setup.light, ss.RayTraced(16))
    seen = image.visibility[image.mask]
    assert (seen == 0).any()
    assert (seen == 1).any()
    assert ((seen > 0) & (seen < 1)).mean() > 0.03
    casting = [m.world_vertices() for m in setup.scene.meshes if m.casts and m.name != "ground"]
    extent = np.ptp(np.concatenate(casting), axis=0).max()
    assert 0.5 < extent < 2


@pytest.mark.parametrize("name", [n for n in FIGURES if n != "acute_triangle"])
def test_the_casters_are_closed_and_wound_outwards(name):
    for mesh in getattr(ss.scenes, name)(8, 8).scene.meshes:
        if mesh.casts and mesh.name != "ground":
            assert is_closed(mesh.faces), mesh.name
            assert trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).volume > 0, mesh.name


def test_the_dense_growing_light_has_about_two_thousand_silhouette_edges():
    assert 1900 < _silhouette_edges(ss.scenes.growing_light(8, 8, dense=True)) < 2200
    assert 300 < _silhouette_edges(ss.scenes.growing_light(8, 8)) < 400


def test_the_landscape_has_100k_triangles_and_casts_if_asked():
    for casts in (False, True):
        mesh = ss.scenes.landscape(8, 8, casts=casts).scene.entries[0]
        assert (len(mesh.faces), mesh.casts) == (100_352, casts)
    assert len(ss.scenes.landscape(8, 8, triangles=5000).scene.entries[0].faces) == 5000


def test_two_lights_are_a_sequence_to_render_with():
    setup = ss.scenes.two_lights(16, 16)
    assert setup.lights == (setup.light, *setup.more_lights)
    assert len(setup.lights) == 2
    image = ss.render(setup.scene, setup.camera, setup.lights, "hard")
    assert image.visibility.shape == (2, 16, 16)
    assert ss.scenes.two_cylinders(8, 8).lights == (ss.scenes.two_cylinders(8, 8).light,)


@pytest.mark.parametrize(("kind", "turn"), [("disk", 0), ("rect", 30), ("rect", 45), ("rect", 90)])
def test_closed_forms_of_the_half_plane_under_disk_and_turned_square(kind, turn):
    setup = ss.scenes.half_plane(96, 96, light=kind, turn_deg=turn)
    image = ss.render(setup.scene, setup.camera, setup.light, ss.RayTraced(1024))
    on_receiver = image.mask & (image.mesh_id == 0)
    error = image.visibility[on_receiver] - setup.visibility(image.position[on_receiver])
    # Stratified sampling leaves about N^(-3/4) = 0.0055 at worst, and no bias.
    assert np.abs(error).max() < 0.02
    assert abs(error.mean()) < 0.0005
