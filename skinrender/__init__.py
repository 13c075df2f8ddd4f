"""skinrender: human skin with macules, rendered from its inside by photon mapping.

>>> import skinrender
>>> scene = skinrender.load_scene("configs/smoke_beam.yaml")
>>> volume = skinrender.build(scene)

Lengths are in mm, coefficients in 1/mm, wavelengths in nm, power in W. Arrays are NumPy's, everything else are frozen
dataclasses; nothing is printed. What a user can mend is raised as `InputError`, what the machine refuses as `RunError`.
Importing the package is quick: each name is looked up when it is first used. Type checkers read ``__init__.pyi``.
"""

from __future__ import annotations

import importlib
import sys
import types
from typing import Any

_HOME = {
    "load_scene": "skinrender.scene.load",
    "make_scene": "skinrender.scene.load",
    "plan": "skinrender.engine.plan:make_plan",
    "build": "skinrender.skin.builder:build_volume",
    "save_volume": "skinrender.skin.volume",
    "load_volume": "skinrender.skin.volume",
    "trace": "skinrender.engine.trace",
    "merge": "skinrender.engine.shards",
    "open_map": "skinrender.photonmap.photon_map",
    "estimate": "skinrender.engine.estimate",
    "spectrum": "skinrender.analysis.spectrum",
    "compare": "skinrender.analysis.compare",
    "read_exr": "skinrender.film.exr",
    "write_exr": "skinrender.film.exr",
    "write_png": "skinrender.film.png",
    "Scene": "skinrender.scene.schema",
    "SkinVolume": "skinrender.skin.volume",
    "PhotonMap": "skinrender.photonmap.photon_map",
    "TraceSummary": "skinrender.engine.summary",
    "EstimateSummary": "skinrender.engine.estimate",
    "SpectralImage": "skinrender.film.spectral_image",
    "SkinSpectrum": "skinrender.analysis.spectrum",
    "InputError": "skinrender.errors",
    "RunError": "skinrender.errors",
}
__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    if name in _HOME:
        module, _, function = _HOME[name].partition(":")
        return getattr(importlib.import_module(module), function or name)
    raise AttributeError(f"module 'skinrender' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__


class _Package(types.ModuleType):
    """This module. The package `skinrender.estimate`, once imported, would hide the function of that name."""

    @property
    def estimate(self) -> Any:
        return __getattr__("estimate")

    @estimate.setter
    def estimate(self, package: types.ModuleType) -> None:
        """The import system's wish to make the package an attribute; it is found in ``sys.modules``."""


sys.modules[__name__].__class__ = _Package
