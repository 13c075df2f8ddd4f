"""How a macule's melanin changes skin: picture, spectrum, color.

    python docs/examples/more_melanin.py [KEY.PATH=VALUE ...]

renders a small scene twice and writes into out/more_melanin. Further words set values of the scene, as `--set` does.
"""

# %% [markdown]
# A scene is a YAML file; any of its values can be set while it is loaded. Here are two scenes that differ in one number,
# the melanosome fraction that the black of the pattern stands for.

# %%
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import skinrender

REPOSITORY = Path(__file__).parents[2]
OUT = Path("out/more_melanin")

SCENE = REPOSITORY / "configs" / "smoke_beam.yaml"
SETTINGS = ["camera.pixels=[64, 64]", "photons.stored=3e7", *sys.argv[1:]]

scenes = {
    scale: skinrender.load_scene(SCENE, [*SETTINGS, f"lesions.0.melanin_scale={scale}"]) for scale in (0.05, 0.4)
}

# %% [markdown]
# From a scene a volume is built: voxels as indices into a palette, the palette's coefficients by wavelength in 1/mm, and
# the layers' borders. All arrays are NumPy's.

# %%
volumes = {scale: skinrender.build(scene) for scale, scene in scenes.items()}
light = volumes[0.05]
basal = light.palette_layer == light.layer_name.index("basal")
band = int(np.argmin(abs(light.wavelength_nm - 550)))
print(f"{' x '.join(map(str, light.shape))} voxels, {len(light.palette_layer)} kinds of them")
print(f"basal layer at {light.wavelength_nm[band]:g} nm: mu_a {light.mu_a[basal, band].min():.2f} to "
      f"{light.mu_a[basal, band].max():.2f} per mm")

# %% [markdown]
# `spectrum` measures the skin as a spectrophotometer does, without a picture: the share of light that comes back in each
# band, and its color under D65. On a scene with a lesion it also tells inside and outside apart. Every number has its
# standard error.

# %%
STDERR = 0.005  # relative, mean over the bands
spectra = {scale: skinrender.spectrum(scene, volumes[scale], stderr=STDERR) for scale, scene in scenes.items()}
for scale, found in spectra.items():
    color = found.inside.color
    told = [f"{name} {lab:.1f} ± {error:.1f}" for name, lab, error in zip("Lab", color.lab, color.lab_stderr)]
    print(f"melanin_scale {scale}: the macule has {', '.join(told)}")

# %% [markdown]
# The picture takes two steps. `trace` walks photons and writes those that scatter into a file, for there may be more of
# them than memory holds; `estimate` reads the file back as arrays on the disk. The picture is the spectral radiance of
# every pixel, in W mm⁻² sr⁻¹ in each band. (With more than one worker `trace` starts processes, which import the script
# that started them: there the call belongs under `if __name__ == "__main__":`.)

# %%
images = {}
for scale, scene in scenes.items():
    folder = OUT / f"melanin_{scale}"
    folder.mkdir(parents=True, exist_ok=True)
    skinrender.save_volume(volumes[scale], folder / "volume.npz")
    traced = skinrender.trace(scene, folder / "volume.npz", folder, workers=1, progress=False)
    photons = skinrender.open_map(folder / "photons.npz")
    images[scale], summary = skinrender.estimate(scene, volumes[scale], photons, progress=False)
    skinrender.write_exr(folder / "beam.exr", images[scale])
    print(f"melanin_scale {scale}: {traced.stored} photons stored of {traced.emitted}, "
          f"noise of a pixel {100 * summary.stderr_relative_mean:.1f} %")

skinrender.write_png(OUT / "pictures.png", np.hstack([image.display_rgb() for image in images.values()]))

# %% [markdown]
# Both pictures side by side, melanin_scale 0.05 on the left and 0.4 on the right.
#
# ![Two macules, the right one darker](images/more_melanin_pictures.png){ width="512" }
#
# The spectra, drawn with matplotlib:

# %%
figure = Figure(figsize=(6, 3.5), layout="constrained")
axes = figure.subplots()
for scale, found in spectra.items():
    inside = found.inside
    axes.errorbar(found.wavelength_nm, inside.total, 2 * inside.total_stderr, label=f"melanin_scale {scale}")
axes.plot(found.wavelength_nm, found.outside.total, "k:", label="outside the macule")
axes.set(xlabel="wavelength / nm", ylabel="reflectance", ylim=(0, None))
axes.legend()
figure.savefig(OUT / "spectra.png", dpi=110)

# %% [markdown]
# ![Reflectance of both macules and of the skin beside them](images/more_melanin_spectra.png)
#
# Melanin takes more of the blue than of the red, so the darker macule is also browner. Error bars are twice the standard
# error.
