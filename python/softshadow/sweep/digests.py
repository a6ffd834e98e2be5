"""What a thing is known by: a digest of its contents, the same in every process."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass

import numpy as np

from softshadow.camera import Camera
from softshadow.scene import Scene

__all__ = ["digest"]

_BYTES = 16
"""Enough that two of a billion cases are the same by chance once in 10^20 times."""


def digest(*things: object) -> str:
    """Return 32 hexadecimal digits that change with any bit of what things are made of.

    Parameters
    ----------
    *things
        Scenes, cameras, lights, methods, arrays, numbers, text, None, and sequences of them.

    Raises
    ------
    TypeError
        If a thing is of another type.
    """
    state = hashlib.blake2b(digest_size=_BYTES)
    _feed(state, things)
    return state.hexdigest()


def _feed(state: hashlib.blake2b, thing: object) -> None:
    """Feed a thing with its type and length, so that no two things have the same bytes."""
    if isinstance(thing, np.ndarray):
        state.update(f"array {thing.dtype.str} {thing.shape};".encode())
        state.update(np.ascontiguousarray(thing).tobytes())
    elif isinstance(thing, Scene):
        state.update(b"scene;")
        _feed(state, thing.entries)
    elif isinstance(thing, Camera):
        state.update(b"camera;")
        _feed(state, (thing.K, thing.camera_to_world, thing.width, thing.height))
    elif is_dataclass(thing) and not isinstance(thing, type):
        state.update(f"{type(thing).__name__};".encode())
        for field in fields(thing):
            if field.init and field.compare:  # the others are made from these or change no picture
                _feed(state, field.name)
                _feed(state, getattr(thing, field.name))
    elif isinstance(thing, Mapping):
        _feed(state, tuple(thing.items()))
    elif isinstance(thing, (tuple, list)):
        state.update(f"{len(thing)} of;".encode())
        for part in thing:
            _feed(state, part)
    elif isinstance(thing, float):
        state.update(f"float {float(thing).hex()};".encode())
    elif thing is None or isinstance(thing, (bool, int, str)):
        text = f"{type(thing).__name__} {thing}".encode()
        state.update(b"%d " % len(text) + text)
    else:
        raise TypeError(f"digest: {type(thing).__name__} has no digest")
