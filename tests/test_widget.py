"""The widget: what changes its picture, what is said when there is none, and its browser's side."""

from __future__ import annotations

import asyncio
import base64
import io
import json
import sys
from pathlib import Path

import numpy as np
import pytest
import softshadow as ss
from browser import BROWSER, opened
from PIL import Image as Pixels

pytest.importorskip("anywidget")
from softshadow.widget.moving import dragged, placed, width_of
from traitlets import TraitError

SIZE = 48, 32
LIGHTS = {
    "rect": ss.RectLight((0.5, 0, 4), (0, 0.5, 0), (0.8, 0, 0), radiance=(5, 6, 7)),
    "disk": ss.DiskLight((0.5, 0, 4), (0, 0, -1), 0.4, radiance=5),
    "sphere": ss.SphereLight((0.5, 0, 4), 0.4, radiance=5),
}


def made(light="rect", **options):
    setup = ss.scenes.stacked_boards(*SIZE)
    return ss.widget(setup.scene, setup.camera, LIGHTS[light], **options), setup


def pixels(moving):
    return np.asarray(Pixels.open(io.BytesIO(moving.picture)))


def ask(moving, **wanted):
    """What the browser does."""
    moving._handle_custom_msg(wanted, [])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("center", (1.0, 0.5, 3.0)),
        ("width", 1.6),
        ("method", "hard"),
        ("what", "visibility"),
    ],
)
def test_each_trait_changes_the_picture_once(name, value):
    moving, _ = made()
    before = moving.picture
    setattr(moving, name, value)
    assert moving.picture != before
    assert moving.answers == 2
    setattr(moving, name, value)
    assert moving.answers == 2


@pytest.mark.parametrize("light", LIGHTS)
def test_the_picture_is_what_rendering_gives(light):
    moving, setup = made(light, what="visibility")
    ask(moving, width=1.0, drag={"start": (0.5, 0, 4), "pixels": (3, 2), "away": False})
    image = ss.render(setup.scene, setup.camera, moving.light, "wedges")
    assert np.array_equal(image.visibility, moving.image.visibility)
    # JPEG rounds: measured 7 levels at most.
    assert np.abs(pixels(moving) - 255 * image.visibility).max() < 16
    moving.what = "radiance"
    assert pixels(moving).shape == (*SIZE[::-1], 3)


def test_the_exposure_stays_so_that_a_light_far_away_is_dark():
    moving, _ = made("sphere")
    near = pixels(moving).mean()
    moving.center = (0.5, 0, 12)
    assert pixels(moving).mean() < 0.6 * near


@pytest.mark.parametrize("light", LIGHTS)
def test_a_light_of_another_width_keeps_its_power(light):
    moving, _ = made(light)
    start = LIGHTS[light]
    assert moving.light == start
    assert moving.width == width_of(start) == 0.8
    moving.width = 0.2
    assert width_of(moving.light) == pytest.approx(0.2)
    points, normals = [(1.0, 2, 0)], [(0.0, 0, 1)]

    def arriving(x):
        return ss.kernels.unshadowed_irradiance(x, points, normals)[0] * x.radiance[0]

    # The irradiance of a small light depends on its power; the larger one is 0.2 of its distance
    # wide, of which the square is what shapes differ by.
    assert arriving(moving.light) == pytest.approx(arriving(start), rel=0.04)


def test_a_rectangle_keeps_its_proportions():
    light = placed(LIGHTS["rect"], (1, 2, 3), 0.4)
    assert light.center == (1, 2, 3)
    assert light.edge_u == (0, 0.25, 0)
    assert light.edge_v == (0.4, 0, 0)


def seen(camera, point):
    x, y, z, _ = np.linalg.inv(camera.camera_to_world) @ (*point, 1)
    return (camera.K @ (x, y, z))[:2] / z


def test_a_drag_moves_a_light_in_the_picture_with_the_pointer():
    camera = ss.Camera((0, -6, 3), (0, 0, 1), width=200, height=100)
    start = camera.eye + 4 * camera.camera_to_world[:3, 2]  # on the axis: distance is depth
    moved = dragged(camera, start, (30, -12), False)
    assert seen(camera, moved) - seen(camera, start) == pytest.approx((30, -12))
    assert np.dot(np.subtract(moved, start), camera.camera_to_world[:3, 2]) == pytest.approx(0)
    # Up is away: the axis stays where it is in the picture.
    farther = dragged(camera, start, (0, -12), True)
    assert seen(camera, farther) == pytest.approx(seen(camera, start))
    assert np.linalg.norm(farther - camera.eye) > 4.1
    # A light behind the eye can be moved, too.
    behind = camera.eye - camera.camera_to_world[:3, 2]
    assert dragged(camera, behind, (1, 0), False) != pytest.approx(behind)


def test_a_request_with_several_changes_is_drawn_once():
    moving, _ = made()
    ask(moving, width=0.4, method="hard", what="visibility")
    assert moving.answers == 2
    assert (moving.width, moving.method, moving.what) == (0.4, "hard", "visibility")


def test_what_a_method_cannot_do_is_shown_and_the_next_picture_clears_it():
    moving, setup = made()
    setup.scene.set_look(setup.scene.names[-1], opacity=0.5)
    before = moving.picture
    ask(moving, method="wedges", width=0.4)
    assert "cannot model an opacity" in moving.error
    assert moving.picture == before
    assert moving.answers == 2  # the browser may ask again
    with pytest.raises(ss.UnsupportedError):
        moving.redraw()
    ask(moving, method="ray_traced")
    assert moving.error == ""
    assert moving.picture != before
    with pytest.raises(ss.UnsupportedError):
        moving.method = "wedges"
    assert "cannot model an opacity" in moving.error


@pytest.mark.parametrize(
    ("wanted", "said"),
    [
        (dict(method="best"), "method: expected one of accumulation, "),
        (dict(width=0), "width: expected a positive number"),
        (dict(what="depth"), "depth"),
        (dict(drag={"start": (0, 0, np.nan), "pixels": (0, 0), "away": False}), "finite"),
    ],
)
def test_what_cannot_be_drawn_is_answered(wanted, said):
    moving, _ = made()
    ask(moving, **wanted)
    assert said in moving.error
    assert moving.answers == 2


def test_an_interrupt_ends_a_picture_and_is_answered(monkeypatch):
    moving, _ = made()

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(sys.modules["softshadow.widget.moving"], "prepare", interrupted)
    with pytest.raises(KeyboardInterrupt):
        ask(moving, width=0.4)
    assert moving.error == "KeyboardInterrupt"
    monkeypatch.undo()
    moving.width = 0.5  # redraws again
    assert moving.error == ""


def test_values_that_are_set_are_checked():
    moving, _ = made()
    for name, value in (("method", "best"), ("width", -1), ("what", "depth"), ("center", (1, 2))):
        with pytest.raises(TraitError):
            setattr(moving, name, value)
    assert moving.answers == 1


def test_methods_are_those_that_were_given():
    few = [ss.RayTraced(samples=4), "hard"]
    moving, _ = made(method="single_sample", methods=few)
    assert moving.methods == ["single_sample", "ray_traced(samples=4)", "hard"]
    moving.method = "ray_traced(samples=4)"
    assert set(made()[0].methods) == set(ss.method_names())


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        (dict(light=None), TypeError, "light: expected one light, got None"),
        (dict(light=[LIGHTS["rect"]]), TypeError, "light: expected one light"),
        (dict(light=ss.SphereLight((0, 0, 4), 0)), ValueError, "a size that can be changed"),
        (dict(scene=3), TypeError, "scene"),
        (dict(camera=3), TypeError, "camera"),
        (dict(what="depth"), ValueError, "what"),
        (dict(methods="hard"), TypeError, "put a single one in a list"),
        (dict(methods=["hard", ss.Hard()]), ValueError, "listed twice"),
        (dict(method="best"), ValueError, "unknown name"),
    ],
)
def test_bad_arguments_are_errors(options, error, message):
    setup = ss.scenes.stacked_boards(*SIZE)
    given = {"scene": setup.scene, "camera": setup.camera, "light": LIGHTS["rect"], **options}
    with pytest.raises(error, match=message):
        ss.widget(**given)


def test_a_page_without_a_kernel_has_the_picture():
    moving, _ = made()
    data, _ = moving._repr_mimebundle_()
    assert base64.b64decode(data["image/jpeg"]) == moving.picture
    assert "application/vnd.jupyter.widget-view+json" in data
    assert "0x" not in data["text/plain"]  # the same in every run
    assert data["text/plain"].startswith("ShadowWidget(method='wedges', what='radiance', light=")


PAGE = """<!DOCTYPE html><meta charset="utf-8"><style>{css}</style><div id="here"></div>
<script type="module">
{js}
const state = {state};
state.picture = Uint8Array.from(atob("{picture}"), (c) => c.charCodeAt(0));
const heard = {{}};
window.sent = [];
window.model = {{
  get: (name) => state[name],
  send: (asked) => sent.push(asked),
  on: (name, f) => (heard[name] ??= new Set()).add(f),
  off: (name, f) => heard[name].delete(f),
}};
window.answer = (changes) => {{
  Object.assign(state, changes);
  for (const name in changes) for (const f of heard[`change:${{name}}`] ?? []) f();
}};
window.heard = heard;
window.clean = widget.render({{ model, el: document.getElementById("here") }});
</script>"""


def _page(moving):
    folder = Path(ss.__file__).parent / "widget"
    js = (folder / "moving.js").read_text().replace("export default", "const widget =")
    names = ("center", "width", "widths", "method", "methods", "what", "text", "error", "answers")
    state = json.dumps({name: getattr(moving, name) for name in names})
    picture = base64.b64encode(moving.picture).decode()
    css = (folder / "moving.css").read_text()
    return PAGE.format(css=css, js=js, state=state, picture=picture)


@pytest.mark.skipif(not BROWSER, reason="no browser is installed")
def test_a_browser_asks_for_the_last_position_only_while_a_picture_is_drawn(tmp_path):
    moving, _ = made()
    file = tmp_path / "page.html"
    file.write_text(_page(moving))

    async def visit():
        async with opened(file.as_uri(), tmp_path / "profile") as page:
            await page.until("window.clean && document.querySelector('canvas').width == 48")
            box = await page.run(
                "(({x, y, width}) => [x, y, width])"
                "(document.querySelector('canvas').getBoundingClientRect())"
            )
            x, y = box[0] + 10, box[1] + 10
            await page.mouse("Moved", x, y)
            await page.mouse("Pressed", x, y)
            for step in range(1, 9):
                await page.mouse("Moved", x + step, y + 2 * step)
            assert await page.run("sent.length") == 1  # nothing was answered yet
            first = (await page.run("sent"))[0]["drag"]
            assert first["start"] == list(moving.center)
            await page.run("answer({answers: 2, text: 'drawn', center: [1, 2, 3]})")
            drag = (await page.run("sent"))[1]["drag"]
            assert drag == {**first, "pixels": pytest.approx([8, 16])}  # from where it began
            await page.run("answer({answers: 3})")
            assert await page.run("sent.length") == 2  # nothing has happened since
            await page.mouse("Released", x, y)
            await page.mouse("Moved", x + 20, y)
            assert await page.run("sent.length") == 2
            # Changes of two kinds become one request.
            await page.run(
                """
                const press = (selector, value, kind) => {
                  const it = document.querySelector(selector);
                  it.value = value;
                  it.dispatchEvent(new Event(kind));
                };
                press("input", 1.5, "input");
                press("input", 2.5, "input");
                press("select", "hard", "change");
                answer({answers: 4});
                """
            )
            one, other = (await page.run("sent"))[2:]
            assert one["width"] == pytest.approx(1.5, abs=0.01)  # of 500 steps
            assert other["width"] == pytest.approx(2.5, abs=0.01)
            assert other["method"] == "hard"
            await page.run("answer({answers: 5, error: 'no <b>light</b>'})")
            said = "document.querySelector('[role=alert]').textContent"
            assert await page.run(said) == "no <b>light</b>"
            assert await page.run("getComputedStyle(document.querySelector('canvas')).opacity") == (
                "0.35"
            )
            await page.run("clean()")
            assert await page.run("Object.values(heard).every((all) => all.size == 0)")

    asyncio.run(visit())
