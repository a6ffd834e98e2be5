"""The cameras and lights of glTF files."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from softshadow import checks, gltf
from softshadow.camera import Camera
from softshadow.light import DistantLight, Light, SphereLight
from softshadow.parts import Model

__all__ = ["as_radius", "views_of"]

_Matrix = npt.NDArray[np.float64]

_PUNCTUAL = "KHR_lights_punctual"


def as_radius(value: Any, what: str) -> float:
    """Return a positive number.

    Raises
    ------
    ValueError, TypeError
        If it is none.
    """
    radius = checks.number(value, what, "a positive number")
    if not radius > 0:
        raise ValueError(f"{what}: expected a positive number, got {value}")
    return radius


def views_of(
    model: Model, radius: float | None, height: int
) -> tuple[Camera | None, tuple[Light, ...], list[str]]:
    """Return a glTF file's first camera, its lights, and which of them are left out.

    Parameters
    ----------
    model : Model
        Of any file; others than glTF files have neither.
    radius : float, optional
        Of lights that state none.
    height : int
        Of the camera's picture.

    Raises
    ------
    ValueError
        If they are broken.
    """
    cameras: list[Camera] = []
    lights: list[Light] = []
    left_out: list[str] = []
    if model.header is None:
        return None, (), []
    try:
        for index, matrix in (model.nodes or {}).items():
            node = model.header["nodes"][index]
            if "camera" in node:
                name, camera = _camera(model.header, node["camera"], matrix, height)
                if camera is None or cameras:
                    left_out.append(f"{name} (a second one)" if camera else name)
                else:
                    cameras.append(camera)
            punctual = node.get("extensions", {}).get(_PUNCTUAL)
            if punctual is not None:
                name, light = _light(model.header, punctual["light"], matrix, radius)
                if light is None:
                    left_out.append(name)
                else:
                    lights.append(light)
    except (AttributeError, KeyError, IndexError, TypeError, ValueError) as error:
        told = f"no {error}" if isinstance(error, KeyError) else error
        raise ValueError(f"{model.file}: its cameras or lights cannot be read ({told})") from None
    return cameras[0] if cameras else None, tuple(lights), left_out


def _camera(
    header: gltf.Header, index: int, matrix: _Matrix, height: int
) -> tuple[str, Camera | None]:
    """Return a camera's name and itself; None where it is no pinhole."""
    stated = header["cameras"][index]
    name = gltf.called(stated, "camera", index)
    if stated.get("type") != "perspective":
        return f"{name} ({stated.get('type')})", None
    if np.linalg.det(matrix[:3, :3]) < 0:
        return f"{name} (mirrored)", None
    lens = stated["perspective"]
    width = max(1, round(height * lens.get("aspectRatio", 1.0)))
    # It looks along -z, with y up.
    eye, forward, up = matrix[:3, 3], -matrix[:3, 2], matrix[:3, 1]
    reach = max(1.0, float(np.abs(eye).max())) / float(np.linalg.norm(forward))
    fov = math.degrees(lens["yfov"])
    return name, Camera(eye, eye + reach * forward, up, fov, width, height)


def _light(
    header: gltf.Header, index: int, matrix: _Matrix, radius: float | None
) -> tuple[str, Light | None]:
    """Return a light's name and itself; None where it is no point with a radius and not distant."""
    stated = header["extensions"][_PUNCTUAL]["lights"][index]
    name = gltf.called(stated, "light", index)
    extras = stated.get("extras") or {}
    colour = np.array(stated.get("color", (1.0, 1.0, 1.0)), dtype=np.float64)
    emitted = colour * stated.get("intensity", 1.0)
    if stated["type"] == "directional":  # along -z; its intensity is an illuminance
        angle = checks.number(extras.get("angle_deg", 0.0), f"{name}: angle_deg")
        return name, DistantLight(-matrix[:3, 2], angle, emitted)
    if stated["type"] != "point":
        return f"{name} ({stated['type']})", None
    own = extras.get("radius", radius)
    if own is None:
        return f"{name} (a point; light_radius= gives it a size)", None
    size = as_radius(own, f"{name}: radius")
    # A sphere's intensity is its radiance times the disk that it is seen as.
    return name, SphereLight(matrix[:3, 3], size, emitted / (math.pi * size**2))
