"""Damaging files: cut at any byte, with bits flipped at random places."""

from __future__ import annotations

import random
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from skinrender.errors import InputError


def damaged(whole: bytes, cuts: int, flips: int, seed: int) -> Iterator[tuple[str, bytes]]:
    """Versions of a file: cut at evenly spread bytes, and with one to four bits flipped."""
    chance = random.Random(seed)
    step = max(1, len(whole) // cuts)
    for length in {*range(0, len(whole), step), len(whole) - 1}:
        yield f"cut at {length}", whole[:length]
    for _ in range(flips):
        content, places = bytearray(whole), [chance.randrange(8 * len(whole)) for _ in range(chance.randint(1, 4))]
        for place in places:
            content[place >> 3] ^= 1 << (place & 7)
        yield f"bits {places} flipped", bytes(content)


def outcomes(
    path: Path, read: Callable[[Path], Any], same: Callable[[Any, Any], bool], versions: Iterator[tuple[str, bytes]]
) -> dict[str, int]:
    """How often a damaged version was refused, or read as if whole; anything else fails at once."""
    expected = read(path)
    hurt, count = path.parent / "hurt" / path.name, {"refused": 0, "read": 0}
    hurt.parent.mkdir(exist_ok=True)
    for told, content in versions:
        hurt.write_bytes(content)
        try:
            found = read(hurt)
        except InputError as error:
            assert str(hurt) in str(error), told
            count["refused"] += 1
        else:
            assert same(found, expected), f"{told}: silently wrong"
            count["read"] += 1
    shutil.rmtree(hurt.parent)
    return count
