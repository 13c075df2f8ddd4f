"""NRRD volumes: layers as a segmentation with names (3D Slicer), pigments as numbers; ITK-SNAP and ParaView read both.

Header fields after G. Kindlmann, Definition of the NRRD file format (teem.sourceforge.net/nrrd/format.html). Positions are
the program's own: x, y along the patch, z down into the skin, mm, written as ``left-posterior-superior``.
"""

from __future__ import annotations

import gzip
import itertools
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from skinrender.atomic import whole_file
from skinrender.errors import InputError
from skinrender.export.grid import Labels, even_labels
from skinrender.skin.volume import SkinVolume

_LONGEST_LINE = 1 << 22
_TYPES = {"u1": "uint8", "f4": "float"}
_COLORS = (
    (0.91, 0.83, 0.66), (0.95, 0.73, 0.55), (0.81, 0.56, 0.35), (0.97, 0.81, 0.82), (0.94, 0.71, 0.71),
    (0.85, 0.47, 0.49), (0.95, 0.83, 0.82), (0.79, 0.40, 0.42), (0.96, 0.90, 0.63),
)  # fmt: skip


def write_nrrd_volume(volume: SkinVolume, folder: Path) -> list[Path]:
    """Write ``layers.seg.nrrd`` (uint8, 0 = air), ``melanin.nrrd`` and an ``ink_<name>.nrrd`` for each ink; their paths.

    Melanin (melanosomes) and ink are float32 fractions of the volume.

    Voxels have the volume's finest height (`grid.even_labels`).

    Raises
    ------
    InputError : that many even voxels do not fit into memory.
    RunError : a file cannot be written.
    """
    labels = even_labels(volume)
    provenance = {"skinrender_provenance": json.dumps(volume.provenance, sort_keys=True)}
    layers = folder / "layers.seg.nrrd"
    write_nrrd(layers, volume.palette_layer[labels.entry], labels, _segments(volume, labels.entry.shape) | provenance)
    pigments = {"melanin": volume.palette_melanin}
    pigments |= {f"ink_{name}": volume.palette_ink[:, number] for number, name in enumerate(volume.ink_name)}
    for name, fraction in pigments.items():
        pairs = {"quantity": f"{name} fraction of the volume"} | provenance
        write_nrrd(folder / f"{name}.nrrd", fraction[labels.entry], labels, pairs)
    return [layers, *(folder / f"{name}.nrrd" for name in pigments)]


def write_nrrd(path: Path, values: np.ndarray, labels: Labels, pairs: Mapping[str, str]) -> None:
    """Write values (nx, ny, nz), u1 or f4, on the voxels of `labels`; `pairs` become ``key:=value`` lines."""
    center = labels.origin_mm + 0.5 * labels.spacing_mm
    axes = " ".join(_vector(row) for row in np.diag(labels.spacing_mm))
    header = [
        "NRRD0005",
        "# Complete NRRD file format specification at: http://teem.sourceforge.net/nrrd/format.html",
        f"type: {_TYPES[values.dtype.str[1:]]}",
        "dimension: 3",
        "space: left-posterior-superior",
        "sizes: {} {} {}".format(*values.shape),
        f"space directions: {axes}",
        "kinds: domain domain domain",
        "endian: little",
        "encoding: gzip",
        'space units: "mm" "mm" "mm"',
        f"space origin: {_vector(center)}",
        *(f"{key}:={_escaped(value)}" for key, value in pairs.items()),
    ]
    with whole_file(path) as partial, open(partial, "wb") as file:
        file.write(("\n".join(header) + "\n\n").encode())
        with gzip.GzipFile(filename="", mode="wb", compresslevel=4, fileobj=file, mtime=0) as packed:
            for plane in np.moveaxis(values, 2, 0):  # x is the fastest axis of the file
                packed.write(np.ascontiguousarray(plane.T, dtype=plane.dtype.newbyteorder("<")).data)


def read_nrrd_header(path: Path) -> dict[str, Any]:
    """What the header of a file of `write_nrrd` says: voxels, their spacing, labels, quantity, provenance.

    Raises
    ------
    InputError : damaged, or not an NRRD of this program.
    """
    try:
        with open(path, "rb") as file:
            lines = itertools.takewhile(lambda line: line.strip(), iter(lambda: file.readline(_LONGEST_LINE), b""))
            fields = dict(re.split(":=|: ", line.decode().rstrip("\n"), maxsplit=1) for line in lines if b":" in line)
        spacing = [float(vector.strip("()").split(",")[i]) for i, vector in enumerate(fields["space directions"].split(" "))]
        names = [fields[key] for key in fields if re.fullmatch(r"Segment\d+_Name", key)]
        return {
            "voxels": [int(count) for count in fields["sizes"].split()],
            "spacing_mm": spacing,
            "values": fields.get("quantity", f"labels, 1 to {len(names)}"),
            **({"labels": names} if names else {}),
            "provenance": json.loads(fields["skinrender_provenance"].replace("\\\\", "\\")),
        }
    except (KeyError, ValueError, IndexError) as error:
        raise InputError(f"not an NRRD of this program, or a damaged one ({error})", where=str(path)) from error


def _segments(volume: SkinVolume, shape: tuple[int, ...]) -> dict[str, str]:
    """The keys by which 3D Slicer names and colors the labels."""
    extent = " ".join(f"0 {count - 1}" for count in shape)
    pairs = {}
    for number, name in enumerate(volume.layer_name[1:]):
        color = _COLORS[number % len(_COLORS)]
        pairs |= {
            f"Segment{number}_ID": name,
            f"Segment{number}_Name": name,
            f"Segment{number}_NameAutoGenerated": "0",
            f"Segment{number}_Color": " ".join(f"{part:g}" for part in color),
            f"Segment{number}_LabelValue": str(number + 1),
            f"Segment{number}_Layer": "0",
            f"Segment{number}_Extent": extent,
        }
    return pairs | {
        "Segmentation_MasterRepresentation": "Binary labelmap",
        "Segmentation_ReferenceImageExtentOffset": "0 0 0",
    }


def _vector(values: np.ndarray) -> str:
    return "(" + ",".join(f"{value:.12g}" for value in values) + ")"


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace("\n", "\\n")
