"""skinrender: human skin with macules, rendered from its inside by photon mapping.

>>> import skinrender
>>> scene = skinrender.load_scene("configs/smoke_beam.yaml")
>>> volume = skinrender.build_volume(scene)
"""

from __future__ import annotations

import importlib

_HOME = {
    "load_scene": "skinrender.scene.load",
    "build_volume": "skinrender.skin.builder",
    "load_volume": "skinrender.skin.volume",
    "save_volume": "skinrender.skin.volume",
    "trace": "skinrender.engine.trace",
    "open_map": "skinrender.photonmap.photon_map",
    "estimate": "skinrender.engine.estimate",
    "read_exr": "skinrender.film.exr",
    "write_exr": "skinrender.film.exr",
    "InputError": "skinrender.errors",
    "RunError": "skinrender.errors",
}
__all__ = sorted(_HOME)


def __getattr__(name: str):
    if name in _HOME:
        return getattr(importlib.import_module(_HOME[name]), name)
    raise AttributeError(f"module 'skinrender' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
