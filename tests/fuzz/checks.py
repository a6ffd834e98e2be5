"""What must hold for every case, and what is known not to.

- ``answers``: an image, or a ``ValueError`` that says why not; no panic, no other exception, within
  `SLOW` seconds.
- ``in_range``: nothing is NaN or infinite, visibility is 0 to 1, radiance at least 0.
- ``same_again``: the same bits when rendered again, and through `prepare`.
- ``threads``: the same bits with one thread (`digest`, compared by `__main__` and the test with
  another process).
- ``scaled``: the same bits when all lengths are a power of two times as large.
- ``company``: a light has the same bits alone and among others.
- ``culled``: ``ray_traced`` has the same bits with and without ``cull``.
- ``monotone``: something that casts never adds light in ``ray_traced``.
- ``unbiased``: ``ray_traced`` against `brute` in ``float64``, a z-test for each point,
  Šidák-corrected.
- ``hard_exact``: ``hard`` is what `brute` says wherever that is sure.
- ``at_points``: `visibility` at an image's points is what the image has.
- ``near_reference``: a method's mean error is within its allowance.
- ``lost_shadow``: nothing is lit where a wide area is dark in the reference, nor dark where it is
  lit, but for an allowance.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import softshadow as ss
from scipy.ndimage import minimum_filter
from scipy.stats import norm
from small_methods import methods

from fuzz import brute
from fuzz.scenes import Case

# Settings under which a frame takes milliseconds. `auto` hands others over, by how long they take.
METHODS = methods(
    [name for name in ss.method_names() if name != "auto"],
    {"accumulation": {"samples": 16}},
    resolution=128,
    samples=64,
    max_size=64,
)

# Seconds for an image of 24 x 18; what is slower has no bound that a user would guess.
SLOW = 20.0

# Pixels around one that all have to be dark (or lit) for a loss to count.
WIDE = 5


@dataclass(frozen=True)
class Known:
    """A fault with a number in the list of issues: checks that do not count for some cases."""

    item: str
    checks: tuple[str, ...]
    methods: tuple[str, ...]
    tags: tuple[str, ...] = ()

    def covers(self, check: str, method: str, case: Case) -> bool:
        return (
            check in self.checks
            and method in self.methods
            and (not self.tags or any(t in case.tags for t in self.tags))
        )


@dataclass(frozen=True)
class Failure:
    check: str
    method: str
    seed: int
    what: str

    def __str__(self) -> str:
        return f"seed {self.seed}: {self.check}: {self.method}: {self.what}"


def render(case: Case, method: ss.Method, scale: float = 1.0, lights=None, **scene):
    """An image, or `None` where the method refuses."""
    try:
        lit = lights or case.lights(scale)
        return ss.render(case.scene(scale, **scene), case.camera(scale), lit, method)
    except ValueError:
        return None


def digest(case: Case) -> dict[str, str]:
    """What `threads` compares."""
    out = {}
    for name, method in METHODS.items():
        image = render(case, method)
        bits = b"" if image is None else image.visibility.tobytes() + image.radiance.tobytes()
        out[name] = hashlib.sha256(bits).hexdigest()
    return out


def same(one, other) -> str:
    """What differs between two images' bits."""
    if (one is None) != (other is None):
        return "one of them is refused"
    if one is None or np.array_equal(one.visibility, other.visibility):
        return ""
    difference = np.abs(one.visibility.astype(float) - other.visibility)
    return f"{(difference > 0).sum()} of {difference.size} differ, by up to {difference.max():.3g}"


class Run:
    """The checks of one case; `failures` are what does not hold and is not known."""

    def __init__(self, case: Case) -> None:
        self.case, self.random = case, np.random.default_rng([18, case.seed])
        self.failures: list[Failure] = []
        self.images: dict[str, ss.Image | None] = {}
        self.measured: dict[tuple[str, str], float] = {}

    def fail(self, check: str, method: str, what: str) -> None:
        if what and not any(k.covers(check, method, self.case) for k in KNOWN):
            self.failures.append(Failure(check, method, self.case.seed, what))

    def all(self) -> list[Failure]:
        """Runs every check."""
        for check in CHECKS:
            try:
                check(self)
            except ValueError as error:
                # Of the checks that do not go through `render`: a case that is refused has nothing
                # to check.
                if self.images.get("ray_traced") is not None:
                    self.fail(check.__name__, "", f"{type(error).__name__}: {error}")
            except Exception as error:
                self.fail("answers", check.__name__, f"{type(error).__name__}: {error}")
        return self.failures

    def shown(self) -> Iterator[tuple[str, ss.Image]]:
        return ((name, image) for name, image in self.images.items() if image is not None)


def answers(run: Run) -> None:
    for name, method in METHODS.items():
        start = time.perf_counter()
        try:
            run.images[name] = render(run.case, method)
        except Exception as error:
            run.images[name] = None
            run.fail("answers", name, f"{type(error).__name__}: {error}")
        seconds = time.perf_counter() - start
        if seconds > SLOW:
            run.fail("answers", name, f"took {seconds:.0f} s")
    if run.images["ray_traced"] is None:
        run.fail("answers", "ray_traced", "refused")


def in_range(run: Run) -> None:
    for name, image in run.shown():
        v, r = image.visibility, image.radiance
        finite = all(np.isfinite(a).all() for a in (v, r, image.position, image.normal))
        if not finite:
            run.fail("in_range", name, "NaN or infinite")
        elif v.min() < 0 or v.max() > 1 or r.min() < 0:
            run.fail("in_range", name, f"visibility {v.min()} to {v.max()}, radiance {r.min()}")


def same_again(run: Run) -> None:
    for name, image in run.shown():
        prepared = ss.prepare(run.case.scene(), run.case.lights(), METHODS[name])
        for _ in range(2):
            run.fail("same_again", name, same(image, prepared.render(run.case.camera())))


def scaled(run: Run) -> None:
    power = float(2.0 ** run.random.choice([-20, -3, 1, 10, 30]))
    for name, image in run.images.items():
        run.fail("scaled", name, same(image, render(run.case, METHODS[name], power)))


def company(run: Run) -> None:
    if len(run.case.lamps) < 2:
        return
    for name, image in run.shown():
        for k, light in enumerate(run.case.lights()):
            alone = render(run.case, METHODS[name], lights=[light])
            if alone is None or not np.array_equal(alone.visibility[0], image.visibility[k]):
                run.fail("company", name, f"light {k} differs")


def culled(run: Run) -> None:
    for samples in (64, 200):
        one, two = (render(run.case, ss.RayTraced(samples, cull=c)) for c in (True, False))
        run.fail("culled", "ray_traced", same(one, two))


def monotone(run: Run) -> None:
    ghost = int(run.random.integers(len(run.case.items)))
    method = METHODS["ray_traced"]
    without, image = render(run.case, method, ghost=ghost), run.images["ray_traced"]
    if without is None or image is None:
        return
    more = (image.visibility - without.visibility).max()
    if more > 0:
        run.fail("monotone", "ray_traced", f"entry {ghost} adds {more:.3g}")


def _points(run: Run, count: int):
    """Some of the pixels that show something that receives: their places, positions and normals."""
    image = run.images["ray_traced"]
    ids = np.array([e.receives for e in run.case.scene().entries] + [False])
    y, x = np.nonzero(ids[image.mesh_id])
    pick = run.random.permutation(len(y))[:count]
    y, x = y[pick], x[pick]
    return (y, x), image.position[y, x], image.normal[y, x].astype(np.float64)


def _near(run: Run, points):
    """Lengths within which `float32` may see things otherwise, shape (N,).

    16 of its ulps of where the point lies and of the smallest thing there is: a huge ground is no
    excuse for what is small and near its middle.
    """
    scene = run.case.scene()
    low, high = scene.bounds
    away = np.abs(points - 0.5 * (low + high)).max(axis=1)
    smallest = min(np.ptp(_corners(entry), axis=0).max() for entry in scene.entries)
    return 16 * 2.0**-23 * np.minimum((high - low).max(), away + 10 * smallest)


def _corners(entry):
    if isinstance(entry, ss.Mesh):
        return entry.world_vertices()
    return np.concatenate(
        [entry.centers - entry.radii[:, None], entry.centers + entry.radii[:, None]]
    )


def unbiased(run: Run) -> None:
    if run.case.triangles() > 250:
        return
    _, points, normals = _points(run, 12)
    for light in run.case.lights():
        if len(points) == 0 or getattr(light, "radius", 1.0) == 0.0:
            continue
        # Twice: what the first finds is looked at again with other and more samples.
        for few, many, chance in ((1024, 600, 1e-2), (8192, 8000, 1e-6)):
            random = np.random.default_rng(run.random.integers(2**63))
            exact, doubt = brute.visibility(
                brute.Brute(run.case.scene()),
                light,
                points,
                normals,
                many,
                random,
                _near(run, points),
            )
            method = ss.RayTraced(few, seed=int(random.integers(2**63)))
            found = ss.visibility(run.case.scene(), points, normals, light, method)
            # A scrambled net's variance is at most e times plain sampling's (Owen 1997). A pair of
            # each keeps what was never or always hit from being certain.
            p = (found * few + exact * many + 2) / (few + many + 4)
            sigma = np.sqrt(p * (1 - p) * (np.e / few + 1 / many))
            limit = norm.isf(0.5 * (1 - (1 - chance) ** (1 / len(points))))
            off = np.abs(found - exact) - doubt > limit * sigma
            points, normals = points[off], normals[off]
            if not off.any():
                break
        else:
            worst = np.argmax(np.abs(found - exact) * off)
            run.fail(
                "unbiased",
                "ray_traced",
                f"{found[worst]:.4f} where {exact[worst]:.4f} is right: {light}",
            )


def hard_exact(run: Run) -> None:
    image = run.images["hard"]
    (y, x), points, normals = _points(run, 40)
    if image is None or run.case.triangles() > 250:
        return
    scene = brute.Brute(run.case.scene())
    for k, light in enumerate(run.case.lights()):
        exact, sure = brute.hard(scene, light, points, normals, _near(run, points))
        h = ss.kernels.light_fraction_above(light, points, normals)
        off = sure & (np.abs(image.visibility[k][y, x] - np.minimum(exact, h)) > 1e-5)
        if off.any():
            i = int(np.argmax(off))
            run.fail("hard_exact", "hard", f"{off.sum()} of {sure.sum()}, at {points[i].tolist()}")


def at_points(run: Run) -> None:
    (y, x), points, normals = _points(run, 100)
    for name, image in run.shown():
        if not METHODS[name].points or len(points) == 0 or name in ("pcf", "deep"):
            continue  # `pcf` and `deep` have noise of a receiver's own
        method = ss.RayTraced(64, pattern="fixed") if name == "ray_traced" else METHODS[name]
        image = render(run.case, method)
        for k, light in enumerate(run.case.lights()):
            found = ss.visibility(run.case.scene(), points, normals, light, method)
            # A normal in single precision, and where a receiver is, move what is seen edge-on.
            part = float(np.mean(np.abs(found - image.visibility[k][y, x]) > 0.1))
            run.measured["at_points", name] = max(part, run.measured.get(("at_points", name), 0.0))
            if part > POINTS_OFF:
                run.fail("at_points", name, f"{part:.0%} of points differ from the image")


def _reference(run: Run):
    """The reference, and which pixels count: they show something that receives."""
    image = render(run.case, ss.RayTraced(256))
    receives = np.array([e.receives for e in run.case.scene().entries] + [False])
    return image, receives[image.mesh_id]


def near_reference(run: Run) -> None:
    reference, counts = _reference(run)
    for name, image in run.shown():
        if not counts.any() or name in ("hard", "shadow_volume"):
            continue  # these are the centre's shadows, and held to that elsewhere
        error = float(np.abs(image.visibility - reference.visibility)[:, counts].mean())
        run.measured["near_reference", name] = error
        if error > ERROR[name]:
            run.fail("near_reference", name, f"mean error {error:.3f}, allowed {ERROR[name]}")


def lost_shadow(run: Run) -> None:
    reference, counts = _reference(run)
    if not counts.any():
        return

    def all_of(condition):
        return minimum_filter(condition & counts, WIDE, mode="constant", cval=False)

    for name, image in run.shown():
        lost = 0
        for k, light in enumerate(run.case.lights()):
            exact, seen = reference.visibility[k], image.visibility[k]
            h = np.ones_like(exact)
            p, n = reference.position[counts], reference.normal[counts]
            h[counts] = ss.kernels.light_fraction_above(light, p, n)
            lit = all_of((exact >= h - 1e-6) & (h > 0.99))
            lost += (all_of(exact == 0) & (seen > 0.9)).sum() + (lit & (seen < 0.1)).sum()
        part = float(lost / (len(reference.visibility) * counts.sum()))
        run.measured["lost_shadow", name] = part
        if part > LOST[name]:
            run.fail("lost_shadow", name, f"{part:.1%} of the picture, allowed {LOST[name]:.1%}")


CHECKS: list[Callable[[Run], None]] = [
    answers,
    in_range,
    same_again,
    scaled,
    company,
    culled,
    monotone,
    unbiased,
    hard_exact,
    at_points,
    near_reference,
    lost_shadow,
]

# Share of points that `visibility` may answer otherwise than the image by more than 0.1: at grazing
# normals. Measured over 200 cases: none but one in a hundred of `mvsm`.
POINTS_OFF = 0.05

# Largest mean error over a picture that receives, against 256 samples. Measured over 430 cases
# without what is known: 0.011 of `ray_traced` at 64 samples, 0.008 of `wedges`, 0.032 of layered
# maps, 0.134 of `mvsm`, 0.158 of `pcf` and `deep` (in soups), 0.048 of `accumulation`. Methods that
# take what they see for something simpler are far off where that fails: 0.23 of `ssoc` in a soup of
# slivers; to `single_sample` every sliver is an outer object, 0.95 in a soup, and it is held to
# lost shadows only.
ERROR = {
    "ray_traced": 0.03,
    "counted": 0.03,
    "wedges": 0.03,
    "ssoc": 0.35,
    "slsm": 0.08,
    "mlsm": 0.08,
    "mtsm": 0.08,
    "single_sample": 1.0,
    "mvsm": 0.2,
    "pcf": 0.25,
    "deep": 0.25,
    "accumulation": 0.1,
    "convolution": 0.15,
}

# Largest part of the picture that may be lit in the middle of darkness or dark in the middle of
# light. Measured: none, but 0.7 % for `mvsm`, 4.0 % for `ssoc` and 6.7 % for `single_sample`, each
# in one soup of 430 cases.
LOST = dict.fromkeys(METHODS, 0.003) | {"mvsm": 0.02, "ssoc": 0.06, "single_sample": 0.1}


# What does not hold yet, by the number of the item; leave out a line to see its failures.
KNOWN: list[Known] = [
    # All blockers at one depth: walls next to the light (docs/methods/pcf.md).
    Known(
        "17.7", ("near_reference", "lost_shadow"), ("pcf", "deep"), ("housing", "closed", "slit")
    ),
]
