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


class RunError(Exception):
    """The input is right but the run failed (exit code 1)."""
