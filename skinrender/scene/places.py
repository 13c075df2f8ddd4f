"""Where in its file the value of a scene stands that was found wrong after the scene was checked."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from skinrender.errors import InputError, SceneError


@contextmanager
def about(scene: Any, *key: str | int) -> Iterator[None]:
    """Have what is found wrong with a part of a scene, within the block, name its ``file:line:col`` and key.

    Parameters
    ----------
    scene : a `Scene`.
    key : leads to the part; the key of a `SceneError` goes on from there. Without it other errors are left as they are,
        with it what they tell (of the file that the value names) follows the place.
    """
    try:
        yield
    except SceneError as error:
        path = (*key, *error.key)
        found = SceneError(error.message, key=path, remedy=error.remedy, place=scene.place(path))
        raise found from error.__cause__
    except InputError as error:
        if not key:
            raise
        raise SceneError(str(error), key=key, place=scene.place(key)) from error.__cause__
