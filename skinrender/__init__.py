"""skinrender: human skin with macules, rendered from its inside by photon mapping.

>>> import skinrender
>>> scene = skinrender.load_scene("configs/smoke_beam.yaml")
>>> volume = skinrender.build(scene)
"""

from __future__ import annotations

import importlib
import sys
import types

_HOME = {
    "load_scene": "skinrender.scene.load",
    "build": "skinrender.skin.builder:build_volume",
    "load_volume": "skinrender.skin.volume",
    "save_volume": "skinrender.skin.volume",
    "trace": "skinrender.engine.trace",
    "open_map": "skinrender.photonmap.photon_map",
    "estimate": "skinrender.engine.estimate",
    "spectrum": "skinrender.analysis.spectrum",
    "read_exr": "skinrender.film.exr",
    "write_exr": "skinrender.film.exr",
    "InputError": "skinrender.errors",
    "RunError": "skinrender.errors",
}
__all__ = sorted(_HOME)


def __getattr__(name: str):
    if name in _HOME:
        module, _, function = _HOME[name].partition(":")
        return getattr(importlib.import_module(module), function or name)
    raise AttributeError(f"module 'skinrender' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__


class _Package(types.ModuleType):
    """This module. The package `skinrender.estimate`, once imported, would hide the function of that name."""

    @property
    def estimate(self):
        return __getattr__("estimate")

    @estimate.setter
    def estimate(self, package: types.ModuleType) -> None:
        """The import system's wish to make the package an attribute; it is found in ``sys.modules``."""


sys.modules[__name__].__class__ = _Package
