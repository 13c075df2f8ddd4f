"""Pictures by the shipped command, for sheets of them."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from skinrender.errors import RunError

SKINRENDER = (sys.executable, "-m", "skinrender.cli")


def render(scene: Path, folder: Path, options: Sequence[str]) -> dict[str, Any]:
    """The summary of `skinrender render`. Of what it wrote the photon map is removed: a sheet's would fill
    gigabytes. Raises `RunError` where the command, which has told why, failed."""
    command = [*SKINRENDER, "render", str(scene), *options, "-o", str(folder), "--quiet", "--json"]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True)
    if done.returncode:
        raise RunError(f"rendering {scene} into {folder} ended with exit code {done.returncode}")
    summary = json.loads(done.stdout)
    (folder / "photons.npz").unlink(missing_ok=True)
    return summary
