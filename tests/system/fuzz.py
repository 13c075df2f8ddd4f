"""Inputs made up at random: scene text, npz bytes, pattern images. Each is read or refused with an `InputError`, soon.

``python -m tests.system.fuzz --seconds 60`` tries each kind for so long and prints how many there were.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import struct
import sys
import tempfile
import time
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from PIL import Image

from skinrender.errors import InputError
from skinrender.npz import read_npz
from skinrender.scene import load_scene
from skinrender.skin.gray import read_gray

SCENE = """\
patch: {size_mm: [4, 2], columns: [8, 4]}
bands_nm: [450, 550]
skin: {site: forearm, layers: {basal: {melanosome: 0.1}}}
relief: {kind: procedural, noise_um: 2}
light: {kind: point, height_mm: 50}
camera: {kind: perspective, distance_mm: 100, pixels: [4, 4]}
photons: {stored: 1e4}
estimate: {method: beam}
"""
SLOWEST_S = 5.0

_scalars = st.one_of(
    st.none(), st.booleans(), st.integers(-(10**30), 10**30), st.floats(), st.text(max_size=8),
    st.sampled_from(["1e400", "-.inf", ".nan", "!!python/name:os.system x", "*a", "&a [*a]", "{", "]", "? [1]", "---"]),
)  # fmt: skip
_words = st.sampled_from(sorted({word for line in SCENE.split() for word in line.strip("{}[]:,").split(":") if word}))
_trees = st.recursive(
    st.one_of(_scalars, _words),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.one_of(_words, st.text(max_size=4)), inner, max_size=4),
    max_leaves=12,
)


def _flow(value: object) -> str:
    """A value in YAML's flow style, scalars as they are."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_flow, value)) + "]"
    return "null" if value is None else str(value)


@st.composite
def scenes(draw) -> bytes:
    """A sound scene with lines replaced, cut, repeated, or bytes changed; sometimes nothing but bytes."""
    if draw(st.integers(0, 9)) == 0:
        return draw(st.binary(max_size=300))
    lines = SCENE.splitlines()
    for _ in range(draw(st.integers(0, 3))):
        at = draw(st.integers(0, len(lines) - 1))
        key = lines[at].partition(":")[0]
        lines[at] = draw(st.sampled_from([lines[at - 1], "", f"{key}: {_flow(draw(_trees))}", draw(st.text(max_size=40))]))
    text = "\n".join(lines).encode("utf-8", "surrogatepass")
    return _mutated(draw, text)


def _mutated(draw, content: bytes) -> bytes:
    """In every second case some bytes changed, and perhaps some cut off."""
    if draw(st.booleans()):
        return content
    changed = bytearray(content)
    for at, value in draw(st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), max_size=4)):
        if changed:
            changed[at % len(changed)] = value
    keep = draw(st.integers(0, 3 * len(changed)))
    return bytes(changed[:keep])


def _npy(header: bytes, data: bytes) -> bytes:
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + data


@st.composite
def archives(draw) -> bytes:
    """A zip of members that are arrays, nearly arrays, pickles or bombs."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for index in range(draw(st.integers(0, 3))):
            kind = draw(st.sampled_from(["array", "array", "array", "header", "object", "bomb", "bytes"]))
            name = draw(st.sampled_from([f"m{index}.npy", f"m{index}.npy", "m0.npy", "../x.npy", "a/b.npy", "x.txt", "\u00e9.npy"]))
            shape = draw(st.lists(st.integers(-1, 2**65), max_size=3))
            described = {"descr": draw(st.sampled_from(["<f4", "|O", ">u2", "<U3", "|V8", "<M8[s]", "x"])), "shape": tuple(shape)}
            content = {
                "header": _npy(repr(described | {"fortran_order": False}).encode() + b"\n", b"\0" * 8),
                "bytes": draw(st.binary(max_size=40)),
            }.get(kind)
            if content is None:
                stream = io.BytesIO()
                array = {"array": np.arange(6.0), "bomb": np.zeros(10**5), "object": np.array([{}], object)}[kind]
                np.lib.format.write_array(stream, array, allow_pickle=True)
                content = stream.getvalue()
            with contextlib.suppress(ValueError):
                archive.writestr(name, content, zipfile.ZIP_DEFLATED if kind == "bomb" else zipfile.ZIP_STORED)
    return _mutated(draw, buffer.getvalue())


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


@st.composite
def images(draw) -> bytes:
    """PNGs with odd headers and chunks whose checksums fit, and other formats; then mutated."""
    if draw(st.booleans()):
        buffer = io.BytesIO()
        mode = draw(st.sampled_from(["L", "RGB", "RGBA", "P", "1", "I;16"]))
        Image.new(mode, (draw(st.integers(1, 9)), draw(st.integers(1, 9)))).save(
            buffer, draw(st.sampled_from(["PNG", "TIFF"]))
        )
        return _mutated(draw, buffer.getvalue())
    sizes = st.sampled_from([0, 1, 3, 2**16, 2**31 - 1, 2**32 - 1])
    kinds = st.sampled_from([0, 1, 2, 3, 4, 6, 8, 16, 255])
    header = struct.pack(">IIBBBBB", draw(sizes), draw(sizes), draw(kinds), draw(kinds), 0, 0, draw(st.integers(0, 2)))
    names = st.sampled_from([b"IDAT", b"PLTE", b"tRNS", b"iTXt", b"zTXt", b"iCCP", b"acTL", b"fdAT", b"gAMA", b"IHDR"])
    bodies = st.one_of(st.binary(max_size=30), st.just(zlib.compress(bytes(10**6))), st.just(b"x\0\0" + zlib.compress(bytes(10**7))))
    chunks = [_chunk(name, body) for name, body in draw(st.lists(st.tuples(names, bodies), max_size=4))]
    return _mutated(draw, b"\x89PNG\r\n\x1a\n" + _chunk(b"IHDR", header) + b"".join(chunks) + _chunk(b"IEND", b""))


READERS: dict[str, tuple[st.SearchStrategy[bytes], Callable[[Path], object]]] = {
    "scene.yaml": (scenes(), load_scene),
    "map.npz": (archives(), read_npz),
    "pattern.png": (images(), lambda path: read_gray(path, ("PNG", "TIFF"))),
}


def fuzz(name: str, folder: Path, examples: int, chance: int = 1) -> Counter:
    """Read so many made-up inputs of a kind, drawn by the seed `chance`; how many were read and refused."""
    strategy, read = READERS[name]
    path, count = folder / name, Counter()

    @seed(chance)
    @settings(
        max_examples=examples, deadline=None, database=None, suppress_health_check=list(HealthCheck),
        phases=[Phase.generate],
    )  # fmt: skip
    @given(strategy)
    def one(content: bytes) -> None:
        path.write_bytes(content)
        began = time.monotonic()
        try:
            read(path)
            count["read"] += 1
        except InputError as error:
            assert str(error)
            count["refused"] += 1
        assert time.monotonic() - began < SLOWEST_S, "slow"

    one()
    return count


def report() -> int:
    """Fuzz every kind of input as the command line asks."""
    parser = argparse.ArgumentParser(description="Read inputs made up at random.")
    parser.add_argument("--seconds", type=float, default=60.0, help="for each kind")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for name in READERS:
            count, until, chance = Counter(), time.monotonic() + options.seconds, 1
            while time.monotonic() < until:
                chance += 1
                count += fuzz(name, Path(folder), 300, chance)
            print(f"{name:>12}  {count['read']} read, {count['refused']} refused", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(report())
