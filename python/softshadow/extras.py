"""What is installed only for some uses: plots, metrics, files, the command line, Mitsuba."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["needs"]


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
