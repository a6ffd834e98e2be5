"""Types of the compiled kernels; the documented surface is the package itself."""

from collections.abc import Callable
from types import ModuleType
from typing import Any, TypeAlias, final

import numpy as np
import numpy.typing as npt

_F64: TypeAlias = npt.NDArray[np.float64]
_F32: TypeAlias = npt.NDArray[np.float32]
_I32: TypeAlias = npt.NDArray[np.int32]
_I64: TypeAlias = npt.NDArray[np.int64]
_Bool: TypeAlias = npt.NDArray[np.bool_]
_Vec: TypeAlias = Any
_Progress: TypeAlias = Callable[[float], None] | None

__all__ = [
    "Camera",
    "Light",
    "Method",
    "OutOfMemoryError",
    "ParameterError",
    "Prepared",
    "Scene",
    "SceneError",
    "Textures",
    "UnsupportedError",
    "__version__",
    "kernels",
    "prepare",
    "set_threads",
    "simd_level",
    "textures",
    "thread_count",
]

__version__: str
kernels: ModuleType

class SceneError(ValueError): ...
class ParameterError(ValueError): ...
class OutOfMemoryError(ParameterError, MemoryError): ...
class UnsupportedError(ValueError): ...

@final
class Light:
    @staticmethod
    def rect(center: _Vec, edge_u: _Vec, edge_v: _Vec, radiance: _Vec) -> Light: ...
    @staticmethod
    def disk(center: _Vec, normal: _Vec, radius: float, radiance: _Vec) -> Light: ...
    @staticmethod
    def distant(direction: _Vec, angle: float, irradiance: _Vec) -> Light: ...
    @staticmethod
    def sphere(center: _Vec, radius: float, radiance: _Vec) -> Light: ...
    @staticmethod
    def polygon(vertices: _F64, radiance: _Vec) -> Light: ...
    @property
    def center(self) -> list[float]: ...
    def triangles(self) -> list[list[int]]: ...

@final
class Camera:
    def __new__(cls, K: _F64, camera_to_world: _F64, width: int, height: int) -> Camera: ...

@final
class Method:
    def __new__(cls, name: str, parameters: object) -> Method: ...

@final
class Scene:
    def __new__(cls, instances: str = "auto") -> Scene: ...
    def add_mesh(
        self,
        name: str,
        vertices: _F64,
        faces: _I64,
        albedo: _Vec,
        opacity: float,
        casts: bool,
        receives: bool,
    ) -> None: ...
    def add_instance(
        self,
        name: str,
        shared: str,
        albedo: _Vec,
        opacity: float,
        casts: bool,
        receives: bool,
    ) -> None: ...
    def add_spheres(
        self,
        name: str,
        centers: _F64,
        radii: _F64,
        albedo: _Vec,
        opacity: float,
        casts: bool,
        receives: bool,
    ) -> None: ...
    def set_spheres(self, name: str, centers: _F64, radii: _F64) -> None: ...
    def set_look(
        self, name: str, albedo: _Vec, opacity: float, casts: bool, receives: bool
    ) -> None: ...
    def remove(self, name: str) -> None: ...
    def set_transform(self, name: str, matrix: _F64) -> None: ...
    def set_vertices(self, name: str, vertices: _F64) -> None: ...

@final
class Prepared:
    @property
    def seconds(self) -> dict[str, float]: ...
    def render(self, camera: Camera, progress: _Progress) -> dict[str, Any]: ...
    def visibility(self, points: _F64, normals: _F64 | None, progress: _Progress) -> _F32: ...

def set_threads(count: int) -> int: ...
def thread_count() -> int: ...
def simd_level() -> str: ...
def prepare(scene: Scene, lights: list[Light], method: Method, progress: _Progress) -> Prepared: ...

@final
class Textures:
    @property
    def bytes(self) -> int: ...
    def __len__(self) -> int: ...
    def refine(self, samples: int, progress: _Progress) -> float: ...
    def polygon(self, i: int) -> dict[str, Any]: ...
    def mask(self, i: int) -> _Bool: ...
    def arrays(self, i: int) -> list[dict[str, Any]]: ...

def textures(
    scene: Scene,
    lights: list[Light],
    parameters: object,
    entries: list[int],
    side: str,
    progress: _Progress,
) -> Textures: ...
