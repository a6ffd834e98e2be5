"""Visibility of points in ``float64``: every light sample against every triangle and sphere.

Nothing is shared with the package: Möller and Trumbore's test instead of Woop's, plain random
samples instead of a scrambled net, no hierarchy. Where the answer hangs on rounding (a receiver in
contact with something else, a ray through an edge) it says so: `visibility` and `hard` return what
is sure beside their answers.
"""

from __future__ import annotations

import numpy as np
import softshadow as ss


class Brute:
    """The triangles and spheres of a scene that cast."""

    def __init__(self, scene):
        corners, self.spheres, through, self.sphere_through = [], [], [], []
        for entry in scene.entries:
            if not entry.casts:
                continue
            if isinstance(entry, ss.Mesh):
                t = entry.world_vertices()[entry.faces]
                corners.append(t)
                through += [1.0 - entry.opacity] * len(t)
            else:
                self.spheres += list(zip(entry.centers, entry.radii, strict=True))
                self.sphere_through += [1.0 - entry.opacity] * len(entry.radii)
        t = np.concatenate([np.zeros((0, 3, 3)), *corners])
        area = np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1)
        self.triangles, self.through = t[area > 0], np.array(through)[area > 0]

    def transmittance(self, origin, targets, near):
        """What segments from a point let through, whether an edge is within ``near`` of them."""
        way = targets - origin
        length = np.linalg.norm(way, axis=1)
        d = way / np.maximum(length, 1e-300)[:, None]
        out, doubt = np.ones(len(targets)), np.zeros(len(targets), dtype=bool)
        for (a, b, c), through in zip(self.triangles, self.through, strict=True):
            e, f, s = b - a, c - a, origin - a
            p = np.cross(d, f)
            det = p @ e
            with np.errstate(divide="ignore", invalid="ignore"):
                u = p @ s / det
                q = np.cross(s, e)
                v = d @ q / det
                t = f @ q / det
                edge = np.minimum(np.minimum(u, v), 1 - u - v)
                # How far from the border of the triangle, in world units, at least.
                border = (
                    np.abs(edge)
                    * np.linalg.norm(np.cross(e, f))
                    / max(np.linalg.norm(x) for x in (e, f, c - b))
                )
            hit = (edge >= 0) & (t > 0) & (t < length - near)
            out[hit] *= through
            within = (t > -near) & (t < length + near)
            doubt |= within & (border < near) | (edge > 0) & (np.abs(t) < near)
        for (center, radius), through in zip(self.spheres, self.sphere_through, strict=True):
            m = origin - center
            b, c = d @ m, m @ m - radius * radius
            disc = b * b - c
            root = np.sqrt(np.maximum(disc, 0.0))
            for t in (-b - root, -b + root):
                out[(disc > 0) & (t > 0) & (t < length - near)] *= through
            doubt |= np.abs(np.sqrt(np.maximum(m @ m - b * b, 0.0)) - radius) < near
        return out, doubt


def light_points(light, p, n, count, random):
    """Random light points as ``p`` sees the light, and which are above its plane and emit to it."""
    u, v = random.random((2, count))
    center = np.asarray(light.center, dtype=np.float64)
    turn = 2 * np.pi * v
    if isinstance(light, ss.SphereLight):
        d = center - p
        distance = np.linalg.norm(d)
        if distance <= light.radius:
            return np.tile(center, (count, 1)), np.zeros(count, dtype=bool)
        sin = light.radius / distance
        fall = u * sin * sin / (1 + np.sqrt((1 - sin) * (1 + sin)))
        cos, across = 1 - fall, np.sqrt(fall * (2 - fall))
        w = d / distance
        a, b = _frame(w)
        way = cos[:, None] * w + across[:, None] * (
            np.cos(turn)[:, None] * a + np.sin(turn)[:, None] * b
        )
        reach = distance * cos - np.sqrt(
            np.maximum(light.radius**2 - (distance * across) ** 2, 0.0)
        )
        return p + way * reach[:, None], way @ n > 0 if n.any() else np.ones(count, dtype=bool)
    if isinstance(light, ss.RectLight):
        e, f = np.asarray(light.edge_u), np.asarray(light.edge_v)
        normal = np.cross(e, f)
        points = center + (u - 0.5)[:, None] * e + (v - 0.5)[:, None] * f
    else:
        normal = np.asarray(light.normal, dtype=np.float64)
        a, b = _frame(normal / np.linalg.norm(normal))
        r = light.radius * np.sqrt(u)
        points = center + (r * np.cos(turn))[:, None] * a + (r * np.sin(turn))[:, None] * b
    way = points - p
    above = way @ n > 0 if n.any() else np.ones(count, dtype=bool)
    return points, above & (way @ normal < 0)


def _frame(w):
    a = np.cross(w, np.eye(3)[np.argmin(np.abs(w))])
    a /= np.linalg.norm(a)
    return a, np.cross(w, a)


def visibility(brute, light, points, normals, count, random, nears):
    """Visibility of points, shape (N,), and how much of it hangs on what is nearer than `nears`."""
    values, doubts = [], []
    for p, n, near in zip(points, normals, nears, strict=True):
        targets, valid = light_points(light, p, n, count, random)
        through = np.zeros(count)
        near_by, _ = brute.transmittance(p + n * near, targets[valid], near)
        through[valid], _ = brute.transmittance(p + n * near / 8, targets[valid], near / 8)
        # Of what nears the tangent plane, too.
        grazing = np.abs((targets - p) @ n) < near if n.any() else np.zeros(count, dtype=bool)
        doubts.append(np.abs(near_by - through[valid]).sum() / count + grazing.mean())
        values.append(through.mean())
    return np.array(values), np.array(doubts)


def hard(brute, light, points, normals, nears):
    """Transmittance to the light's centre, and where that is sure."""
    values, sure = [], []
    center = np.asarray(light.center, dtype=np.float64)[None]
    for p, n, near in zip(points, normals, nears, strict=True):
        value, doubt = brute.transmittance(p + n * near, center, near)
        again, _ = brute.transmittance(p + n * near / 8, center, near / 8)
        values.append(value[0])
        sure.append(value[0] == again[0] and not doubt[0])
    return np.array(values), np.array(sure, dtype=bool)
