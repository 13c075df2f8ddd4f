"""Pattern images: every kind of PNG gives the same darkness, or a clear refusal."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from skinrender.errors import InputError
from skinrender.skin.pattern import read_pattern

GRAY = np.array([[0, 255, 51], [255, 204, 102]], np.uint8)  # 2 rows, 3 columns
DARKNESS = 1 - GRAY.T / 255


def _save(tmp_path, image):
    image.save(tmp_path / "p.png")
    return tmp_path / "p.png"


@pytest.mark.parametrize("mode", ["L", "RGB", "RGBA", "LA", "P", "I;16"])
def test_kinds_of_png(tmp_path, mode):
    image = Image.fromarray(GRAY.astype(np.uint16) * 257) if mode == "I;16" else Image.fromarray(GRAY).convert(mode)
    p = read_pattern(_save(tmp_path, image), (3, 2), 0.5)
    assert p.shape == (3, 2) and np.allclose(p, 0.5 * DARKNESS, atol=1e-12)


def test_transparent_is_untouched(tmp_path):
    image = Image.fromarray(np.zeros((2, 3, 4), np.uint8), "RGBA")
    assert not read_pattern(_save(tmp_path, image), (3, 2), 1.0).any()


def test_many_gray_levels_are_rounded_to_255ths(tmp_path):
    gray = np.arange(4096, dtype=np.uint16).reshape(64, 64) * 16
    p = read_pattern(_save(tmp_path, Image.fromarray(gray)), (64, 64), 0.2)
    assert np.unique(p).size <= 256 and np.abs(p - 0.2 * (1 - gray.T / 65535)).max() <= 0.2 / 255 / 2 + 1e-9


def test_wrong_size_names_both_sizes_and_the_file(tmp_path):
    with pytest.raises(InputError, match=r"p\.png: the image has 3 x 2 pixels, the volume has 200 x 100 columns"):
        read_pattern(_save(tmp_path, Image.fromarray(GRAY)), (200, 100), 1.0)


def test_absent_foreign_and_cut_files(tmp_path):
    good = _save(tmp_path, Image.fromarray(GRAY))
    for name, content in (("j.png", b"hello"), ("empty.png", b""), ("cut.png", good.read_bytes()[:45])):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=name):
            read_pattern(tmp_path / name, (3, 2), 1.0)
    Image.fromarray(GRAY).save(tmp_path / "a.jpg")
    for name in ("none.png", "a.jpg"):
        with pytest.raises(InputError, match=name):
            read_pattern(tmp_path / name, (3, 2), 1.0)


def test_bomb_is_refused_by_its_header(tmp_path):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", 2**30, 2**30, 8, 0, 0, 0, 0)
    (tmp_path / "bomb.png").write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes(99))) + chunk(b"IEND", b"")
    )
    with pytest.raises(InputError, match=r"bomb\.png"):
        read_pattern(tmp_path / "bomb.png", (3, 2), 1.0)
