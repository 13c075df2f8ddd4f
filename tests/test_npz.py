"""npz files: aligned, byte-identical, and refused when anything in them is wrong."""

from __future__ import annotations

import copy
import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from skinrender.errors import InputError, RunError
from skinrender.npz import Streamed, forget_pages, npz_bytes, read_npz, write_npz

MEMBERS = {
    "index": np.arange(60, dtype=np.uint16).reshape(3, 4, 5),
    "depth_mm": np.linspace(0, 1, 7),
    "provenance": np.array('{"seed": 1}'),
    "nothing": np.empty((0, 3), np.float32),
    "names": np.array(["air", "basal"]),
}


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "a.npz"
    write_npz(path, MEMBERS)
    return path


def _with_member(path, raw: bytes, name="a.npy", compression=zipfile.ZIP_STORED):
    with zipfile.ZipFile(path, "w", compression) as archive:
        archive.writestr(name, raw)
    return path


def _npy(header: str, data: bytes = b"") -> bytes:
    text = header.encode().ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + data


@pytest.mark.parametrize("mmap", [True, False])
def test_round_trip(file, mmap):
    read = read_npz(file, mmap=mmap)
    assert list(read) == list(MEMBERS)
    for name, array in MEMBERS.items():
        assert read[name].dtype == array.dtype and read[name].shape == array.shape
        assert np.array_equal(read[name], array) and not read[name].flags.writeable
    with np.load(file) as other:
        assert np.array_equal(other["index"], MEMBERS["index"])


def test_members_start_at_multiples_of_64_bytes(file):
    raw = file.read_bytes()
    for name in ("index", "depth_mm"):
        assert raw.index(MEMBERS[name].tobytes()) % 64 == 0


def test_big_members_are_mapped(tmp_path):
    write_npz(tmp_path / "b.npz", {"x": np.arange(1 << 16, dtype=np.float32)})
    x = read_npz(tmp_path / "b.npz")["x"]
    assert type(x) is np.ndarray and isinstance(x.base, np.memmap) and x.flags.aligned and not x.flags.writeable


def test_streamed_equals_whole(tmp_path):
    whole = np.arange(30, dtype=np.float32).reshape(10, 3)
    write_npz(tmp_path / "a.npz", {"x": whole})
    write_npz(tmp_path / "b.npz", {"x": Streamed("f4", (10, 3), (whole[i : i + 4] for i in range(0, 10, 4)))})
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


@pytest.mark.parametrize("pieces", [[np.zeros(3, "f4")], [np.zeros(5, "f4")], [np.zeros(4, "f8")]])
def test_streamed_must_fill_its_shape(tmp_path, pieces):
    with pytest.raises(ValueError, match="x: "):
        write_npz(tmp_path / "a.npz", {"x": Streamed("f4", (4,), pieces)})
    assert not list(tmp_path.iterdir())


def test_failed_write_keeps_the_older_file(file):
    before = file.read_bytes()
    with pytest.raises(ValueError):
        write_npz(file, {"x": np.zeros(2), "y": np.array([None])})
    assert file.read_bytes() == before and list(file.parent.iterdir()) == [file]


def test_unwritable_folder(tmp_path):
    with pytest.raises(RunError, match="cannot be written"):
        write_npz(tmp_path / "no" / "a.npz", {"x": np.zeros(2)})


def test_same_content_same_bytes(file, tmp_path):
    write_npz(tmp_path / "b.npz", MEMBERS)
    assert file.read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_truncated_anywhere(file, tmp_path):
    raw = file.read_bytes()
    for length in [*range(0, len(raw), 37), len(raw) - 1]:
        cut = tmp_path / "cut.npz"
        cut.write_bytes(raw[:length])
        with pytest.raises(InputError, match="cut.npz"):
            read_npz(cut)


def test_flipped_data_bit_is_seen(file):
    raw = bytearray(file.read_bytes())
    raw[raw.index(MEMBERS["depth_mm"].tobytes()) + 11] ^= 4
    file.write_bytes(raw)
    with pytest.raises(InputError, match="depth_mm does not match its checksum"):
        read_npz(file)
    assert "depth_mm" in read_npz(file, verify=False)


def test_random_damage_never_escapes_as_another_error(file, tmp_path):
    raw, rng = file.read_bytes(), np.random.default_rng(5)
    for _ in range(300):
        hurt = bytearray(raw)
        for at in rng.integers(0, len(raw), 3):
            hurt[at] = rng.integers(256)
        path = tmp_path / "hurt.npz"
        path.write_bytes(hurt)
        try:
            read = read_npz(path)
        except InputError:
            continue
        for name, array in read.items():
            if name in MEMBERS:
                assert np.array_equal(array, MEMBERS[name])


def test_not_a_zip_missing_folder(tmp_path):
    (tmp_path / "a.npz").write_bytes(b"hello" * 100)
    for path in (tmp_path / "a.npz", tmp_path / "none.npz", tmp_path):
        with pytest.raises(InputError, match=path.name):
            read_npz(path)


def test_pickles_and_compression_are_refused(tmp_path):
    np.savez(tmp_path / "p.npz", x=np.array([{}], object))
    np.savez_compressed(tmp_path / "c.npz", x=np.zeros(10**6))
    with pytest.raises(InputError, match="pickled"):
        read_npz(tmp_path / "p.npz")
    with pytest.raises(InputError, match="compressed"):
        read_npz(tmp_path / "c.npz")


@pytest.mark.parametrize(
    "header",
    [
        "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,)}",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (-1, -1)}",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (10000000000000000000000000000000, 0)}",
        "{'descr': '>f8', 'fortran_order': False, 'shape': (1,)}",
        "{'descr': '|O', 'fortran_order': False, 'shape': (1,)}",
        "{'descr': [('a', '<f4'), ('b', '<f4')], 'fortran_order': False, 'shape': (1,)}",
        "{'descr': '<f8', 'shape': (1,)}",
        "{'descr': 'nonsense', 'fortran_order': False, 'shape': (1,)}",
        "((((((((((",
        "__import__('os')",
    ],
)
def test_absurd_headers(tmp_path, header):
    path = _with_member(tmp_path / "a.npz", _npy(header, b"" if ", 0)" in header else bytes(8)))
    with pytest.raises(InputError, match="a.npz"):
        read_npz(path)


def test_member_that_is_no_array(tmp_path):
    with pytest.raises(InputError, match="readme.txt"):
        read_npz(_with_member(tmp_path / "a.npz", b"hello", "readme.txt"))


def test_overlapping_members_are_refused(tmp_path):
    """The trick of zip bombs: many entries of the directory that share one stretch of the file."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("a.npy", _npy("{'descr': '|u1', 'fortran_order': False, 'shape': (8,)}", bytes(8)))
        twin = copy.copy(archive.infolist()[0])
        archive.filelist.append(twin)
    (tmp_path / "a.npz").write_bytes(buffer.getvalue())
    with pytest.raises(InputError, match="one name|overlap"):
        read_npz(tmp_path / "a.npz")


@pytest.mark.parametrize("count", [0, 1, 1000, 123_457])
def test_size_is_known_before_the_file_is_written(tmp_path, count):
    members = {
        "a": np.arange(count),
        "größe": np.array("x" * count),
        "s": Streamed("f4", (count, 3), [np.zeros((count, 3), "f4")]),
    }
    predicted = npz_bytes({**members, "s": Streamed("f4", (count, 3), ())})
    write_npz(tmp_path / "file.npz", members)
    assert (tmp_path / "file.npz").stat().st_size == predicted


def test_forgotten_pages_are_given_back_and_read_again(tmp_path):
    path, values = tmp_path / "a.npz", np.arange(1 << 22, dtype=np.float32)
    write_npz(path, {"a": values})
    array = read_npz(path)["a"]

    def resident_file_bytes() -> int:
        [line] = [line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("RssFile:")]
        return 1024 * int(line.split()[1])

    total = array.sum(dtype=np.float64)
    held = resident_file_bytes()
    forget_pages(array[5:])
    assert held - resident_file_bytes() > 0.9 * array.nbytes
    assert array.sum(dtype=np.float64) == total
    forget_pages(values)
