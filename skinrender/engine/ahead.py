"""Kernels of the estimate, compiled in a process beside the walk's where none are on disk yet.

Numba compiles one kernel at a time in a process. On two cores the first render of a small scene took 17 to 19 s by
the clock with this, some 24 without.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from skinrender.engine.view import View
from skinrender.estimate.deposit import deposit
from skinrender.estimate.gather_points import gather_points
from skinrender.photonmap.from_rounds import map_from_rounds
from skinrender.photonmap.light import light_from_scene
from skinrender.photonmap.photon_pass import PhotonPass
from skinrender.skin.volume import SkinVolume, load_volume
from skinrender.transport.kernel_cache import can_keep, is_on_disk, kept_in

_MISSING_FIRST = {"beam": deposit, "point": gather_points}
"""A kernel of each method without which a machine has not made such a picture yet."""


@contextmanager
def kernels_ahead(scene: Any, volume_path: Path) -> Iterator[Callable[[], object]]:
    """Compile what the picture of a scene needs while the block runs, if none was made here before.

    Gives the function that waits for it.

    A process that fails costs nothing but its time: who needs a kernel compiles it then.
    """
    kernel = _MISSING_FIRST.get(scene.estimate.method)
    missing = kernel is not None and not is_on_disk(kernel) and can_keep()
    process = _start(pickle.dumps((scene, volume_path))) if missing and (os.cpu_count() or 1) > 1 else None
    if process is None:
        yield lambda: None
        return
    try:
        yield process.wait
    finally:
        process.kill()
        process.communicate()


def _start(task: bytes) -> subprocess.Popen | None:
    """The process that compiles; None where there can't be one. It looks for modules where this one does."""
    try:
        process = subprocess.Popen(
            [sys.executable or "", "-P", "-m", __name__],
            env=os.environ | kept_in() | {"PYTHONPATH": os.pathsep.join(sys.path)},
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            start_new_session=True,  # not a terminal's Ctrl-C but the end of this run ends it
        )  # fmt: skip
    except OSError:
        return None
    with suppress(BrokenPipeError):
        process.stdin.write(task)
        process.stdin.flush()
    return process


def _compile() -> None:
    scene, volume_path = pickle.load(sys.stdin.buffer)
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    view = View(_with_few_pixels(scene), load_volume(volume_path), scene.estimate.method, scene.estimate.gather_count)
    view.prepare()
    view.scattered(_map_without_photons(scene, view.volume), progress=False)


def _leave_with_parent() -> None:
    """End this process when the one that started it ends, however that ends: it holds the other end of the pipe."""
    os.read(sys.stdin.fileno(), 1)  # not through the buffer, whose lock Python waits for when it ends
    os._exit(1)


def _with_few_pixels(scene: Any) -> Any:
    return scene.model_copy(update={"camera": scene.camera.model_copy(update={"pixels": (2, 2)})})


def _map_without_photons(scene: Any, volume: SkinVolume) -> Any:
    walk = PhotonPass(volume, light_from_scene(scene), scene.photons.seed, roulette=scene.photons.roulette)
    return map_from_rounds(walk, [walk.walk(0, np.zeros(walk.bands), store=False)])


if __name__ == "__main__":
    _compile()
