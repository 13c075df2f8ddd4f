"""What this machine can do at best: the bare walk, its disk, its memory."""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.floor import Floor

PIECE = 64 << 20
COPIED = 256 << 20
RUNS = 5


@dataclass(frozen=True)
class Limits:
    """Rates of all cores together, bytes/s, and ns per scattering event of the bare walk on one core."""

    cores: int
    walk_ns: float
    disk_write: float
    disk_read: float
    memory: float


def measure_limits(folder: Path, disk_bytes: int) -> Limits:
    """Measure them; `disk_bytes` are written to a temporary file in `folder` and read back."""
    floor = Floor()
    write, read = disk_rates(folder, disk_bytes)
    cores = len(os.sched_getaffinity(0))
    return Limits(cores, statistics.median(floor.measure() for _ in range(RUNS)), write, read, memory_rate(cores))


def disk_rates(folder: Path, size: int) -> tuple[float, float]:
    """Bytes per second written until they are on the disk, and read back with nothing of them in memory."""
    piece = np.random.default_rng(0).integers(0, 256, PIECE, np.uint8)
    pieces = max(1, size // PIECE)
    with tempfile.NamedTemporaryFile(dir=folder, prefix="disk-") as file:
        began = time.perf_counter()
        for _ in range(pieces):
            file.write(piece)
        file.flush()
        os.fsync(file.fileno())
        written = time.perf_counter() - began
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
        file.seek(0)
        began = time.perf_counter()
        while file.readinto(piece):
            pass
        read = time.perf_counter() - began
    return pieces * PIECE / written, pieces * PIECE / read


def memory_rate(threads: int) -> float:
    """Bytes per second that all threads together copy, read and written bytes counted both; the best of some runs."""
    arrays = [(np.ones(COPIED, np.uint8), np.zeros(COPIED, np.uint8)) for _ in range(threads)]
    with ThreadPoolExecutor(threads) as pool:
        seconds = []
        for _ in range(RUNS):
            began = time.perf_counter()
            list(pool.map(lambda pair: np.copyto(pair[1], pair[0]), arrays))
            seconds.append(time.perf_counter() - began)
    return 2 * threads * COPIED / min(seconds)
