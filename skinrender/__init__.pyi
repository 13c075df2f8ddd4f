"""The names of the Python API, for type checkers and editors; ``__init__.py`` imports each when it is first used."""

from skinrender.analysis.compare import compare
from skinrender.analysis.spectrum import SkinSpectrum, spectrum
from skinrender.engine.estimate import EstimateSummary, estimate
from skinrender.engine.plan import make_plan as plan
from skinrender.engine.shards import merge
from skinrender.engine.summary import TraceSummary
from skinrender.engine.trace import trace
from skinrender.errors import InputError, RunError
from skinrender.film.exr import read_exr, write_exr
from skinrender.film.png import write_png
from skinrender.film.spectral_image import SpectralImage
from skinrender.photonmap.photon_map import PhotonMap, open_map
from skinrender.scene.load import load_scene, make_scene
from skinrender.scene.schema import Scene
from skinrender.skin.builder import build_volume as build
from skinrender.skin.volume import SkinVolume, load_volume, save_volume

__all__ = [
    "load_scene",
    "make_scene",
    "plan",
    "build",
    "save_volume",
    "load_volume",
    "trace",
    "merge",
    "open_map",
    "estimate",
    "spectrum",
    "compare",
    "read_exr",
    "write_exr",
    "write_png",
    "Scene",
    "SkinVolume",
    "PhotonMap",
    "TraceSummary",
    "EstimateSummary",
    "SpectralImage",
    "SkinSpectrum",
    "InputError",
    "RunError",
]
