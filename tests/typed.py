"""What a type checker knows of the public surface; `make lint` checks it, `test_api.py` runs it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pandas as pd
import softshadow as ss


def lights() -> tuple[float, float]:
    """Fields are what is stored, whatever was given."""
    rect = ss.RectLight([0, 0, 4], np.array([0, 1, 0]), (1, 0, 0), radiance=2)
    disk = ss.DiskLight(center=(0, 0, 4), normal=(0, 0, -1), radius=0.5)
    sphere = ss.SphereLight((0, 0, 4), 0.5, (1, 2, 3))
    distant = ss.DistantLight((0, 0, -1), irradiance=2)
    either: ss.Light = rect
    seen = either.irradiance if isinstance(either, ss.DistantLight) else either.radiance
    height: float = rect.center[2] + disk.normal[2] + sphere.center[2] + rect.edge_u[0]
    brightness: float = sum(rect.radiance) + max(seen) + disk.radius + sphere.radius
    brightness += max(distant.irradiance) + distant.angle_deg
    return height, brightness


def pictures() -> npt.NDArray[np.float32]:
    """What a scene becomes, by name and by object."""
    scene = ss.Scene()
    name: str = scene.add(ss.scenes.square(2.0), albedo=0.5)
    albedo: tuple[float, float, float] = scene[name].albedo
    entries: tuple[ss.Mesh | ss.Spheres, ...] = scene.entries
    camera = ss.Camera((0, -4, 3), (0, 0, 0), width=8, height=8)
    eye: npt.NDArray[np.float64] = camera.eye
    light = ss.SphereLight((0, 0, 4), 0.5)
    image: ss.Image = ss.render(scene, camera, light, ss.RayTraced(samples=4))
    prepared: ss.Prepared = ss.prepare(scene, [light, light], "hard", progress=lambda x: None)
    method: ss.Method = prepared.method
    seconds: dict[str, float] = prepared.render(camera).seconds
    baked: ss.Bake = ss.bake(scene, light, name, max_size=8)
    texture: ss.BakedTexture = baked[0]
    rest: list[ss.BakedTexture] = baked[1:]
    error: float = ss.metrics.mae(image.visibility, image.visibility)
    assert (albedo, len(entries), eye.shape, method.name) == ((0.5, 0.5, 0.5), 1, (3,), "hard")
    assert (len(rest), error) == (0, 0.0)
    assert seconds
    return texture.visibility


def files(path: str) -> tuple[ss.Light, ...]:
    """What files hold, and a camera where they have none."""
    scene: ss.Scene = ss.Scene.load(path, up="y", scale=0.001, opacity=0.5)
    setup: ss.Setup = ss.load(path, light_radius=0.1)
    camera: ss.Camera | None = setup.camera or ss.frame(scene).camera
    given: npt.NDArray[np.float32] = ss.irradiance(
        scene, [(0, 0, 0)], [(0, 0, 1)], setup.lights or ss.SphereLight((0, 0, 4), 0.5)
    )
    assert camera is not None
    assert given.shape == (1, 3)
    return setup.lights


def sweeps(store: str) -> pd.DataFrame:
    """What is measured, and its table."""
    setup = ss.scenes.half_plane(8, 8)
    cases: list[ss.Case] = ss.grid(setup, {"own": None}, setup.camera, ["hard"])
    name: str = cases[0].scene_name
    assert name
    return ss.sweep(cases, store, reference=ss.RayTraced(16), repeats=1, progress=False)


def maps() -> npt.NDArray[np.float32]:
    """Kernels, and what is imported when it is used."""
    setup: ss.scenes.Setup = ss.scenes.half_plane(8, 8)
    points, weights, colours = ss.kernels.light_samples(setup.light, (0, 0, 0), 4)
    seen = ss.kernels.transmittance(setup.scene, points * 0, points)
    found: list[ss.kernels.LayeredMap] = ss.kernels.layered_maps(
        setup.scene, setup.light, ss.Slsm(16)
    )
    depths: npt.NDArray[np.float64] = found[0].depths
    assert points.dtype == depths.dtype
    assert len(weights) == len(colours)
    return seen
