"""The command ``softshadow``: pictures of a model file, comparisons, sweeps and reports.

Every mistake of the user's is one line on stderr, ``error: ...``, and exit code 2; Ctrl-C is exit
code 130.
"""

from __future__ import annotations

import ast
import shlex
import sys
import warnings
from collections.abc import Sequence
from dataclasses import fields, replace
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from softshadow import checks
from softshadow._core import __version__
from softshadow.camera import Camera
from softshadow.extras import needs
from softshadow.images import check_path, write
from softshadow.light import (
    DiskLight,
    DistantLight,
    Light,
    LightLike,
    PolygonLight,
    RectLight,
    SphereLight,
)
from softshadow.loading import frame, load
from softshadow.methods import Method, method_names, resolve
from softshadow.render import render as render_image
from softshadow.scene import Scene

with needs("cli", "the command softshadow"):
    import typer

_INTERRUPTED = 130
_USER_ERROR = 2

app = typer.Typer(
    add_completion=False,
    rich_markup_mode=None,
    help="Soft shadows of area lights on the CPU.",
)


class Up(str, Enum):
    """Which axis of a file points up."""

    y = "y"
    z = "z"


class What(str, Enum):
    """What to write."""

    visibility = "visibility"
    radiance = "radiance"


_LIGHT_FORMS = {
    "rect": "rect:cx,cy,cz,ux,uy,uz,vx,vy,vz",
    "disk": "disk:cx,cy,cz,nx,ny,nz,r",
    "sphere": "sphere:cx,cy,cz,r",
    "polygon": "polygon:x,y,z;x,y,z;x,y,z...",
    "distant": "distant:dx,dy,dz:angle",
}
"""Kinds of ``--light`` and what follows them; the commas count the numbers."""


def parse_light(text: str) -> Light:
    """Return the light that a ``--light`` argument describes.

    Parameters
    ----------
    text : str
        ``rect:`` center and two full edge vectors (9 numbers; it emits towards u × v), ``disk:``
        center, normal and radius (7), ``sphere:`` center and radius (4), separated by commas,
        ``polygon:`` vertices (3 numbers each), separated by semicolons, or ``distant:`` direction
        (3), after which ``:`` and the angle in degrees may follow.

    Raises
    ------
    ValueError
        If it is none of these, or the light is degenerate.
    """
    kind, _, rest = text.partition(":")
    form = _LIGHT_FORMS.get(kind)
    if form is None:
        raise ValueError(f"--light {text!r}: expected one of {' | '.join(_LIGHT_FORMS.values())}")
    what = f"--light {text!r}"
    if kind == "polygon":
        return PolygonLight([_numbers(part, 3, what, form) for part in rest.split(";")])
    if kind == "distant":
        direction, colon, angle = rest.partition(":")
        d = _numbers(direction, 3, what, form)
        return DistantLight(d, *_numbers(angle, 1, what, form) if colon else ())
    n = _numbers(rest, form.count(",") + 1, f"--light {text!r}", form)
    if kind == "rect":
        return RectLight(n[0:3], n[3:6], n[6:9])
    if kind == "disk":
        return DiskLight(n[0:3], n[3:6], n[6])
    return SphereLight(n[0:3], n[3])


def _numbers(text: str, count: int, what: str, form: str) -> list[float]:
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count:
        raise ValueError(f"{what}: expected {count} numbers as in {form}")
    return numbers


def _size(text: str | None) -> tuple[int | None, int | None]:
    if text is None:
        return None, None
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise ValueError(f"--size {text!r}: expected WxH, such as 512x512")
    return int(width), int(height)


def _method(name: str, samples: int | None, seed: int | None, settings: Sequence[str]) -> Method:
    method = resolve(name)
    known = [item.name for item in fields(method)]
    given: dict[str, Any] = {"samples": samples, "seed": seed}
    given = {k: v for k, v in given.items() if v is not None}
    for parameter in given:
        if parameter not in known:
            raise ValueError(f"--{parameter}: method {name!r} has no such parameter")
    for setting in settings:
        parameter, equals, text = (part.strip() for part in setting.partition("="))
        if not equals:
            raise ValueError(f"--set {setting!r}: expected NAME=VALUE, such as resolution=2048")
        if parameter not in known:
            raise ValueError(
                f"--set {setting!r}: method {name!r} has no such parameter, but "
                f"{', '.join(known) or 'none'}"
            )
        if parameter in given:
            raise ValueError(f"--set {setting!r}: {parameter} is given twice")
        given[parameter] = _value(text)
    try:
        return replace(method, **given)  # says what is out of range, before a model is read
    except TypeError as error:
        raise ValueError(str(error)) from None


def _value(text: str) -> Any:
    """Return what a setting says: a number, True, False or None, or else a word."""
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError):
        return text


class _View:
    """What the options say about the picture, checked before a model is read."""

    def __init__(
        self,
        lights: Sequence[str] | None,
        eye: str | None,
        target: str | None,
        fov: float | None,
        size: tuple[int | None, int | None],
        ground: bool | None,
    ) -> None:
        self.lights = tuple(parse_light(text) for text in lights or ())
        self.eye = None if eye is None else _numbers(eye, 3, f"--eye {eye!r}", "x,y,z")
        self.target = None
        if target is not None:
            self.target = _numbers(target, 3, f"--target {target!r}", "x,y,z")
        self.fov, self.size, self.ground = fov, size, ground
        at = (0.0, 0.0, 0.0) if self.eye is None else self.eye
        to = np.add(at, 1.0) if self.target is None or self.eye is None else self.target
        Camera(at, to, None, *self._lens(None))

    def of(self, model: Path, up: Up, radius: float | None) -> tuple[Scene, Camera, LightLike]:
        """Return a file's scene, and what the options, the file or the framing have for it."""
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always", UserWarning)
            found = load(model, up=up.value, light_radius=radius, height=self._lens(None)[2])
        for warning in told:
            typer.echo(f"warning: {' '.join(str(warning.message).split())}", err=True)
        alone = found.camera is None and not found.lights
        lens = self._lens(found.camera)
        ground = alone if self.ground is None else self.ground
        framed = frame(found.scene, *lens, ground=ground)
        default = framed.camera if found.camera is None else _with_lens(found.camera, *lens)
        assert default is not None
        camera = default
        if self.eye is not None or self.target is not None:
            at = default.eye if self.eye is None else self.eye
            to = found.scene.bounds.mean(axis=0) if self.target is None else self.target
            camera = Camera(at, to, None, *lens)
        lights = self.lights or found.lights or framed.lights
        return framed.scene, camera, lights if len(lights) > 1 else lights[0]

    def _lens(self, own: Camera | None) -> tuple[float, int, int]:
        """Return angle, width and height: those given, the file's camera's, or the usual ones."""
        usual = (45.0, 512, 512) if own is None else (own.fov_y_deg, own.width, own.height)
        fov, width, height = (
            other if given is None else given
            for given, other in zip((self.fov, *self.size), usual, strict=True)
        )
        return fov, int(width), int(height)


def _with_lens(camera: Camera, fov: float, width: int, height: int) -> Camera:
    """Return a camera from the same place, but as it is where all is its own."""
    if (fov, width, height) == (camera.fov_y_deg, camera.width, camera.height):
        return camera
    plain = Camera((0, 0, 0), (0, 1, 0), None, fov, width, height)
    return Camera.from_matrix(plain.K, camera.camera_to_world, width, height)


@app.callback(invoke_without_command=True)
def _softshadow(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    if version:
        typer.echo(f"softshadow {__version__}")
    elif context.invoked_subcommand is None:
        typer.echo(context.get_help())


@app.command()
def render(
    model: Annotated[
        Path,
        typer.Argument(
            help="Mesh file (PLY, OBJ, STL, ...), or scene file with its lights and camera (glTF, "
            "GLB, Mitsuba XML)."
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help="A .png, .exr or .npy file; visibility of several lights is their mean, in .npy "
            "that of each.",
        ),
    ],
    light: Annotated[
        list[str] | None,
        typer.Option(
            help=f"{', '.join(_LIGHT_FORMS.values())}; may be repeated. Not given: the file's, or "
            "a square above, to the right.",
            metavar="SPEC",
        ),
    ] = None,
    light_radius: Annotated[
        float | None,
        typer.Option(help="Of point lights of glTF files, in the file's units."),
    ] = None,
    up: Annotated[Up, typer.Option(help="The file's axis that points up.")] = Up.z,
    method: Annotated[
        str, typer.Option(help="See 'softshadow methods'.", metavar="NAME")
    ] = "ray_traced",
    samples: Annotated[int | None, typer.Option(help="Light samples per receiver.")] = None,
    seed: Annotated[int | None, typer.Option(help="Of the light samples.")] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="A parameter of the method, such as resolution=2048; may be repeated.",
            metavar="NAME=VALUE",
        ),
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(help="Pixels. Not given: the file's camera's, or 512x512.", metavar="WxH"),
    ] = None,
    width: Annotated[int | None, typer.Option(help="Pixels; overrides --size.")] = None,
    height: Annotated[int | None, typer.Option(help="Pixels; overrides --size.")] = None,
    eye: Annotated[
        str | None,
        typer.Option(
            help="Camera. Not given: the file's, or a three-quarter view.", metavar="X,Y,Z"
        ),
    ] = None,
    target: Annotated[
        str | None,
        typer.Option(help="Where it looks. Not given: the model's middle.", metavar="X,Y,Z"),
    ] = None,
    fov: Annotated[
        float | None,
        typer.Option(help="Vertical field of view, degrees. Not given: the file's, or 45."),
    ] = None,
    what: Annotated[What, typer.Option(help="What to write.")] = What.visibility,
    exposure: Annotated[
        float | None,
        typer.Option(help="Of radiance in a PNG. Not given: makes the brightest pixels white."),
    ] = None,
    ground: Annotated[
        bool | None,
        typer.Option(
            help="A ground plane below the model. Not given: where a file has no camera and lights."
        ),
    ] = None,
) -> None:
    """Render a model's shadow to an image file."""
    check_path(output)
    if exposure is not None and not checks.number(exposure, "--exposure", "a positive number") > 0:
        raise ValueError(f"--exposure: expected a positive number, got {exposure}")
    w, h = _size(size)
    shape = (w if width is None else width, h if height is None else height)
    configured = _method(method, samples, seed, settings or ())
    view = _View(light, eye, target, fov, shape, ground)
    scene, camera, lit_by = view.of(model, up, light_radius)
    image = render_image(scene, camera, lit_by, configured, progress=True)
    seen = image.visibility
    if seen.ndim == 3 and output.suffix.lower() != ".npy":
        seen = seen.mean(axis=0)
    write(output, seen if what is What.visibility else image.radiance, exposure)
    error = image.error
    known = f", error {error.rmse:.2g} ({error.low:.2g} to {error.high:.2g})" if error else ""
    typer.echo(
        f"{output}: {what.value}, {camera.width}x{camera.height}, {configured}, "
        f"prepare {image.seconds['prepare']:.3g} s, frame {image.seconds['frame']:.3g} s{known}"
    )


@app.command()
def compare(
    models: Annotated[list[Path], typer.Argument(help="Files, as of 'softshadow render'.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="A folder; made where there is none.")
    ] = Path("comparison"),
    budget: Annotated[
        float,
        typer.Option(help="Seconds for all renders; what does not fit is left out. 0: no limit."),
    ] = 40.0,
    method: Annotated[
        list[str] | None,
        typer.Option(help="One to compare; may be repeated. Not given: all.", metavar="NAME"),
    ] = None,
    repeats: Annotated[int, typer.Option(help="Times are medians of so many, at most.")] = 3,
    light: Annotated[
        list[str] | None,
        typer.Option(help="As of 'softshadow render'; may be repeated.", metavar="SPEC"),
    ] = None,
    light_radius: Annotated[float | None, typer.Option(help="As of 'softshadow render'.")] = None,
    up: Annotated[Up, typer.Option(help="The files' axis that points up.")] = Up.z,
    size: Annotated[
        str | None,
        typer.Option(help="Pixels. Not given: the file's camera's, or 512x512.", metavar="WxH"),
    ] = None,
    eye: Annotated[str | None, typer.Option(help="Camera.", metavar="X,Y,Z")] = None,
    target: Annotated[str | None, typer.Option(help="Where it looks.", metavar="X,Y,Z")] = None,
    fov: Annotated[
        float | None,
        typer.Option(help="Vertical field of view, degrees. Not given: the file's, or 45."),
    ] = None,
    ground: Annotated[bool | None, typer.Option(help="As of 'softshadow render'.")] = None,
) -> None:
    """Measure methods on a model: how fast, how wrong; write pictures and a page.

    Slow methods are estimated on a small picture and left out where the budget has no time.
    """
    from softshadow.compare import compare as compare_methods
    from softshadow.comparing import distinct_names, table_text, write_pictures
    from softshadow.report import report as write_report

    if not checks.number(budget, "--budget", "seconds, or 0") >= 0:
        raise ValueError(f"--budget: expected seconds, or 0, got {budget}")
    view = _View(light, eye, target, fov, _size(size), ground)
    chosen = None if method is None else [resolve(name) for name in method]
    output.mkdir(parents=True, exist_ok=True)
    found = {}
    for model, name in distinct_names(models).items():
        scene, camera, lit_by = view.of(model, up, light_radius)
        share = budget / len(models) if budget else None
        result = compare_methods(
            scene, camera, lit_by, chosen, repeats=repeats, progress=True, budget=share
        )
        found[name] = result
        typer.echo(f"{model}: {scene}, {camera.width}x{camera.height}\n{table_text(result)}\n")
        for path in write_pictures(result, output, name):
            typer.echo(path)
    page = write_report(found, output / "report.html", commands=[shlex.join(_command())])
    typer.echo(page)


@app.command()
def report(
    results: Annotated[
        Path, typer.Argument(help="A sweep's folder, or a .parquet or .csv file.", metavar="TABLE")
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="A .html file.")],
    title: Annotated[str, typer.Option(help="Of the page.")] = "Speed against error",
) -> None:
    """Write a page about a table of measured cases: the front, tables that sort, pictures."""
    from softshadow.report import report as write_report
    from softshadow.report.tables import read_table

    table = read_table(results)
    page = write_report(table, output, title=title, commands=[shlex.join(_command())])
    typer.echo(f"{page}: {len(table)} cases")


@app.command()
def hard(
    output: Annotated[Path, typer.Option("--output", "-o", help="A .html file.")],
    case: Annotated[
        list[str] | None,
        typer.Option(help="One of the cases; may be repeated. Not given: all.", metavar="NAME"),
    ] = None,
) -> None:
    """Write a page about the hard cases: what is hard, and what every method makes of it."""
    from softshadow.report import report as write_report
    from softshadow.scenes import hard as cases

    names = list(cases) if case is None else case
    for name in names:
        if name not in cases:
            raise ValueError(f"--case {name!r}: expected one of {', '.join(cases)}")
    found = cases.compare(names, progress=True)
    notes = {name: cases[name].why for name in names}
    command = [shlex.join(_command())]
    page = write_report(found, output, title="Hard cases", commands=command, notes=notes)
    typer.echo(f"{page}: {', '.join(names)}")


def _command() -> list[str]:
    """Return the command line that runs, as one would type it."""
    return ["softshadow", *_given]


_given: list[str] = []
"""The arguments of `main`."""


@app.command()
def methods() -> None:
    """List the methods, what each can do, and its parameters."""
    head = ("method", "transparent", "points", "parameters")
    rows = [head]
    for name in method_names():
        method = resolve(name)
        can = ["yes" if x else "no" for x in (method.transparent, method.points)]
        parameters = ", ".join(f"{k}={v!r}" for k, v in method.parameters().items())
        rows.append((name, can[0], can[1], parameters))
    widths = [max(len(row[i]) for row in rows) for i in range(len(head))]
    for row in rows:
        typer.echo("  ".join(cell.ljust(n) for cell, n in zip(row, widths, strict=True)).rstrip())
    typer.echo(
        "\ntransparent: honours opacities below 1; points: answers at points, without a camera"
    )


@app.command()
def sweep(
    study: Annotated[Path, typer.Argument(help="A TOML file; see docs/sweeps.md.")],
    store: Annotated[
        Path | None, typer.Option(help="Where results go. Not given: as the study says.")
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(min=0, help="Processes that measure; 0: this one. A crash of one is a row."),
    ] = None,
    cluster: Annotated[
        str | None,
        typer.Option(help="A Dask scheduler whose workers measure.", metavar="ADDRESS"),
    ] = None,
    retry: Annotated[bool, typer.Option("--retry", help="Measure failed cases again.")] = False,
) -> None:
    """Measure all cases of a study; what is in its store already is skipped.

    Ctrl-C, and any other end, leaves a store that the same command goes on with.
    """
    from softshadow.sweep import pools
    from softshadow.sweep import sweep as measure
    from softshadow.sweep.study import read_study

    found = read_study(study)
    path = found.store if store is None else store
    try:
        count = found.workers if workers is None else workers
        with pools.processes(count) if cluster is None else pools.cluster(cluster) as executor:
            table = measure(found.cases, path, executor, retry=retry, **found.options)
    except KeyboardInterrupt:
        typer.echo(f"\ninterrupted; the same command goes on with {path}", err=True)
        raise
    failed = table[table["error"].notna()]
    for label, scene, error in failed[["label", "scene", "error"]].itertuples(index=False):
        typer.echo(f"failed: {label} on {scene}: {error}", err=True)
    typer.echo(f"{path}: {len(table)} cases, {len(failed)} failed")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit code.

    Parameters
    ----------
    arguments : sequence of str, optional
        Without the program's name; ``sys.argv[1:]`` when not given.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    _given[:] = given
    try:
        code = app(given, prog_name="softshadow", standalone_mode=False)
    except (KeyboardInterrupt, typer.Abort):
        code = _INTERRUPTED
    except (ValueError, OSError, MemoryError, ModuleNotFoundError) as error:
        return _fail(str(error))
    except Exception as error:
        # Wrong arguments. Typer has its own copy of Click or uses the installed one, by version, so
        # their common base class cannot be imported by name.
        message = getattr(error, "format_message", None)
        if message is None:
            raise
        return _fail(str(message()))
    return code if isinstance(code, int) else 0


def _fail(message: str) -> int:
    """Print an error on one line, and return its exit code."""
    print("error:", " ".join(message.split()), file=sys.stderr)
    return _USER_ERROR


if __name__ == "__main__":
    sys.exit(main())
