"""Real models that come with packages which ``pip install`` brings; none is part of softshadow."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import numpy.typing as npt
import trimesh

_PACKAGES = {"pymeshfix": "pymeshfix==0.18.1", "sionna": "sionna-rt==2.2.0"}


def _package_folder(package: str) -> Path | None:
    """Return where a top-level package is installed, without importing it."""
    spec = find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        return None
    return Path(next(iter(spec.submodule_search_locations)))


def missing(what: str, package: str) -> FileNotFoundError:
    """Return the error that says which package a model comes with."""
    return FileNotFoundError(
        f"{what} comes with the package {package}: pip install --no-deps {_PACKAGES[package]}"
    )


def stanford_bunny_path() -> Path | None:
    """Return the Stanford bunny's PLY file.

    Returns
    -------
    Path or None
        None if ``pymeshfix`` is not installed.
    """
    folder = _package_folder("pymeshfix")
    path = folder / "examples" / "StanfordBunny.ply" if folder else None
    return path if path is not None and path.is_file() else None


def city_path(name: str = "munich") -> Path | None:
    """Return the folder of a city's PLY files.

    Parameters
    ----------
    name : str
        ``"munich"`` or ``"san_francisco"`` (and what else the package has).

    Returns
    -------
    Path or None
        None if ``sionna-rt`` is not installed.
    """
    folder = _package_folder("sionna")
    path = folder / "rt" / "scenes" / name / "meshes" if folder else None
    return path if path is not None and path.is_dir() else None


def stanford_bunny() -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Return the Stanford bunny, one unit tall, standing on the ground around the origin.

    Returns
    -------
    vertices : ndarray, shape (V, 3), float64
    faces : ndarray, shape (99785, 3), int64

    Raises
    ------
    FileNotFoundError
        If the model is not installed.
    """
    path = stanford_bunny_path()
    if path is None:
        raise missing("the Stanford bunny", "pymeshfix")
    mesh = trimesh.load(path)
    low, high = mesh.bounds
    scale = 1.0 / (high[2] - low[2])
    middle = 0.5 * (low + high)
    vertices = (np.asarray(mesh.vertices) - [middle[0], middle[1], low[2]]) * scale
    return vertices, np.asarray(mesh.faces, dtype=np.int64)
