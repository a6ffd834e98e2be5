"""Soft shadows of area lights on the CPU.

>>> import softshadow as ss
>>> scene = ss.Scene()
>>> ground = scene.add(ss.scenes.square(3))  # or a path, a trimesh.Trimesh, (vertices, faces)
>>> ball = scene.add_spheres((0, 0, 1), 0.5)
>>> camera = ss.Camera(eye=(0, -6, 4), target=(0, 0, 0.5), width=32, height=24)
>>> light = ss.RectLight(center=(1, 0, 4), edge_u=(0, 1, 0), edge_v=(1, 0, 0))
>>> image = ss.render(scene, camera, light, method="ray_traced")
>>> image.visibility.shape
(24, 32)

Conventions: right-handed world space, world units for all sizes, arrays indexed ``[y, x]`` with
row 0 on top, *visibility* is 1 where fully lit and 0 in the umbra.
"""

from importlib import import_module as _import_module
from types import ModuleType as _ModuleType
from typing import TYPE_CHECKING as _TYPE_CHECKING

from softshadow import kernels, metrics
from softshadow._core import (
    OutOfMemoryError,
    ParameterError,
    SceneError,
    UnsupportedError,
    __version__,
)
from softshadow.auto import Step
from softshadow.bake import Bake, BakedTexture, Polygon, bake, bake_layout
from softshadow.camera import Camera
from softshadow.compare import Comparison, compare
from softshadow.entries import Curves, Mesh, Spheres
from softshadow.estimate import ErrorEstimate, estimate_error, estimate_error_at
from softshadow.fronts import front
from softshadow.light import (
    DiskLight,
    DistantLight,
    Light,
    PolygonLight,
    RectLight,
    SphereLight,
)
from softshadow.loading import Setup, frame, load
from softshadow.methods import (
    Accumulation,
    Auto,
    Convolution,
    Counted,
    DeepShadow,
    Hard,
    Method,
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
    method_names,
)
from softshadow.parallel import set_threads, thread_count, threads
from softshadow.render import Image, Prepared, irradiance, prepare, render, visibility
from softshadow.report import report
from softshadow.scene import Scene
from softshadow.sweep import Case, grid, sweep
from softshadow.widget import widget

for _error in (OutOfMemoryError, ParameterError, SceneError, UnsupportedError):
    _error.__module__ = __name__  # where users and pickles find them
del _error

if _TYPE_CHECKING:
    from softshadow import mitsuba, plot, scenes

__all__ = [
    "Accumulation",
    "Auto",
    "Bake",
    "BakedTexture",
    "Camera",
    "Case",
    "Comparison",
    "Convolution",
    "Counted",
    "Curves",
    "DeepShadow",
    "DiskLight",
    "DistantLight",
    "ErrorEstimate",
    "Hard",
    "Image",
    "Light",
    "Mesh",
    "Method",
    "Mlsm",
    "Mtsm",
    "Mvsm",
    "OutOfMemoryError",
    "ParameterError",
    "Pcf",
    "Polygon",
    "PolygonLight",
    "Prepared",
    "RayTraced",
    "RectLight",
    "Scene",
    "SceneError",
    "Setup",
    "ShadowVolume",
    "SingleSample",
    "Slsm",
    "SphereLight",
    "Spheres",
    "Ssoc",
    "Step",
    "UnsupportedError",
    "Wedges",
    "__version__",
    "bake",
    "bake_layout",
    "compare",
    "estimate_error",
    "estimate_error_at",
    "frame",
    "front",
    "grid",
    "irradiance",
    "kernels",
    "load",
    "method_names",
    "metrics",
    "mitsuba",
    "plot",
    "prepare",
    "render",
    "report",
    "scenes",
    "set_threads",
    "sweep",
    "thread_count",
    "threads",
    "visibility",
    "widget",
]


def __getattr__(name: str) -> _ModuleType:
    """Import what few programs use, and what takes long, when it is used."""
    if name in ("mitsuba", "plot", "scenes"):
        return _import_module(f"softshadow.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
