"""Uncompressed npz files whose members can be memory-mapped, written whole or not at all.

A file is an ordinary zip of ``.npy`` members (``numpy.load`` reads it). Each member's data starts at a multiple of 64
bytes: its local header is padded by an extra field, as zipalign does. Time stamps are fixed, so equal content gives
equal bytes. Reading trusts nothing: no pickles, no compression, every size checked against the file before it is used.
"""

from __future__ import annotations

import io
import itertools
import math
import mmap as memory_map
import os
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.lib import format as npy

from skinrender.atomic import whole_file
from skinrender.errors import InputError

ALIGNMENT = 64
PADDING_ID = 0xD935
"""Extra-field id that zip tools read as padding for alignment."""
VERIFY_BELOW = 64 << 20
"""Files smaller than this are checked by their CRC whenever they are read (bytes)."""
_MMAP_FROM = 1 << 16
_CHUNK = 16 << 20
_ZIP64_EXTRA = 20
_LOCAL_HEADER = struct.Struct("<4s5H3I2H")
_MAX_NPY_HEADER = 10_000
_MALFORMED = (
    zipfile.BadZipFile, NotImplementedError, EOFError, struct.error, ArithmeticError, LookupError,
    ValueError, TypeError, SyntaxError, RecursionError, MemoryError, tokenize.TokenError,
)  # fmt: skip
"""What zipfile and numpy raise when a header is nonsense."""


@dataclass(frozen=True)
class Streamed:
    """A member that is written piece by piece.

    Parameters
    ----------
    dtype, shape : of the whole array.
    chunks : arrays of that dtype which, laid end to end in C order, are the whole.
    """

    dtype: np.dtype | type | str
    shape: tuple[int, ...]
    chunks: Iterable[np.ndarray]


@dataclass(frozen=True)
class _Member:
    """Where one array lies in the file."""

    name: str
    start: int
    data: int
    end: int
    crc: int
    dtype: np.dtype
    shape: tuple[int, ...]
    order: str


def write_npz(path: str | os.PathLike, members: Mapping[str, np.ndarray | Streamed]) -> None:
    """Write arrays to an npz file; an older file stays untouched until the new one is complete on disk.

    Parameters
    ----------
    path : file to write; its folder must exist.
    members : name -> array (anything ``numpy.asarray`` takes) or :class:`Streamed`.

    Raises
    ------
    RunError : the file cannot be written (full disk, read-only folder).
    """
    with whole_file(path) as partial, zipfile.ZipFile(partial, "w", zipfile.ZIP_STORED) as archive:
        for name, value in members.items():
            _write_member(archive, name, value)


def read_npz(path: str | os.PathLike, mmap: bool = True, verify: bool | None = None) -> dict[str, np.ndarray]:
    """Read an npz file as read-only arrays.

    Parameters
    ----------
    path : file to read.
    mmap : map members of 64 KiB and more instead of reading them.
    verify : check every member's CRC first; by default when the file is smaller than 64 MiB.

    Raises
    ------
    InputError : there is no such file, or it is truncated, corrupt, compressed, or holds anything but plain arrays.
    """
    path = Path(path)
    members = _members(path)
    if verify if verify is not None else path.stat().st_size < VERIFY_BELOW:
        _verify(path, members)
    try:
        return {m.name: _load(path, m, mmap) for m in members}
    except (OSError, ValueError, OverflowError) as error:
        raise _damaged(path, str(error)) from error


def forget_pages(array: np.ndarray) -> None:
    """Let go of the memory that a mapped array has been read into; what is needed again is read again.

    The system would keep it, for as long as there is room, on this process's account.
    """
    mapped = array
    while isinstance(mapped, np.ndarray) and not isinstance(mapped, np.memmap):
        mapped = mapped.base
    if isinstance(mapped, np.memmap) and hasattr(memory_map, "MADV_DONTNEED"):
        mapped._mmap.madvise(memory_map.MADV_DONTNEED)


def npz_bytes(members: Mapping[str, np.ndarray | Streamed]) -> int:
    """Size of the file that `write_npz` makes of these members, without reading any of their data.

    Exact as long as nothing in it is larger than 4 GiB; then some dozens of bytes are left out.
    """
    position, directory = 0, zipfile.sizeEndCentDir
    for name, value in members.items():
        dtype, shape, _ = _layout(value)
        info = _member_info(name, position)
        header = io.BytesIO()
        _write_header(header, dtype, shape)
        name_and_extra = len(info.filename.encode()) + len(info.extra)
        directory += zipfile.sizeCentralDir + name_and_extra
        position += _LOCAL_HEADER.size + name_and_extra + _ZIP64_EXTRA
        position += header.tell() + math.prod(shape) * dtype.itemsize
    return position + directory


def _layout(value: np.ndarray | Streamed) -> tuple[np.dtype, tuple[int, ...], Iterable[np.ndarray]]:
    """Type, shape and pieces of a member."""
    if isinstance(value, Streamed):
        return np.dtype(value.dtype), tuple(value.shape), value.chunks
    array = np.asarray(value, order="C")
    return array.dtype, array.shape, (array,)


def _member_info(name: str, position: int) -> zipfile.ZipInfo:
    """Entry of a member whose local header begins at `position`, padded so that its data is aligned."""
    info = zipfile.ZipInfo(f"{name}.npy", date_time=(1980, 1, 1, 0, 0, 0))
    info.create_system = 3
    info.external_attr = 0o644 << 16
    data_start = position + _LOCAL_HEADER.size + len(info.filename.encode()) + 4 + _ZIP64_EXTRA
    padding = -data_start % ALIGNMENT
    info.extra = struct.pack("<HH", PADDING_ID, padding) + bytes(padding)
    return info


def _write_header(stream, dtype: np.dtype, shape: tuple[int, ...]) -> None:
    npy.write_array_header_1_0(stream, {"descr": npy.dtype_to_descr(dtype), "fortran_order": False, "shape": shape})


def _write_member(archive: zipfile.ZipFile, name: str, value: np.ndarray | Streamed) -> None:
    dtype, shape, chunks = _layout(value)
    if dtype.hasobject:
        raise ValueError(f"{name}: arrays of objects are not stored")
    written = 0
    with archive.open(_member_info(name, archive.fp.tell()), "w", force_zip64=True) as stream:
        _write_header(stream, dtype, shape)
        for chunk in chunks:
            written += _write_chunk(stream, name, np.asarray(chunk, order="C"), dtype)
    if written != math.prod(shape) * dtype.itemsize:
        raise ValueError(f"{name}: {written} bytes do not fill an array of shape {shape} and type {dtype}")


def _write_chunk(stream, name: str, chunk: np.ndarray, dtype: np.dtype) -> int:
    if chunk.dtype != dtype:
        raise ValueError(f"{name}: a piece of type {chunk.dtype} where {dtype} was promised")
    if not chunk.nbytes:
        return 0
    data = chunk.reshape(-1).view(np.uint8)
    for start in range(0, data.size, _CHUNK):
        stream.write(data[start : start + _CHUNK])
    return data.size


def _damaged(path: Path, what: str) -> InputError:
    return InputError(
        f"not a readable file of this program ({what})",
        where=str(path),
        remedy="Make it again with the command that wrote it; it may be truncated, damaged or of another program.",
    )


def _members(path: Path) -> list[_Member]:
    """Find and check every member without reading its data."""
    try:
        with open(path, "rb") as file, zipfile.ZipFile(file) as archive:
            size = os.fstat(file.fileno()).st_size
            members = [_member(path, file, size, info) for info in archive.infolist()]
    except FileNotFoundError as error:
        raise InputError("there is no such file", where=str(path), remedy="Make it first, or name another.") from error
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror or error})", where=str(path)) from error
    except _MALFORMED as error:
        raise _damaged(path, str(error)) from error
    if len({m.name for m in members}) != len(members):
        raise _damaged(path, "two members have one name")
    ordered = sorted(members, key=lambda m: m.start)
    if any(a.end > b.start for a, b in itertools.pairwise(ordered)):
        raise _damaged(path, "members overlap")
    return members


def _member(path: Path, file, size: int, info: zipfile.ZipInfo) -> _Member:
    if not info.filename.endswith(".npy"):
        raise _damaged(path, f"{info.filename!r} is not an array")
    if info.compress_type != zipfile.ZIP_STORED or info.file_size != info.compress_size or info.flag_bits & 1:
        raise _damaged(path, f"{info.filename} is compressed or encrypted")
    file.seek(info.header_offset)
    header = file.read(_LOCAL_HEADER.size)
    if len(header) < _LOCAL_HEADER.size or header[:4] != b"PK\3\4":
        raise _damaged(path, f"no local header of {info.filename}")
    name_length, extra_length = _LOCAL_HEADER.unpack(header)[-2:]
    if file.read(name_length) != info.orig_filename.encode():
        raise _damaged(path, f"the local header of {info.filename} names another member")
    start = info.header_offset + _LOCAL_HEADER.size + name_length + extra_length
    end = start + info.file_size
    if end > size:
        raise _damaged(path, f"{info.filename} reaches beyond the end of the file")
    file.seek(start)
    shape, fortran, dtype = _npy_header(path, file, info.filename)
    data = file.tell()
    if min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != end - data:
        raise _damaged(path, f"{info.filename}: shape {shape} of {dtype} does not match its size")
    return _Member(info.filename[:-4], start, data, end, info.CRC, dtype, shape, "F" if fortran else "C")


def _npy_header(path: Path, file, name: str) -> tuple[tuple[int, ...], bool, np.dtype]:
    version = npy.read_magic(file)
    readers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    if version not in readers:
        raise _damaged(path, f"{name}: npy version {version}")
    shape, fortran, dtype = readers[version](file, max_header_size=_MAX_NPY_HEADER)
    if dtype.hasobject:
        raise _damaged(path, f"{name} holds pickled objects, which are never loaded")
    if dtype.kind not in "biufUS" or not dtype.isnative:
        raise _damaged(path, f"{name}: type {dtype} is not a plain native number or text")
    return shape, fortran, dtype


def _load(path: Path, member: _Member, mmap: bool) -> np.ndarray:
    size = member.end - member.data
    if mmap and size >= _MMAP_FROM and member.data % member.dtype.itemsize == 0:
        mapped = np.memmap(path, member.dtype, "r", member.data, member.shape, member.order)
        return np.asarray(mapped)
    if not size:
        array = np.empty(member.shape, member.dtype)
    else:
        with open(path, "rb") as file:
            file.seek(member.data)
            flat = np.fromfile(file, member.dtype, math.prod(member.shape))
        array = flat.reshape(member.shape, order=member.order)
    array.setflags(write=False)
    return array


def _verify(path: Path, members: list[_Member]) -> None:
    with open(path, "rb") as file:
        for member in members:
            file.seek(member.start)
            crc, left = 0, member.end - member.start
            while left:
                chunk = file.read(min(left, _CHUNK))
                if not chunk:
                    raise _damaged(path, f"{member.name} is cut off")
                crc = zlib.crc32(chunk, crc)
                left -= len(chunk)
            if crc != member.crc:
                raise _damaged(path, f"{member.name} does not match its checksum")
