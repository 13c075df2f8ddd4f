"""Draw the macule patterns that the shipped scenes use: ``python patterns/draw.py`` writes them beside itself.

One pixel is one column of voxels; black is most melanin. Every pattern is drawn from a fixed seed.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

FOLDER = Path(__file__).parent


def smooth_noise(shape: tuple[int, int], length: float, rng: np.random.Generator) -> np.ndarray:
    """Gaussian noise (rows, columns) of variance 1 that varies over ``length`` pixels."""
    fy, fx = np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1])
    spectrum = np.fft.rfft2(rng.standard_normal(shape)) * np.exp(-0.5 * (2 * np.pi * length) ** 2 * (fx**2 + fy**2) / 2)
    spectrum[0, 0] = 0
    noise = np.fft.irfft2(spectrum, s=shape)
    return noise / noise.std()


def polar(size: int, center: tuple[float, float] = (0.5, 0.5)) -> tuple[np.ndarray, np.ndarray]:
    """Distance from the center in units of the side, and angle, of each pixel."""
    at = (np.arange(size) + 0.5) / size
    x, y = at[None, :] - center[0], at[:, None] - center[1]
    return np.hypot(x, y), np.arctan2(y, x)


def soft_step(x: np.ndarray) -> np.ndarray:
    """0 below 0, 1 above 1, smooth between."""
    x = np.clip(x, 0, 1)
    return x * x * (3 - 2 * x)


def macule(size: int, darkest: float = 0.45) -> np.ndarray:
    """Darkness of an irregular macule with a soft edge, mottled inside (compare the paper's figure 11)."""
    rng = np.random.default_rng(11)
    distance, angle = polar(200)
    outline = 0.29 + sum(a * np.cos(k * angle + phase) for k, a, phase in ((2, 0.035, 0.6), (3, 0.022, 2.1), (5, 0.014, 4.0)))
    edge = (outline - distance) / 0.14 + 0.5 + 0.22 * smooth_noise((200, 200), 7, rng)
    mottled = 0.80 + 0.12 * smooth_noise((200, 200), 6, rng) + 0.05 * smooth_noise((200, 200), 2, rng)
    darkness = soft_step(edge) * np.clip(mottled, 0.3, 1)
    if size != 200:
        darkness = np.asarray(Image.fromarray(darkness.astype(np.float32)).resize((size, size), Image.Resampling.BOX))
    return darkest * darkness / darkness.max()


def freckles(size: int = 200, count: int = 24, darkest: float = 0.45) -> np.ndarray:
    """Darkness of scattered small spots of unequal size and depth of color."""
    rng = np.random.default_rng(5)
    darkness = np.zeros((size, size))
    for center, radius, strength in zip(
        rng.uniform(0.06, 0.94, (count, 2)), rng.lognormal(np.log(0.045), 0.35, count), rng.uniform(0.35, 1, count)
    ):
        distance, angle = polar(size, tuple(center))
        phases = rng.uniform(0, 2 * np.pi, 2)
        outline = radius * (1 + 0.12 * np.cos(2 * angle + phases[0]) + 0.05 * np.cos(3 * angle + phases[1]))
        darkness = np.maximum(darkness, strength * soft_step((outline - distance) / (0.9 * radius) + 0.5))
    return darkest * darkness / darkness.max()


def nevus(size: int = 200, darkest: float = 0.9) -> np.ndarray:
    """Darkness of a small round mole: a dark middle with a network towards its edge."""
    rng = np.random.default_rng(8)
    distance, angle = polar(size)
    outline = 0.15 * (1 + 0.06 * np.cos(2 * angle + 1) + 0.04 * np.cos(5 * angle))
    body = soft_step((outline - distance) / 0.05 + 0.5)
    net = 1 - 0.35 * soft_step(distance / outline) * (0.5 + 0.5 * np.tanh(smooth_noise((size, size), 2.5, rng)))
    darkness = body * net
    return darkest * darkness / darkness.max()


def lettering(size: int = 200, text: str = "Skin", darkest: float = 0.8) -> np.ndarray:
    """Darkness of tattooed letters, their edges a little blurred by the spreading of ink."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(1, 1), dpi=4 * size)
    canvas = FigureCanvasAgg(figure)
    font = {"family": "DejaVu Serif", "style": "italic", "weight": "bold"}
    figure.text(0.5, 0.5, text, ha="center", va="center", size=24, **font)
    canvas.draw()
    ink = 1 - np.asarray(canvas.buffer_rgba())[..., 0] / 255.0
    ink = ink.reshape(size, 4, size, 4).mean(axis=(1, 3))
    fy, fx = np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)
    blurred = np.fft.irfft2(np.fft.rfft2(ink) * np.exp(-2 * np.pi**2 * (fx**2 + fy**2)), s=ink.shape)
    return darkest * np.clip(blurred, 0, 1)


def save(name: str, darkness: np.ndarray) -> None:
    """Write darkness (0 white, 1 black) as an 8-bit gray PNG."""
    gray = np.floor(255 * (1 - darkness) + 0.5).astype(np.uint8)
    Image.fromarray(gray).save(FOLDER / name, optimize=True)


if __name__ == "__main__":
    save("macule.png", macule(200))
    save("macule_80.png", macule(80))
    save("freckles.png", freckles())
    save("nevus.png", nevus())
    save("lettering.png", lettering())
