"""The command line: what it writes, prints and returns."""

from __future__ import annotations

import math
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import OpenEXR
import pytest
import softshadow as ss
import trimesh
from gltf_files import glb
from softshadow import cli, framing

SMALL = ["--size", "32x24", "--samples", "8"]


@pytest.fixture(scope="module")
def box(tmp_path_factory):
    """A model file: a unit box."""
    path = tmp_path_factory.mktemp("models") / "box.ply"
    trimesh.creation.box().export(path)
    return str(path)


@pytest.fixture
def fails(capsys):
    """Run a command line that must fail, and return its one line on stderr."""

    def run(*arguments):
        assert cli.main([str(x) for x in arguments]) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert err.count("\n") == 1, err
        assert err.startswith("error: ")
        return err

    return run


def test_render_writes_a_picture_with_light_and_shadow(box, tmp_path, capsys):
    out = tmp_path / "out.png"
    assert cli.main(["render", box, *SMALL, "-o", str(out)]) == 0
    picture = imageio.imread(out)
    assert picture.shape == (24, 32)
    assert picture.min() == 0
    assert picture.max() == 255
    said = capsys.readouterr()
    assert said.out.startswith(f"{out}: visibility, 32x24, RayTraced(samples=8")
    assert "ray_traced: frame" in said.err  # the progress bar


def test_auto_tells_the_error_that_it_found(box, tmp_path, capsys):
    out = tmp_path / "out.npy"
    arguments = ["--method", "auto", "--set", "error=0.05", "--size", "32x24"]
    assert cli.main(["render", box, *arguments, "-o", str(out)]) == 0
    said = capsys.readouterr().out
    found = re.search(r", error ([\d.e-]+) \(([\d.e-]+) to ([\d.e-]+)\)$", said.strip())
    rmse, low, high = map(float, found.groups())
    assert low <= rmse <= high <= 0.05
    assert np.load(out).shape == (24, 32)


def test_render_is_the_python_call(box, tmp_path):
    out = tmp_path / "out.npy"
    arguments = ["--light", "rect:2,-1,3,0,0.5,0,0.5,0,0", "--eye", "-1,-4,2", "--target", "0,0,0"]
    arguments += ["--fov", "60", "--seed", "5", *SMALL, "-o", str(out)]
    assert cli.main(["render", box, *arguments]) == 0
    scene = ss.Scene.load(box)
    framing.add_ground(scene)
    camera = ss.Camera((-1, -4, 2), (0, 0, 0), fov_y_deg=60, width=32, height=24)
    light = ss.RectLight((2, -1, 3), (0, 0.5, 0), (0.5, 0, 0))
    image = ss.render(scene, camera, light, ss.RayTraced(samples=8, seed=5))
    assert np.array_equal(np.load(out), image.visibility)
    assert 0 < image.visibility.min(initial=1, where=image.visibility > 0) < 1


def test_render_writes_radiance_as_exr(box, tmp_path):
    out = tmp_path / "out.exr"
    assert cli.main(["render", box, *SMALL, "--what", "radiance", "-o", str(out)]) == 0
    pixels = OpenEXR.File(str(out)).channels()["RGB"].pixels
    assert pixels.shape == (24, 32, 3)
    assert pixels.max() > 0


def test_width_and_height_override_the_size(box, tmp_path):
    out = tmp_path / "out.npy"
    arguments = ["--method", "hard", "--size", "64x64", "--width", "20", "--height", "10"]
    assert cli.main(["render", box, *arguments, "-o", str(out)]) == 0
    assert np.load(out).shape == (10, 20)


def test_without_ground_only_the_model_is_hit(box, tmp_path):
    pixels = {}
    for flag in ("--ground", "--no-ground"):
        out = tmp_path / f"{flag}.npy"
        arguments = ["--what", "radiance", "--method", "hard", "--size", "64x64", flag]
        assert cli.main(["render", box, *arguments, "-o", str(out)]) == 0
        pixels[flag] = int((np.load(out).max(axis=2) > 0).sum())
    assert pixels["--ground"] > 2 * pixels["--no-ground"] > 0


def test_a_camera_straight_above_works(box, tmp_path):
    out = tmp_path / "out.npy"
    arguments = ["--eye", "0,0,6", "--target", "0,0,0", *SMALL, "-o", str(out)]
    assert cli.main(["render", box, *arguments]) == 0
    assert np.load(out).min() < 1


def test_several_lights_give_their_mean_or_each(box, tmp_path):
    lights = [ss.SphereLight((2, -1, 3), 0.5), ss.DiskLight((-2, 0, 3), (1, 0, -1), 0.4)]
    arguments = ["--light", "sphere:2,-1,3,0.5", "--light", "disk:-2,0,3,1,0,-1,0.4", *SMALL]
    for name in ("out.npy", "out.png"):
        assert cli.main(["render", box, *arguments, "-o", str(tmp_path / name)]) == 0
    setup = ss.frame(ss.Scene.load(box), width=32, height=24)
    seen = ss.render(setup.scene, setup.camera, lights, ss.RayTraced(samples=8)).visibility
    assert np.array_equal(np.load(tmp_path / "out.npy"), seen)
    picture = imageio.imread(tmp_path / "out.png")
    assert np.array_equal(picture, np.rint(255.0 * seen.mean(axis=0)))


def test_any_parameter_of_a_method_can_be_set(box, tmp_path, capsys):
    command = ["render", box, "--size", "32x24", "-o", str(tmp_path / "a.png")]
    settings = ["--method", "mtsm", "--set", "resolution=64", "--set", "layers=None"]
    assert cli.main([*command, *settings, "--samples", "4"]) == 0
    assert "Mtsm(resolution=64, layers=None" in capsys.readouterr().out
    fixed = ["--set", "pattern=fixed", "--set", "samples = 16", "--set", "cull=False"]
    assert cli.main([*command, *fixed]) == 0
    said = capsys.readouterr().out
    assert all(x in said for x in ("samples=16", "pattern='fixed'", "cull=False"))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (["--set", "resolution"], "expected NAME=VALUE, such as resolution=2048"),
        (["--set", "views=3"], "method 'ray_traced' has no such parameter, but samples, seed"),
        (["--set", "samples=0"], "samples: expected an integer from 1 to 65536"),
        (["--set", "samples=many"], "samples: expected an integer"),
        (["--set", "samples=4", "--samples", "4"], "samples is given twice"),
        (["--set", "pattern=woven"], "pattern"),
        (["--up", "x"], "--up"),
        (["--light-radius", "-1"], "light_radius: expected a positive number"),
    ],
)
def test_a_bad_setting_is_an_error_before_a_model_is_read(fails, tmp_path, settings, message):
    assert message in fails("render", "nothing.ply", *settings, "-o", tmp_path / "a.png")


def test_a_bad_camera_is_an_error_before_a_model_is_read(fails, tmp_path):
    for options, message in (
        (["--eye", "1,2"], "expected 3 numbers"),
        (["--eye", "1,2,3", "--target", "1,2,3"], "same point"),
        (["--fov", "180"], "fov"),
        (["--width", "0"], "Camera.width"),
    ):
        assert message in fails("render", "nothing.ply", *options, "-o", tmp_path / "a.png")


def test_a_model_with_y_up_is_turned(tmp_path):
    plank = trimesh.creation.box((1, 3, 0.5))
    plank.export(tmp_path / "y.ply")
    plank.apply_transform([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    plank.export(tmp_path / "z.ply")
    for name in "yz":
        model, out = (str(tmp_path / f"{name}.{kind}") for kind in ("ply", "npy"))
        assert cli.main(["render", model, "--up", name, *SMALL, "-o", out]) == 0
    assert np.array_equal(np.load(tmp_path / "y.npy"), np.load(tmp_path / "z.npy"))


def _room(tmp_path, camera=True):
    """A GLB file with a box over a floor, a point light, a spot light and a camera."""
    scene = trimesh.Scene({"box": trimesh.creation.box()})
    scene.add_geometry(trimesh.creation.box((8, 8, 0.1)), node_name="floor")
    lights = [
        {"type": "point", "intensity": 9, "extras": {"radius": 0.3}},
        {"type": "spot", "name": "torch"},
    ]
    lens = {"yfov": 0.7, "aspectRatio": 1.5, "znear": 0.1}

    def change(header):
        header["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
        header["cameras"] = [{"type": "perspective", "perspective": lens}]
        header["nodes"] += [
            {"translation": [2, 1, 3 + i], "extensions": {"KHR_lights_punctual": {"light": i}}}
            for i in range(2)
        ]
        header["nodes"] += [{"translation": [0, 0, 9], **({"camera": 0} if camera else {})}]
        count = len(header["nodes"])
        header["scenes"][0]["nodes"] += [count - 3, count - 2, count - 1]

    path = tmp_path / "room.glb"
    path.write_bytes(glb(scene, change))
    return path


def test_a_scene_file_has_its_own_lights_and_camera(tmp_path, capsys):
    path, out = _room(tmp_path), tmp_path / "out.npy"
    arguments = ["render", str(path), "--samples", "8", "-o", str(out)]
    assert cli.main([*arguments, "--height", "40"]) == 0
    said = capsys.readouterr()
    assert "out.npy: visibility, 60x40" in said.out
    assert f"warning: {path}: not understood and left out: light 'torch' (spot)" in said.err
    with pytest.warns(UserWarning, match="torch"):
        setup = ss.load(path, height=40)
    method = ss.RayTraced(samples=8)
    own = ss.render(setup.scene, setup.camera, setup.lights[0], method)
    assert np.array_equal(np.load(out), own.visibility)
    # What is given goes before the file's.
    given = ["--light", "sphere:2,1,3,0.5", "--eye", "0,-9,5", "--fov", "30", *SMALL[:2]]
    assert cli.main([*arguments, *given, "--ground"]) == 0
    framing.add_ground(setup.scene)
    light = ss.SphereLight((2, 1, 3), 0.5)
    middle = ss.Scene.load(path).bounds.mean(axis=0)
    camera = ss.Camera((0, -9, 5), middle, fov_y_deg=30, width=32, height=24)
    other = ss.render(setup.scene, camera, light, method)
    assert np.array_equal(np.load(out), other.visibility)
    assert cli.main([*arguments, "--fov", "20", "--size", "30x30"]) == 0
    plain = ss.Camera((0, 0, 9), (0, 0, 0), (0, 1, 0), 20, 30, 30)
    assert np.load(out).shape == (30, 30)
    near = ss.render(ss.Scene.load(path), plain, setup.lights[0], method)
    assert np.mean(np.load(out) != near.visibility) < 0.01  # samples depend on the pixel alone


def test_a_file_without_a_camera_is_framed_but_keeps_its_lights(tmp_path):
    path, out = _room(tmp_path, camera=False), tmp_path / "out.npy"
    assert cli.main(["render", str(path), *SMALL, "-o", str(out)]) == 0
    with pytest.warns(UserWarning, match="torch"):
        found = ss.load(path)
    shown = ss.frame(found.scene, width=32, height=24, ground=False)
    image = ss.render(shown.scene, shown.camera, found.lights[0], ss.RayTraced(samples=8))
    assert np.array_equal(np.load(out), image.visibility)


COMPARE = ["--size", "48x32", "--repeats", "1", "--method", "hard", "--method", "ray_traced"]


def test_compare_prints_the_table_and_writes_pictures_and_a_page(box, tmp_path, capsys):
    folder = tmp_path / "new" / "folder"
    assert cli.main(["compare", box, *COMPARE, "-o", str(folder)]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0].startswith(f"{box}: Scene(box, ground")
    assert said[1].split()[:3] == ["method", "prepare", "s"]
    rows = {line.split()[-11]: line for line in said[2:4]}
    assert set(rows) == {"hard", "ray_traced"}
    assert rows["ray_traced"].startswith("*")
    names = {"box.png", "box_strip.png", "box_front.png", "box_profile.png", "box.csv"}
    assert {path.name for path in folder.iterdir()} == names | {"report.html"}
    assert {Path(line).name for line in said if line.startswith(str(folder))} == names | {
        "report.html"
    }
    assert f"softshadow compare {box} --size 48x32" in (folder / "report.html").read_text()


def test_compare_ends_soon_after_its_budget(box, tmp_path, capsys):
    command = ["compare", box, "--size", "128x128", "--repeats", "1", "--budget", "10"]
    command += ["--method", "hard", "--method", "convolution", "-o", str(tmp_path)]
    start = time.perf_counter()
    assert cli.main(command) == 0
    assert time.perf_counter() - start < 60
    assert "hard" in capsys.readouterr().out


def test_compare_takes_several_models_and_numbers_the_same_names(box, tmp_path, capsys):
    other = tmp_path / "other"
    other.mkdir()
    twin = shutil.copy(box, other)
    command = ["compare", box, twin, *COMPARE, "--budget", "0", "-o", str(tmp_path / "out")]
    assert cli.main(command) == 0
    assert (tmp_path / "out" / "box_2_strip.png").is_file()
    page = (tmp_path / "out" / "report.html").read_text()
    assert "4 cases, 2 methods, 2 settings" in page


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--budget", "-1"], "--budget"),
        (["--method", "magic"], "unknown name 'magic'"),
        (["--repeats", "0"], "repeats"),
        (["--light", "cube:1"], "expected one of rect:"),
    ],
)
def test_a_bad_comparison_is_an_error(fails, box, tmp_path, arguments, message):
    assert message in fails("compare", box, *arguments, "-o", tmp_path / "out")


def test_methods_lists_every_method_and_what_it_can(capsys):
    assert cli.main(["methods"]) == 0
    lines = capsys.readouterr().out.splitlines()
    rows = {line.split()[0]: line for line in lines if line}
    assert set(ss.method_names()) <= set(rows)
    assert lines[0].split() == ["method", "transparent", "points", "parameters"]
    assert rows["ray_traced"].split()[1:3] == ["yes", "yes"]
    assert "samples=256" in rows["ray_traced"]


def test_version_is_the_package_s(capsys):
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"softshadow {ss.__version__}\n"


@pytest.mark.parametrize("arguments", [[], ["--help"], ["render", "--help"]])
def test_help_is_printed(arguments, capsys):
    assert cli.main(arguments) == 0
    assert "Usage: softshadow" in capsys.readouterr().out


def test_an_unknown_method_is_an_error_that_lists_the_names(fails, box, tmp_path):
    message = fails("render", box, "--method", "magic", "-o", tmp_path / "a.png")
    assert "unknown name 'magic'" in message
    assert "ray_traced" in message


def test_a_parameter_that_the_method_lacks_is_an_error(fails, box, tmp_path):
    command = ["render", box, "--method", "hard", "--samples", "4", "-o", tmp_path / "a.png"]
    assert "method 'hard' has no such parameter" in fails(*command)


@pytest.mark.parametrize(
    ("light", "message"),
    [
        ("cube:1,2,3", "expected one of rect:"),
        ("sphere:1,2,3", "expected 4 numbers as in sphere:cx,cy,cz,r"),
        ("sphere:1,2,3,x", "expected 4 numbers"),
        ("rect:0,0,3,1,0,0,2,0,0", "RectLight"),
        ("sphere:0,0,nan,1", "finite"),
    ],
)
def test_a_bad_light_is_an_error(fails, box, tmp_path, light, message):
    assert message in fails("render", box, "--light", light, "-o", tmp_path / "a.png")


def test_a_missing_model_is_an_error(fails, tmp_path):
    assert "nothing.ply: no such file" in fails(
        "render", tmp_path / "nothing.ply", "-o", tmp_path / "a.png"
    )


def test_a_file_that_is_no_model_is_an_error(fails, tmp_path):
    (tmp_path / "text.ply").write_text("not a mesh")
    message = fails("render", tmp_path / "text.ply", "-o", tmp_path / "a.png")
    assert "cannot be read as a mesh" in message


def test_an_unwritable_output_is_an_error_before_rendering(fails, box, tmp_path):
    assert "there is no folder" in fails("render", box, "-o", tmp_path / "no" / "a.png")
    assert "unknown file type" in fails("render", box, "-o", tmp_path / "a.gif")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--size", "512"], "expected WxH"),
        (["--eye", "1,2"], "expected 3 numbers as in x,y,z"),
        (["--eye", "1,2,3", "--target", "1,2,3"], "same point"),
        (["--fov", "180"], "fov"),
        (["--samples", "0"], "samples"),
        (["--samples", "many"], "--samples"),
        (["--what", "depth"], "--what"),
        (["--width", "0"], "Camera"),
        (["--colour", "red"], "--colour"),
    ],
)
def test_a_bad_option_is_an_error(fails, box, tmp_path, arguments, message):
    assert message in fails("render", box, *arguments, "-o", tmp_path / "a.png")


def test_a_missing_output_and_an_unknown_command_are_errors(fails, box):
    assert "--output" in fails("render", box)
    assert "shade" in fails("shade", box)


def test_ctrl_c_is_exit_code_130(box, tmp_path, monkeypatch):
    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "render_image", interrupted)
    assert cli.main(["render", box, *SMALL, "-o", str(tmp_path / "a.png")]) == 130
    assert not (tmp_path / "a.png").exists()


def _children_seconds():
    """Processor time of the processes that this one started and waited for."""
    used = os.times()
    return used.children_user + used.children_system


def _seconds_of(pid):
    """Processor time of a process so far; without end where the system does not say."""
    file = Path(f"/proc/{pid}/stat")
    if not file.exists():
        return math.inf
    user, system = file.read_text().rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_a_long_render_stops_soon_after_ctrl_c(box, tmp_path):
    command = [sys.executable, "-m", "softshadow", "render", box, "--samples", "65536"]
    command += ["--size", "2048x2048", "-o", str(tmp_path / "a.png")]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL) as process:
        assert process.stderr is not None
        seen = b""
        while b"frame" not in seen:  # it is rendering
            piece = process.stderr.read1()
            assert piece, seen
            seen += piece
        time.sleep(0.3)
        before = _children_seconds() + _seconds_of(process.pid)
        process.send_signal(signal.SIGINT)
        process.stderr.read()
        assert process.wait(timeout=60) == 130
        # Processor time: 0.2 s of two threads, and the interpreter's own way out.
        assert _children_seconds() - before < 2.0
    assert not (tmp_path / "a.png").exists()


def test_the_framed_box_is_whole_in_the_picture_and_lit_from_its_side():
    scene = ss.Scene()
    scene.add(trimesh.creation.box().apply_scale((2, 1, 3)).apply_translation((50, 0, 7)))
    for width, height in ((512, 512), (200, 600), (600, 200)):
        camera, light = framing.frame(scene, width=width, height=height)
        corners = trimesh.bounds.corners(scene.bounds) - camera.eye
        x, y, z = camera.K @ camera.camera_to_world[:3, :3].T @ corners.T
        assert (z > 0).all()
        assert ((x / z > 0) & (x / z < width)).all()
        assert ((y / z > 0) & (y / z < height)).all()
        assert np.ptp(y / z) / height > 0.3 or np.ptp(x / z) / width > 0.3
    center = np.array(light.center)
    away = scene.bounds.mean(axis=0) - center
    facing = np.cross(light.edge_u, light.edge_v)
    assert np.allclose(facing / np.linalg.norm(facing), away / np.linalg.norm(away))
    assert center[2] > scene.bounds[1, 2]
    edges = [np.linalg.norm(light.edge_u), np.linalg.norm(light.edge_v)]
    assert np.allclose(edges, np.linalg.norm(away) / 5)


def test_a_framed_scene_is_a_copy_with_a_ground():
    scene = ss.Scene()
    scene.add_spheres((0, 0, 1), 0.5, "ground")
    setup = ss.frame(scene, 30, 64, 48)
    assert scene.names == ("ground",)
    assert setup.scene.names == ("ground", "ground_2")
    assert (setup.camera, setup.lights[0]) == framing.frame(scene, 30, 64, 48)
    assert ss.frame(scene, ground=False).scene.names == ("ground",)
    with pytest.raises(ValueError, match="no meshes"):
        ss.frame(ss.Scene())


def test_a_camera_looks_straight_down_without_an_up():
    down = ss.Camera((1, 2, 5), (1, 2, 0), width=8, height=8)
    assert down == ss.Camera((1, 2, 5), (1, 2, 0), (0, 1, 0), width=8, height=8)
    above = ss.Camera((1, 2, -5), (1, 2, 0), width=8, height=8)
    assert above == ss.Camera((1, 2, -5), (1, 2, 0), (0, 1, 0), width=8, height=8)


def test_the_ground_is_four_times_the_model_and_below_it():
    scene = ss.Scene()
    scene.add(trimesh.creation.box((1, 2, 3)).apply_translation((5, 5, 5)))
    name = framing.add_ground(scene)
    ground = scene.meshes[-1]
    assert ground.name == name == "ground"
    assert np.ptp(ground.vertices, axis=0) == pytest.approx([12, 12, 0])
    assert ground.vertices.mean(axis=0)[:2] == pytest.approx([5, 5])
    assert 3.5 - 0.001 < ground.vertices[0, 2] < 3.5


@pytest.mark.parametrize(
    "options",
    [
        ("--seed", "-1"),
        ("--seed", str(2**64)),
        ("--samples", "99999999999999999999"),
        ("--samples", "0"),
        ("--samples", "1.5"),
        ("--width", "0"),
        ("--height", "65537"),
        ("--size", "99999999999999999999x1"),
        ("--fov", "nan"),
        ("--fov", "1e400"),
        ("--exposure", "nan"),
        ("--exposure", "0"),
        ("--eye", "0,0,inf"),
        ("--target", "0,nan,0"),
        ("--light", "sphere:0,0,1e400,1"),
        ("--light", "disk:0,0,1,0,0,0,1"),
    ],
)
def test_numbers_out_of_range_are_one_line_and_exit_code_two(tmp_path, capsys, options):
    model = tmp_path / "box.ply"
    trimesh.creation.box().export(model)
    name, value = options
    code = cli.main(["render", str(model), "-o", str(tmp_path / "x.png"), name, value])
    error = capsys.readouterr().err
    assert code == 2
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    assert "Traceback" not in error
    assert not (tmp_path / "x.png").exists()
