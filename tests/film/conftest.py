import numpy as np
import pytest

from skinrender.film import color
from skinrender.film.spectral_image import SpectralImage
from skinrender.optics.illuminants import band_weights


@pytest.fixture
def make_image():
    """A random picture under a lamp whose irradiance falls off over the patch."""

    def make(bands=None, lamp="D65", size=(9, 12), seed=1):
        rng = np.random.default_rng(seed)
        wavelength_nm = np.arange(380.0, 781.0, 5.0) if bands is None else np.array(bands, float)
        light = band_weights(lamp, wavelength_nm)
        total = 0.1 * rng.uniform(0.5, 1.0, size)
        irradiance = (total[..., np.newaxis] * light).astype(np.float32)
        factor = rng.uniform(0.2, 0.6, (*size, wavelength_nm.size))
        parts = [rng.uniform(0, 1, size).astype(np.float32) for _ in range(4)]
        return SpectralImage(
            (factor * irradiance / np.pi).astype(np.float32),
            wavelength_nm,
            *parts,
            irradiance=irradiance,
            exposure=color.exposure_for(0.1 * light, wavelength_nm),
            provenance={"scene": "テスト", "seed": 2**40},
        )

    return make
