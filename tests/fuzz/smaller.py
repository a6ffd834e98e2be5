"""What is left of a failing case when everything that does not matter is taken away."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from fuzz.checks import METHODS, Failure, Run
from fuzz.scenes import Case


def _parts(case: Case) -> Iterator[Case]:
    """Cases with one thing less: a light, an entry, half of a mesh's faces or one of them."""
    for k in range(len(case.lamps)):
        yield replace(case, lamps=case.lamps[:k] + case.lamps[k + 1 :])
    for k, item in enumerate(case.items):
        yield replace(case, items=case.items[:k] + case.items[k + 1 :])
        if item.kind != "mesh":
            continue
        vertices, faces = item.arrays
        count = len(faces)
        size = count // 2
        while size > 0:
            for start in range(0, count, size):
                kept = np.delete(faces, np.s_[start : start + size], axis=0)
                if len(kept):
                    less = replace(item, arrays=(vertices, kept))
                    yield replace(case, items=(*case.items[:k], less, *case.items[k + 1 :]))
            size //= 2


def fails(case: Case, failure: Failure) -> bool:
    if not case.items or not case.lamps:
        return False
    found = Run(case).all()
    return any((f.check, f.method) == (failure.check, failure.method) for f in found)


def smallest(case: Case, failure: Failure, tries: int = 150) -> Case:
    """A case with the same failure of which no part can be left out, within some tries."""
    again = True
    while again:
        again = False
        for part in _parts(case):
            tries -= 1
            if tries < 0:
                return case
            if fails(part, failure):
                case, again = part, True
                break
    return case


def program(case: Case, method: str) -> str:
    """The case as a program that renders it."""

    def numbers(array) -> str:
        return np.array2string(
            np.asarray(array),
            separator=", ",
            threshold=10**9,
            floatmode="unique",
            max_line_width=110,
        )

    lines = ["import numpy as np", "import softshadow as ss", "from fuzz.checks import METHODS", ""]
    lines.append("scene = ss.Scene()")
    for item in case.items:
        first, *rest = map(numbers, item.arrays)
        look = "".join(f", {k}={v!r}" for k, v in item.look.items())
        if item.kind == "mesh":
            lines.append(f"scene.add((np.array({first}), np.array({rest[0]})){look})")
        else:
            lines.append(f"scene.add_{item.kind}({', '.join([first, *rest])}{look})")
    lines.append(f"lights = [{', '.join(f'ss.{light!r}' for light in case.lights())}]")
    point = [tuple(map(float, p)) for p in (case.eye, case.target, case.up)]
    lines.append(f"camera = ss.Camera(*{point}, {case.fov}, *{case.size})")
    if method in METHODS:
        lines.append(f"image = ss.render(scene, camera, lights, METHODS[{method!r}])")
        lines.append("print(image.visibility.round(2))")
    return "\n".join(lines)
