"""Scenes, images and comparisons show themselves in notebooks: small, soon, and without failing."""

from __future__ import annotations

import base64
import re
import time
from io import BytesIO

import numpy as np
import pytest
import softshadow as ss
from imageio.v3 import imread
from softshadow import showing
from softshadow.figure import MOST_BYTES


@pytest.fixture(scope="module")
def setup():
    return ss.scenes.closed_solids(96, 72, detail=2)


@pytest.fixture(scope="module")
def result(setup):
    methods = ["hard", "pcf", "wedges", ss.RayTraced(samples=16)]
    return ss.compare(setup.scene, setup.camera, setup.light, methods, repeats=1)


def pictures(html):
    """The pictures that are in HTML, as arrays."""
    found = re.findall(r'src="data:image/png;base64,([^"]+)"', html)
    return [imread(BytesIO(base64.b64decode(data))) for data in found]


def test_a_scene_is_a_table_of_its_entries_and_a_picture():
    scene = ss.Scene()
    scene.add(ss.scenes.square(2), "ground <b>", albedo=(0.25, 0.5, 1))
    scene.add_spheres([(0, 0, 1), (1, 0, 1)], 0.5, "balls", opacity=0.25, receives=False)
    scene.add_curves([(0, 0, 0), (0, 0, 1)], [0, 2], 0.01, name="hair", casts=False)
    html = scene._repr_html_()
    cells = [re.findall("<td>(.*?)</td>", line) for line in re.findall("<tr>(.*?)</tr>", html)]
    assert cells[1] == [
        *("ground &lt;b&gt;", "mesh", "2", "(-2, -2, 0) to (2, 2, 0)"),
        *("(0.25, 0.5, 1)", "1", "yes", "yes"),
    ]
    assert cells[2][:4] == ["balls", "2 spheres", "", "(-0.5, -0.5, 0.5) to (1.5, 0.5, 1.5)"]
    assert cells[2][5:] == ["0.25", "yes", "no"]
    assert cells[3][1] == "1 curves"
    assert cells[3][6:] == ["no", "yes"]
    (picture,) = pictures(html)
    grey = picture[..., :3].mean(axis=2)
    assert (grey < 30).any()  # a shadow, or where nothing is
    assert (grey > 150).any()


def test_showing_a_scene_builds_nothing_in_it(setup, monkeypatch):
    """So that the time to prepare it, measured later, is whole."""
    rendered = []

    def render(scene, *view, method):
        rendered.append(scene)
        return ss.render(scene, *view, method=method)

    monkeypatch.setattr(showing, "render", render)
    assert pictures(setup.scene._repr_html_())
    assert len(rendered) == 1
    assert rendered[0] is not setup.scene


def test_an_empty_scene_and_one_that_is_a_dot_show_no_picture():
    scene = ss.Scene()
    assert "0 entries" in scene._repr_html_()
    scene.add_spheres((1e30, 0, 0), 1e-3)
    assert scene._repr_html_().startswith("<p>Scene: 1 entry, 0 triangles</p><table>")


def test_a_large_scene_is_a_table_within_a_second():
    n = 708  # 2 · 707² triangles: a million
    x, y = np.meshgrid(np.arange(n), np.arange(n))
    corner = (np.arange(n - 1) + n * np.arange(n - 1)[:, None]).ravel()
    faces = np.concatenate([corner[:, None] + [0, 1, n + 1], corner[:, None] + [0, n + 1, n]])
    scene = ss.Scene()
    scene.add((np.stack([x, y, np.sin(x)], axis=-1).reshape(-1, 3), faces), "field")
    start = time.process_time()
    html = scene._repr_html_()
    assert time.process_time() - start < 1  # measured: 0.1 to 0.5, by what else runs
    assert "999698" in html
    assert not pictures(html)


def test_many_entries_are_cut_short():
    scene = ss.Scene()
    for i in range(showing.MOST_ENTRIES + 7):
        scene.add_spheres((i, 0, 0), 0.3)
    html = scene._repr_html_()
    assert html.count("<tr>") == showing.MOST_ENTRIES + 1
    assert "and 7 more" in html


def test_an_image_is_its_visibility(setup):
    image = ss.render(setup.scene, setup.camera, setup.light, "hard")
    shown = imread(BytesIO(image._repr_png_()))[..., 0]
    dark = (shown[30:-10, 10:-10] < 128).mean()
    # The frame and its title take a part of the picture; the shadow is about the same part of it.
    assert dark == pytest.approx((image.visibility < 0.5).mean(), abs=0.03)
    mean = image.visibility[image.mask].mean()
    assert repr(image) == f"Image(96x72, 1 light, mean visibility {mean:.3f})"


def test_an_image_of_several_lights_shows_each(setup):
    lights = [setup.light, ss.SphereLight((2, -1, 3), 0.2)]
    image = ss.render(setup.scene, setup.camera, lights, "hard")
    one = imread(BytesIO(ss.render(setup.scene, setup.camera, lights[0], "hard")._repr_png_()))
    both = imread(BytesIO(image._repr_png_()))
    assert both.shape[1] / both.shape[0] > 2 * one.shape[1] / one.shape[0]
    assert "96x72, 2 lights" in repr(image)


def test_an_image_of_nothing_shows_itself(setup):
    away = ss.Camera((0, 0, 5), (0, 0, 9), up=(0, 1, 0), width=8, height=8)
    image = ss.render(setup.scene, away, setup.light, "hard")
    assert repr(image) == "Image(8x8, 1 light, no surface hit)"
    assert image._repr_png_().startswith(b"\x89PNG")


def test_noise_is_few_bytes():
    """The picture that compresses least; fewer dots an inch then have to do."""
    rng = np.random.default_rng(0)
    size = (512, 512)
    noise = rng.random((12, *size), dtype=np.float32)
    flat = np.zeros((*size, 3), dtype=np.float32)
    hit, index = np.ones(size, dtype=bool), np.zeros(size, dtype=np.int32)
    image = ss.Image(noise, flat, hit, flat, flat, index, index, index, {}, 0)
    assert len(image._repr_png_()) <= MOST_BYTES


def test_a_comparison_is_its_table_with_the_front_and_a_strip(result):
    html = result._repr_html_()
    table = re.findall("<tr>(.*?)</tr>", html.partition("<p>")[0], re.S)
    stars = [re.findall("<td>(.*?)</td>", line)[:2] for line in table]
    on = ss.front(result.table)
    assert [star == "*" for star, _ in stars] == on.tolist()
    assert [label for _, label in stars] == list(result.images)
    assert "on the front" in html
    assert len(pictures(html)) == 1
    assert len(html) < MOST_BYTES * 4 / 3 + 10_000


def test_a_comparison_prints_its_table(result):
    lines = repr(result).splitlines()
    assert len(lines) == len(result.images) + 2
    assert lines[-1].startswith("* on the front")


def test_what_was_left_out_is_said(result):
    html = ss.Comparison(result.table, result.images, result.reference, {"a<b": "slow"})
    assert "left out: a&lt;b: slow" in html._repr_html_()
