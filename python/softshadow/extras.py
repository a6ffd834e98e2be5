"""What is installed only for some uses: plots, metrics, files, the command line, Mitsuba."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module

__all__ = ["needs", "require"]


@contextmanager
def needs(extra: str, what: str) -> Iterator[None]:
    """Say which extra to install where an import within the block finds nothing.

    Parameters
    ----------
    extra : str
        One of ``project.optional-dependencies`` in ``pyproject.toml``.
    what : str
        What the module is for.

    Raises
    ------
    ModuleNotFoundError
        If a module is missing.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        # trimesh raises what it found missing again, without its name.
        found = error.name or "".join(re.findall(r"named '([\w.]+)'", str(error)))
        package = found.partition(".")[0] or "a package"
        raise ModuleNotFoundError(
            f'{what} needs {package}, which is not installed: pip install "softshadow[{extra}]"',
            name=found or None,
        ) from error


def require(extra: str, what: str, *modules: str) -> None:
    """Import modules now, so that what is missing is said before any work is done.

    Parameters
    ----------
    extra, what : str
        As of `needs`.
    *modules : str
        Their names.

    Raises
    ------
    ModuleNotFoundError
        If one is missing.
    """
    with needs(extra, what):
        for module in modules:
            import_module(module)
