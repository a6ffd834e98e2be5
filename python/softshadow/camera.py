"""The pinhole camera.

Pixel ``(x, y)`` is seen along the ray through ``(x + ½, y + ½)``; row 0 is on top. In camera space
x points right, y down and z forward, as in the pinhole matrix ``K``.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from softshadow import _core
from softshadow.arguments import Vector, as_vector
from softshadow.checks import frozen, integer, number, numbers

MOST_PIXELS = 65536
"""Along a side of an image."""


class Camera:
    """A pinhole camera that looks from `eye` to `target`; it cannot be changed.

    Cameras with the same matrices and size are equal.

    Parameters
    ----------
    eye, target : array_like, shape (3,)
        World positions; they must differ.
    up : array_like, shape (3,), optional
        Any direction that is not parallel to the view. Not given: z, or y where the camera looks
        straight up or down.
    fov_y_deg : float
        Full vertical field of view in degrees, between 0 and 180 (both excluded).
    width, height : int
        Image size in pixels, 1 to 65536.

    Raises
    ------
    ValueError, TypeError
        If a number is not finite or no number, the view direction or `up` is degenerate, or a size
        is out of its range.

    Examples
    --------
    >>> import softshadow as ss
    >>> camera = ss.Camera(eye=(0, -4, 2), target=(0, 0, 0), fov_y_deg=40, width=320, height=240)
    >>> camera.rays().shape
    (240, 320, 3)
    """

    __slots__ = ("_camera_to_world", "_core", "_height", "_intrinsics", "_width")

    def __init__(
        self,
        eye: Vector,
        target: Vector,
        up: Vector | None = None,
        fov_y_deg: float = 45.0,
        width: int = 512,
        height: int = 512,
    ) -> None:
        e = np.array(as_vector(eye, "Camera.eye"))
        t = np.array(as_vector(target, "Camera.target"))
        u = np.array(as_vector((0.0, 0.0, 1.0) if up is None else up, "Camera.up"))
        fov = number(fov_y_deg, "Camera.fov_y_deg", "0 < fov < 180")
        if not 0.0 < fov < 180.0:
            raise ValueError(f"Camera.fov_y_deg: expected 0 < fov < 180, got {fov_y_deg}")
        width, height = _size(width, height)
        with np.errstate(over="ignore"):  # found at once
            view = t - e
        if not np.all(np.isfinite(view)):
            raise ValueError(f"Camera: eye {e.tolist()} and target {t.tolist()} are too far apart")
        if not view.any():
            raise ValueError(f"Camera: eye and target are the same point {e.tolist()}")
        if not u.any():
            raise ValueError("Camera.up: expected a direction, got a zero vector")
        forward = _unit(view)
        right = np.cross(forward, _unit(u))
        # Below 1e-9 the cross product of two unit vectors is rounding: the image would spin freely.
        if _length(right) < 1e-9 and up is None:
            right = np.cross(forward, (0.0, 1.0, 0.0))
        if _length(right) < 1e-9:
            raise ValueError(f"Camera.up: {u.tolist()} is parallel to the view direction")
        right = right / _length(right)
        matrix = np.eye(4)
        matrix[:3, 0] = right
        matrix[:3, 1] = np.cross(forward, right)
        matrix[:3, 2] = forward
        matrix[:3, 3] = e
        focal = 0.5 * height / math.tan(0.5 * math.radians(fov))
        intrinsics = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
        self._set(intrinsics, matrix, width, height)

    @classmethod
    def from_matrix(
        cls, K: npt.ArrayLike, camera_to_world: npt.ArrayLike, width: int, height: int
    ) -> Camera:
        """Build a camera from a pinhole matrix and a pose.

        Parameters
        ----------
        K : array_like, shape (3, 3)
            ``[[fx, s, cx], [0, fy, cy], [0, 0, 1]]`` in pixels; the image's top left corner is
            ``(0, 0)``.
        camera_to_world : array_like, shape (4, 4)
            Rigid pose; the columns are right, down, forward and the eye (the convention of OpenCV).
        width, height : int
            Image size in pixels.

        Returns
        -------
        Camera

        Raises
        ------
        ValueError
            If a matrix has the wrong shape or is not finite, the pose is not rigid, or a focal
            length is not positive.

        Examples
        --------
        >>> import softshadow as ss
        >>> camera_to_world = [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 5], [0, 0, 0, 1]]
        >>> K = [[300, 0, 160], [0, 300, 120], [0, 0, 1]]
        >>> ss.Camera.from_matrix(K, camera_to_world, 320, 240)
        Camera(eye=[0.0, 0.0, 5.0], 320x240, fov_y=43.6°)
        """
        camera = cls.__new__(cls)
        size = _size(width, height)
        intrinsics = numbers(K, "Camera.K")
        pose = numbers(camera_to_world, "Camera.camera_to_world")
        camera._set(intrinsics, pose, *size)
        return camera

    def _set(
        self,
        K: npt.NDArray[np.float64],
        camera_to_world: npt.NDArray[np.float64],
        width: int,
        height: int,
    ) -> None:
        for name, array, shape in (
            ("K", K, (3, 3)),
            ("camera_to_world", camera_to_world, (4, 4)),
        ):
            if array.shape != shape:
                raise ValueError(f"Camera.{name}: expected shape {shape}, got {array.shape}")
        self._core = _core.Camera(K, np.ascontiguousarray(camera_to_world), width, height)
        self._intrinsics, self._camera_to_world = frozen(K), frozen(camera_to_world)
        self._width, self._height = width, height

    def __reduce__(self) -> tuple[Any, ...]:
        return Camera.from_matrix, (self.K, self.camera_to_world, self.width, self.height)

    def _key(self) -> tuple[bytes, bytes, int, int]:
        # Adding 0 makes a negative zero a positive one, which it equals.
        intrinsics, pose = ((m + 0.0).tobytes() for m in (self.K, self.camera_to_world))
        return intrinsics, pose, self.width, self.height

    def __eq__(self, other: object) -> bool:
        return self._key() == other._key() if isinstance(other, Camera) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._key())

    def __copy__(self) -> Camera:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Camera:
        return self

    @property
    def K(self) -> npt.NDArray[np.float64]:
        """The pinhole matrix in pixels, shape (3, 3); it cannot be changed."""
        return self._intrinsics

    @property
    def camera_to_world(self) -> npt.NDArray[np.float64]:
        """The pose, shape (4, 4): right, down, forward and the eye; it cannot be changed."""
        return self._camera_to_world

    @property
    def width(self) -> int:
        """Image width in pixels."""
        return self._width

    @property
    def height(self) -> int:
        """Image height in pixels."""
        return self._height

    @property
    def eye(self) -> npt.NDArray[np.float64]:
        """The camera's position, shape (3,), world units."""
        eye: npt.NDArray[np.float64] = self.camera_to_world[:3, 3].copy()
        return eye

    @property
    def fov_y_deg(self) -> float:
        """Full vertical field of view in degrees."""
        fy, cy = self.K[1, 1], self.K[1, 2]
        return math.degrees(math.atan(cy / fy) + math.atan((self.height - cy) / fy))

    def rays(self) -> npt.NDArray[np.float64]:
        """Return the unit direction through every pixel's centre, in world space.

        Returns
        -------
        ndarray, shape (H, W, 3), float64
        """
        x, y = np.meshgrid(np.arange(self.width) + 0.5, np.arange(self.height) + 0.5)
        pixels = np.stack([x, y, np.ones_like(x)], axis=-1)
        directions = pixels @ np.linalg.inv(self.K).T @ self.camera_to_world[:3, :3].T
        result: npt.NDArray[np.float64] = directions / np.linalg.norm(
            directions, axis=-1, keepdims=True
        )
        return result

    def __repr__(self) -> str:
        size = f"{self.width}x{self.height}"
        return f"Camera(eye={self.eye.tolist()}, {size}, fov_y={self.fov_y_deg:.4g}°)"


def _length(v: npt.NDArray[np.float64]) -> float:
    """Return the length of a vector, with the same bits on every machine, as BLAS' has not."""
    return math.sqrt(sum((x * x for x in v.tolist()), 0.0))


def _unit(v: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return a vector that is not zero at unit length, however long or short it is."""
    with np.errstate(over="ignore", under="ignore"):
        length = _length(v)
    if not 1e-150 < length < 1e150:  # beyond, squares lose digits or overflow
        v = v / np.abs(v).max()
        length = _length(v)
    result: npt.NDArray[np.float64] = v / length
    return result


def _size(width: int, height: int) -> tuple[int, int]:
    return (
        integer(width, "Camera.width", 1, MOST_PIXELS),
        integer(height, "Camera.height", 1, MOST_PIXELS),
    )
