"""Kernels of the estimate, compiled in a process beside the walk's where none are on disk yet.

Numba compiles one kernel at a time in a process. On two cores the first render of a small scene took 16 s with this and 23 s
without.
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
from skinrender.skin.volume import load_volume
from skinrender.transport.kernel_cache import is_on_disk

_LAST_KERNEL = {"beam": deposit, "point": gather_points}


@contextmanager
def kernels_ahead(scene: Any, volume_path: Path) -> Iterator[Callable[[], object]]:
    """Compile what the picture of a scene needs while the block runs, if it was never compiled; gives what waits for it.

    A process that fails costs nothing but its time: who needs a kernel compiles it then.
    """
    last = _LAST_KERNEL.get(scene.estimate.method)
    if last is None or is_on_disk(last) or (os.cpu_count() or 1) < 2:
        yield lambda: None
        return
    process = subprocess.Popen(
        [sys.executable, "-m", __name__], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        start_new_session=True,  # not a terminal's Ctrl-C but the end of this run ends it
    )  # fmt: skip
    try:
        with suppress(BrokenPipeError):
            process.stdin.write(pickle.dumps((scene, volume_path)))
            process.stdin.flush()
        yield process.wait
    finally:
        process.kill()
        process.communicate()


def _compile() -> None:
    scene, volume_path = pickle.load(sys.stdin.buffer)
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    view = View(_with_few_pixels(scene), load_volume(volume_path), scene.estimate.method, scene.estimate.gather_count)
    view.scattered(_map_without_photons(scene, view.volume), progress=False)
    view.prepare()


def _leave_with_parent() -> None:
    """End this process when the one that started it ends, however that ends: it holds the other end of the pipe."""
    sys.stdin.buffer.read()
    os._exit(1)


def _with_few_pixels(scene: Any) -> Any:
    return scene.model_copy(update={"camera": scene.camera.model_copy(update={"pixels": (2, 2)})})


def _map_without_photons(scene: Any, volume: Any) -> Any:
    walk = PhotonPass(volume, light_from_scene(scene), scene.photons.seed, roulette=scene.photons.roulette)
    return map_from_rounds(walk, [walk.walk(0, np.zeros(walk.bands), store=False)])


if __name__ == "__main__":
    _compile()
