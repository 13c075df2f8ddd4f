"""NRRD volumes, read by a parser of the header here and by pynrrd and SimpleITK where they are installed."""

from __future__ import annotations

import gzip
from dataclasses import replace

import numpy as np
import pytest

from skinrender.export.nrrd import write_nrrd_volume
from tests.volumes import Layer, slab_volume

VOLUME = slab_volume((Layer(0.1, 2, 20), Layer(0.3, 1, 10)), size=(1.0, 3.0), columns=(2, 3))


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    index = VOLUME.palette_index
    index[1, 2, 0] = 2  # one odd voxel, which shows the order of axes
    return write_nrrd_volume(VOLUME, tmp_path_factory.mktemp("nrrd"))


def expected() -> np.ndarray:
    labels = np.broadcast_to(np.array([1, 2, 2, 2], np.uint8), (2, 3, 4)).copy()
    labels[1, 2, 0] = 2
    return labels


def test_header_and_order_of_axes(files):
    header, _, data = files[0].read_bytes().partition(b"\n\n")
    lines = header.decode().splitlines()
    assert lines[0] == "NRRD0005"
    fields = dict(line.split(": ", 1) for line in lines if ": " in line and ":=" not in line and line[0] != "#")
    assert fields["sizes"] == "2 3 4"
    assert fields["space directions"] == "(0.5,0,0) (0,1,0) (0,0,0.1)"
    assert fields["space origin"] == "(0.25,0.5,0.05)"
    values = np.frombuffer(gzip.decompress(data), np.uint8).reshape((2, 3, 4), order="F")
    assert np.array_equal(values, expected())


def test_each_ink_has_its_file(tmp_path):
    inked = replace(VOLUME, palette_ink=np.array([[0.0], [0.25], [0.5]], np.float32), ink_name=("carbon",))
    files = write_nrrd_volume(inked, tmp_path)
    assert [path.name for path in files] == ["layers.seg.nrrd", "melanin.nrrd", "ink_carbon.nrrd"]
    values = np.frombuffer(gzip.decompress(files[2].read_bytes().partition(b"\n\n")[2]), "<f4")
    assert values.sum() == pytest.approx(0.25 * np.sum(expected() == 1) + 0.5 * np.sum(expected() == 2))


def test_same_volume_gives_the_same_bytes(files, tmp_path):
    again = write_nrrd_volume(VOLUME, tmp_path)
    assert [path.read_bytes() for path in again] == [path.read_bytes() for path in files]


def test_pynrrd_reads_labels_and_names(files):
    nrrd = pytest.importorskip("nrrd", reason="pynrrd is not installed (extra interop)")
    labels, header = nrrd.read(str(files[0]))
    assert np.array_equal(labels, expected())
    assert [header[f"Segment{k}_Name"] for k in (0, 1)] == ["layer_1", "layer_2"]
    assert [header[f"Segment{k}_LabelValue"] for k in (0, 1)] == ["1", "2"]
    melanin, _ = nrrd.read(str(files[1]))
    assert melanin.dtype == np.float32
    assert melanin.shape == labels.shape


def test_itk_reads_places_in_mm(files):
    itk = pytest.importorskip("SimpleITK", reason="SimpleITK is not installed (extra interop)")
    image = itk.ReadImage(str(files[0]))
    assert image.GetSpacing() == pytest.approx((0.5, 1.0, 0.1))
    assert image.GetOrigin() == pytest.approx((0.25, 0.5, 0.05))
    assert image[1, 2, 0] == 2
