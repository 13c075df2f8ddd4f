"""Pictures by the shipped command, for sheets of them."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

SKINRENDER = (sys.executable, "-m", "skinrender.cli")


def render(scene: Path, folder: Path, options: Sequence[str]) -> dict[str, Any]:
    """The summary of `skinrender render`. Of what it wrote the photon map is removed: a sheet's would fill
    gigabytes."""
    command = [*SKINRENDER, "render", str(scene), *options, "-o", str(folder), "--quiet", "--json"]
    summary = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout)
    (folder / "photons.npz").unlink(missing_ok=True)
    return summary
