"""What can go wrong, in the two ways a command's exit code tells apart."""

from __future__ import annotations


class InputError(Exception):
    """The user's input or use is wrong (exit code 2).

    Parameters
    ----------
    message : what is wrong, in one sentence.
    where : file, ``file:line:col`` or option that holds the mistake.
    remedy : what to write or do instead.
    """

    def __init__(self, message: str, *, where: str | None = None, remedy: str | None = None):
        text = f"{where}: {message}" if where else message
        super().__init__(f"{text}\n  {remedy}" if remedy else text)


class SceneError(InputError):
    """A value of a scene is wrong, which shows only when it is used (exit code 2).

    Parameters
    ----------
    message, remedy : see `InputError`.
    key : leads to the value from the part of the scene that is at hand; `scene.about` completes it and adds the place.
    place : ``file:line:col`` of the value.
    """

    def __init__(
        self, message: str, *, key: tuple[str | int, ...] = (), remedy: str | None = None, place: str | None = None
    ):
        where = ": ".join(part for part in (place, ".".join(map(str, key))) if part)
        super().__init__(message, where=where, remedy=remedy)
        self.message, self.key, self.remedy = message, key, remedy


class RunError(Exception):
    """The input is right but the run failed (exit code 1)."""
