"""Check the smoke renders: ``python tests/smoke_check.py DIR``.

DIR holds a folder for each smoke scene, as ``skinrender render SCENE -o DIR/NAME --json > DIR/NAME/summary.json`` makes
it. Checked are: every number is finite, the mean radiance agrees with the stored one within both standard errors, and
the macule is darker than its surround.

``python tests/smoke_check.py --make`` renders the stored means again, with more photons and another seed.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from skinrender import load_scene, read_exr
from skinrender.estimate import point, radius
from skinrender.skin.pattern import read_pattern

ROOT = Path(__file__).parents[1]
REFERENCE = ROOT / "tests" / "data" / "smoke_reference.json"
SCENES = ("smoke_point", "smoke_beam")
LARGEST_Z = 4.0
KERNEL_MM = {"point": point.WIDEST_MM, "beam": radius.WIDEST_MM}
MORE_PHOTONS = 10
REFERENCE_SEED = 2


def scene_file(name: str) -> Path:
    return ROOT / "configs" / f"{name}.yaml"


def mean_z(found: dict, reference: dict) -> float:
    """Difference of two means in units of their common standard error."""
    return (found["value"] - reference["value"]) / math.hypot(found["stderr"], reference["stderr"])


def darkness_z(folder: Path, name: str) -> float:
    """How much darker the macule is than its surround, in standard errors."""
    scene = load_scene(scene_file(name))
    lesion = scene.lesions[0]
    pattern = read_pattern(scene.path(lesion.pattern), scene.patch.columns, lesion.melanin_scale).T
    image = read_exr(folder / f"{scene.estimate.method}.exr")
    height, width = image.stderr_Y.shape
    rows = (np.arange(height) + 0.5) * pattern.shape[0] / height
    columns = (np.arange(width) + 0.5) * pattern.shape[1] / width
    value = pattern[np.ix_(rows.astype(int), columns.astype(int))]
    macule, surround = value > 0.5 * pattern.max(), value == 0
    y = image.y()
    # pixels within a kernel share photons: a biweight makes 5 pi r^2 / 9 of them one independent value
    pixel_mm = scene.patch.size_mm[0] / width
    shared = max(1.0, 5.0 * math.pi / 9.0 * (KERNEL_MM[scene.estimate.method] / pixel_mm) ** 2)
    sums = [np.linalg.norm(image.stderr_Y[part].astype(float)) / part.sum() for part in (macule, surround)]
    errors = math.sqrt(shared) * np.array(sums)
    return float((y[surround].mean() - y[macule].mean()) / np.hypot(*errors))


def problems_of(folder: Path, name: str, reference: dict) -> list[str]:
    """What is wrong with one smoke render."""
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    image = read_exr(folder / f"{summary['method']}.exr")
    z, darker = mean_z(summary["mean_radiance"], reference["mean_radiance"]), darkness_z(folder, name)
    print(f"{name}: z of the mean radiance {z:+.2f}, macule darker by {darker:.1f} standard errors")
    parts = (image.radiance, image.surface_Y, image.single_Y, image.multiple_Y, image.stderr_Y)
    checks = {
        "a value is not finite": summary["nan_pixels"] == 0 and all(np.isfinite(part).all() for part in parts),
        "a radiance is negative": bool((image.radiance >= 0).all()),
        f"its mean radiance is {z:+.2f} standard errors from the stored one": abs(z) < LARGEST_Z,
        "the macule is not darker than its surround": darker > LARGEST_Z,
    }
    return [f"{name}: {problem}" for problem, good in checks.items() if not good]


def make_reference() -> None:
    """Render the stored means."""
    means = {}
    with tempfile.TemporaryDirectory() as folder:
        for name in SCENES:
            scene = load_scene(scene_file(name))
            options = {
                "--photons": MORE_PHOTONS * scene.photons.stored,
                "--seed": REFERENCE_SEED,
            }
            words = [str(word) for option in options.items() for word in option]
            command = ["-m", "skinrender.cli", "render", scene_file(name), "-o", f"{folder}/{name}", "--json", *words]
            done = subprocess.run([sys.executable, *command], check=True, stdout=subprocess.PIPE, text=True)
            means[name] = {"mean_radiance": json.loads(done.stdout)["mean_radiance"], "options": " ".join(words)}
    REFERENCE.write_text(json.dumps(means, indent=2) + "\n", encoding="utf-8")


def main(arguments: list[str]) -> int:
    if arguments == ["--make"]:
        make_reference()
        return 0
    if len(arguments) != 1:
        print(__doc__, file=sys.stderr)
        return 2
    reference = json.loads(REFERENCE.read_text(encoding="utf-8"))
    problems = [problem for name in SCENES for problem in problems_of(Path(arguments[0]) / name, name, reference[name])]
    print("\n".join(problems) or "smoke renders are right")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
