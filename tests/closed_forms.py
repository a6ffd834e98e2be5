"""What the tests of closed forms share: integrals by quadrature, and the bounds of sampling.

`ray_traced` is held to what its sampler guarantees. With ``N = 2**m`` samples on a flat light the
samples are a (0, m, 2)-net: every elementary interval of area ``1 / N`` of the light's square holds
exactly one. So the share of samples on one side of a line parallel to an edge of the light is
right to ``1 / N``, that in a corner's rectangle to ``(m / 2 + 3 / 2) / N`` (Niederreiter 1992,
Theorem 4.14), and along any other curve only those of ``sqrt(N)`` by ``sqrt(N)`` cells that it cuts
are uncertain.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
import softshadow as ss
from scipy.integrate import quad as integrate
from shapes import QUAD, quad

N = 4096
MANY = ss.RayTraced(samples=N)
# One sample, and the light points' and origins' four ulps, which move a shadow's edge far less.
STRIP = 1 / N + 1e-5
BOX = (math.log2(N) / 2 + 1.5) / N + 1e-5

FLOOR = quad((0, 0, 0), (2, 0, 0), (0, 2, 0))[0], QUAD
LOOK = ss.Camera((0.2, -2.5, 2.0), (0, 0, 0), width=9, height=7)
ALBEDO = np.array([0.9, 0.5, 0.25])

ABOVE = {
    "rect": ss.RectLight((0, 0, 2), (0, 0.6, 0), (0.6, 0, 0)),
    "disk": ss.DiskLight((0, 0, 2), (0, 0, -1), 0.3),
    "sphere": ss.SphereLight((0, 0, 2), 0.3),
}
METHODS = {"hard": "hard", "ray_traced": ss.RayTraced(samples=256)}


def unit(v):
    v = np.asarray(v, dtype=np.float64)
    return v / np.linalg.norm(v)


def frame(n):
    """Two unit vectors that complete `n`."""
    a = unit(np.cross(n, np.eye(3)[np.argmin(np.abs(n))]))
    return a, np.cross(n, a)


def _rect_integral(light, p, n, weight):
    """Integral of `weight` over the part of a rectangle above the tangent plane, by quadrature.

    The inner integral runs along v between the edges and the tangent plane; the outer one is broken
    where the plane's line leaves through an edge, so that every piece is smooth.
    """
    c, u, v = (np.array(x) for x in (light.center, light.edge_u, light.edge_v))
    x, w = np.polynomial.legendre.leggauss(24)

    def height(s, t):
        return n @ (c + s * u + t * v - p)

    slope, g = n @ v, n @ u

    def inner(s):
        low, high = -0.5, 0.5
        h0 = height(s, 0.0)
        if slope == 0:
            return 0.0 if h0 <= 0 else float(np.sum(w / 2 * _at(s, x / 2)))
        cut = -h0 / slope
        low, high = (max(low, cut), high) if slope > 0 else (low, min(high, cut))
        if high <= low:
            return 0.0
        return float(np.sum(w * (high - low) / 2 * _at(s, (high + low + x * (high - low)) / 2)))

    def _at(s, t):
        return weight(c + s * u + np.multiply.outer(t, v))

    breaks = [-0.5, 0.5]
    if g != 0:
        breaks += [b for t in (-0.5, 0.5) if abs(b := -height(0.0, t) / g) < 0.5]
    breaks = np.sort(breaks)
    parts = itertools.pairwise(breaks)
    return sum(integrate(inner, a, b, epsabs=1e-12, epsrel=1e-10)[0] for a, b in parts)


def _disk_integral(light, p, n, weight):
    """The same for a disk: chords parallel to the tangent plane's line, from rim to rim."""
    c, m = np.array(light.center), unit(light.normal)
    across = n - (n @ m) * m
    slope = np.linalg.norm(across)
    e1 = across / slope if slope > 1e-12 else frame(m)[0]
    e2 = np.cross(m, e1)
    x, w = np.polynomial.legendre.leggauss(40)
    r = light.radius

    def chord(angle):
        half = r * math.cos(angle)
        q = c + r * math.sin(angle) * e1 + np.multiply.outer(x * half, e2)
        return float(np.sum(w * half * weight(q))) * r * math.cos(angle)

    height = n @ (c - p)
    if abs(height) >= slope * r:
        start = -math.pi / 2 if height > 0 else math.pi / 2
    else:
        start = -math.asin(height / (slope * r))
    return integrate(chord, start, math.pi / 2, epsabs=1e-13, epsrel=1e-10)[0]


def cap_integral(direction, sine, n):
    """Irradiance and solid angle of a cap of directions above the tangent plane (radiance 1).

    Around the cap's axis a circle of directions at angle θ is above the plane for |φ| < φ₀.
    """
    cos_n = float(n @ direction)
    sin_n = math.sqrt(max(0.0, 1 - cos_n**2))

    def arc(theta):
        a, b = cos_n * math.cos(theta), sin_n * math.sin(theta)
        return math.acos(min(1.0, max(-1.0, -a / b))) if b > 0 else (math.pi if a > 0 else 0.0)

    def light(theta):
        phi = arc(theta)
        a, b = cos_n * math.cos(theta), sin_n * math.sin(theta)
        return 2 * (a * phi + b * math.sin(phi)) * math.sin(theta)

    alpha = math.asin(sine)
    tangent = abs(math.pi / 2 - math.acos(max(-1.0, min(1.0, cos_n))))
    kinks = sorted({0.0, min(tangent, alpha), alpha})
    parts = list(itertools.pairwise(kinks))
    options = {"epsabs": 1e-13, "epsrel": 1e-10, "limit": 200}
    total = sum(integrate(light, a, b, **options)[0] for a, b in parts)
    angle = sum(integrate(lambda t: 2 * arc(t) * math.sin(t), a, b, **options)[0] for a, b in parts)
    return total, angle


def irradiance_and_fraction(light, p, n):
    """Irradiance of radiance 1 and the fraction above the tangent plane, by quadrature."""
    if isinstance(light, ss.SphereLight):
        d = np.array(light.center) - p
        distance = np.linalg.norm(d)
        sine = light.radius / distance
        total, angle = cap_integral(d / distance, sine, n)
        return total, angle / (2 * math.pi * (1 - math.sqrt(1 - sine**2)))
    if isinstance(light, ss.RectLight):
        m = np.cross(light.edge_u, light.edge_v)
        area, integral = np.linalg.norm(m), _rect_integral
        m, scale = m / area, area
    else:
        m, area, integral, scale = unit(light.normal), math.pi * light.radius**2, _disk_integral, 1

    def weight(q):
        r = q - p
        return (r @ n) * -(r @ m) / np.sum(r * r, axis=-1) ** 2

    total = integral(light, p, n, weight) * scale
    return total, integral(light, p, n, lambda q: np.ones(q.shape[:-1])) * scale / area


def lit_floor(light, method, casts=True):
    scene = ss.Scene()
    scene.add(FLOOR, albedo=ALBEDO, casts=casts)
    image = ss.render(scene, LOOK, light, method)
    assert image.mask.sum() >= 20
    return image
