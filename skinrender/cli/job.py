"""A job: a scene, the folder its files go to, and the clock that runs meanwhile."""

from __future__ import annotations

import errno
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from skinrender.cli.console import Console
from skinrender.errors import InputError
from skinrender.files import printable

if TYPE_CHECKING:
    from skinrender.engine.clock import StageClock
    from skinrender.scene import Scene
    from skinrender.scene.overrides import Override

_NO_SUCH_NAME = (errno.ENAMETOOLONG, errno.ELOOP, errno.ENOENT)
"""What the system says of folders that cannot be, whoever asks."""


@dataclass(frozen=True)
class Job:
    """What a command works on.

    Parameters
    ----------
    scene : checked, options and overrides applied.
    scene_path : as the user wrote it, for messages.
    out : folder of the results; exists.
    console : to speak to.
    clock : seconds by stage.
    began : `time.monotonic` of the command's beginning.
    """

    scene: Scene
    scene_path: Path
    out: Path
    console: Console
    clock: StageClock
    began: float

    @property
    def volume(self) -> Path:
        return self.out / "volume.npz"

    @property
    def section(self) -> Path:
        return self.out / "section.png"

    @property
    def photons(self) -> Path:
        return self.out / "photons.npz"

    @property
    def exr(self) -> Path:
        return self.out / f"{self.scene.estimate.method}.exr"

    @property
    def png(self) -> Path:
        return self.out / f"{self.scene.estimate.method}.png"

    @property
    def page(self) -> Path:
        return self.out / "index.html"

    def write_page(self) -> None:
        """Write ``index.html``, which explains the folder."""
        from skinrender.analysis.folder_page import write_folder_page

        write_folder_page(self.page, self.scene, command_line())

    def log_seconds(self, command: str, workers: int | None) -> None:
        """Add this job's seconds to its ``timing.csv``."""
        import os

        from skinrender.engine.clock import append_timing

        seconds = self.clock.seconds
        append_timing(self.out / "timing.csv", seconds, command=command, workers=workers or os.cpu_count() or 1)


def open_job(scene_path: Path, overrides: Iterable[str | Override], output: Path | None, console: Console) -> Job:
    """Read the scene and make its folder; raises `InputError` where either is impossible."""
    from skinrender.engine.clock import StageClock
    from skinrender.scene import load_scene

    began, clock = time.monotonic(), StageClock()
    with clock.stage("load"):
        scene = load_scene(scene_path, overrides)
    out = make_folder(output if output is not None else Path("out") / scene.name)
    return Job(scene, scene_path, out, console, clock, began)


def command_line() -> str:
    """The command as it was given, as text."""
    import shlex
    import sys

    return printable(shlex.join(["skinrender", *sys.argv[1:]]))


def make_folder(path: Path) -> Path:
    """The folder, made if need be; raises `InputError` where it cannot be, or has a name that pictures cannot be in."""
    if printable(path) != str(path):
        # OpenEXR takes names in UTF-8 only, and what JSON and pages say of the files must be text.
        raise InputError("its name is not UTF-8", where=f"-o {printable(path)}", remedy="name a folder whose name is text")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise InputError(
            "is not a folder", where=f"-o {path}", remedy="name a folder; it is made if there is none"
        ) from None
    except OSError as error:
        if error.errno not in _NO_SUCH_NAME:
            raise
        raise InputError(
            f"cannot be made: {error.strerror}", where=f"-o {path}", remedy="name another folder with -o"
        ) from None
    return path
