"""Truth files of layered slabs: what they hold, checked while it is read.

Units: mm, 1/mm; all values are per unit of incident flux or irradiance.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from skinrender.errors import InputError
from skinrender.files import refuse_special

LAYERED, FIELD, RADIAL = "layered-slab-truth/1", "slab-field-truth/1", "slab-radial-truth/1"
SCHEMAS = (LAYERED, FIELD, RADIAL)
THINNEST_MM = 1e-9
"""Depths of borders are rounded to 1e-12 mm."""
_REMEDY = "write a finite number there"


@dataclass(frozen=True)
class Layer:
    """One layer: thickness (mm), coefficients (1/mm), mean cosine and refractive index."""

    thickness_mm: float
    mu_a: float
    mu_s: float
    g: float
    n: float

    @property
    def mu_t(self) -> float:
        return self.mu_a + self.mu_s


@dataclass(frozen=True)
class Stack:
    """Layers from the lit side down, the indices around them, and the incidence: normal or diffuse."""

    layers: tuple[Layer, ...]
    n_above: float
    n_below: float
    incidence: str

    @property
    def depth_mm(self) -> tuple[float, ...]:
        """Depths of the borders from the surface to the bottom."""
        depths = [0.0]
        for layer in self.layers:
            depths.append(depths[-1] + layer.thickness_mm)
        return tuple(depths)


@dataclass(frozen=True, eq=False)
class TruthRecord:
    """A record of a truth file, or a section of one; every value asked for is checked.

    Parameters
    ----------
    values : the JSON object.
    where : its place, for messages.
    """

    values: Mapping[str, Any]
    where: str

    def wrong(self, key: str, told: str, remedy: str = _REMEDY) -> InputError:
        """The error to raise about the value of a key."""
        return InputError(f"{key} {told}", where=self.where, remedy=remedy)

    def get(self, key: str, kind: type, expected: str) -> Any:
        """The value of a key that must be there and be of a type."""
        if key not in self.values:
            raise self.wrong(key, "is missing", f"add {key}: {expected}")
        value = self.values[key]
        if not isinstance(value, kind):
            raise self.wrong(key, f"is {_told(value)}", f"expected {expected}")
        return value

    def number(self, key: str, low: float = -math.inf, high: float = math.inf) -> float:
        """A finite number within [low, high]."""
        return self._number(key, self.values.get(key), low, high)

    def numbers(
        self, key: str, count: int | None = None, low: float = -math.inf, high: float = math.inf
    ) -> list[float]:
        """A list of finite numbers, of a given length if there is one."""
        values = self.get(key, list, "a list of numbers")
        if count is not None and len(values) != count:
            raise self.wrong(key, f"has {len(values)} values", f"write {count} of them")
        return [self._number(f"{key}[{i}]", value, low, high) for i, value in enumerate(values)]

    def rows(self, key: str, columns: int) -> list[list[Any]]:
        """A list of rows of equal length."""
        rows = self.get(key, list, "a list of rows")
        for i, row in enumerate(rows):
            if not isinstance(row, list) or len(row) != columns:
                raise self.wrong(f"{key}[{i}]", "is not a row", f"write {columns} values in brackets")
        return rows

    def number_rows(self, key: str, columns: int) -> list[list[float]]:
        """A list of rows of finite numbers."""
        rows = self.rows(key, columns)
        return [
            [self._number(f"{key}[{i}][{k}]", value, -math.inf, math.inf) for k, value in enumerate(row)]
            for i, row in enumerate(rows)
        ]

    def section(self, key: str) -> TruthRecord:
        """An object within the record."""
        return TruthRecord(self.get(key, dict, "an object"), f"{self.where}: {key}")

    def accuracy(self, key: str) -> float:
        """A number of the section ``accuracy``; 0 where it has none."""
        section = self.values.get("accuracy")
        if not isinstance(section, dict) or key not in section:
            return 0.0
        return self._number(f"accuracy.{key}", section[key], 0.0, math.inf)

    def _number(self, key: str, value: Any, low: float, high: float) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise self.wrong(key, "is missing" if value is None else f"is {_told(value)}")
        if not low <= value <= high:
            raise self.wrong(key, f"is {value:g}", f"expected a number from {low:g} to {high:g}")
        return float(value)


@dataclass(frozen=True, eq=False)
class SlabRecord(TruthRecord):
    """A record with its name and its stack."""

    id: str
    stack: Stack


@dataclass(frozen=True, eq=False)
class TruthFile:
    """The records of a file of one of the `SCHEMAS`."""

    schema: str
    records: tuple[SlabRecord, ...]


def read_truth(path: str | Path, only: str | None = None) -> TruthFile:
    """Read a truth file.

    Parameters
    ----------
    path : JSON with ``schema`` and ``records``.
    only : keep the records whose id matches this pattern (``*`` and ``?`` as in file names) or begins with it.

    Raises
    ------
    InputError : the file is absent, no JSON, of no known schema, or a record lacks something; or no id matches.
    """
    content = _load(Path(path))
    head = TruthRecord(content, str(path))
    schema = head.get("schema", str, f"one of {', '.join(SCHEMAS)}")
    if schema not in SCHEMAS:
        raise head.wrong("schema", f"is {schema!r}", f"expected one of {', '.join(SCHEMAS)}")
    records = [_record(values, i, path) for i, values in enumerate(head.get("records", list, "a list of records"))]
    ids = [record.id for record in records]
    if len(set(ids)) < len(ids):
        twice = next(name for name in ids if ids.count(name) > 1)
        raise head.wrong("records", f"hold the id {twice!r} twice", "give each record an id of its own")
    kept = [record for record in records if only is None or fnmatchcase(record.id, only) or record.id.startswith(only)]
    if not kept:
        told = f"no record matches {only!r}" if ids else "there are no records"
        raise InputError(told, where=str(path), remedy=f"records: {', '.join(ids)}" if ids else "add some")
    return TruthFile(schema, tuple(kept))


def _load(path: Path) -> dict[str, Any]:
    refuse_special(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError("there is no such file", where=str(path), remedy="name a file of slab truths") from None
    except (IsADirectoryError, UnicodeDecodeError):
        raise InputError("is not a text file", where=str(path), remedy="name a file of slab truths") from None
    except json.JSONDecodeError as error:
        place = f"{path}:{error.lineno}:{error.colno}"
        raise InputError(f"is not JSON: {error.msg}", where=place, remedy="mend the file") from None
    except RecursionError:
        raise InputError("is nested too deeply", where=str(path), remedy="name a file of slab truths") from None
    if not isinstance(content, dict):
        raise InputError("is not a JSON object", where=str(path), remedy='write {"schema": …, "records": […]}')
    return content


def _record(values: Any, index: int, path: str | Path) -> SlabRecord:
    where = f"{path}: record {index}"
    if not isinstance(values, dict):
        raise InputError(f"is {_told(values)}", where=where, remedy="write an object")
    unnamed = TruthRecord(values, where)
    name = unnamed.get("id", str, "the record's name")
    record = TruthRecord(values, f"{path}: record {name!r}")
    incidence = record.get("incidence", str, "normal or diffuse")
    if incidence not in ("normal", "diffuse"):
        raise record.wrong("incidence", f"is {incidence!r}", "expected normal or diffuse")
    layers = record.get("layers", list, "the layers from the lit side down")
    if not layers:
        raise record.wrong("layers", "is empty", "write at least one layer")
    stack = Stack(
        tuple(_layer(layer, f"{record.where}: layers[{i}]") for i, layer in enumerate(layers)),
        record.number("n_above", low=1.0),
        record.number("n_below", low=1.0),
        incidence,
    )
    return SlabRecord(values, record.where, name, stack)


def _layer(values: Any, where: str) -> Layer:
    if not isinstance(values, dict):
        raise InputError(f"is {_told(values)}", where=where, remedy="write an object")
    layer = TruthRecord(values, where)
    described = Layer(
        layer.number("thickness_mm", low=THINNEST_MM),
        layer.number("mu_a", low=0.0),
        layer.number("mu_s", low=0.0),
        layer.number("g", -1.0, 1.0),
        layer.number("n", low=1.0),
    )
    if abs(described.g) == 1.0:
        raise layer.wrong("g", f"is {described.g:g}", "expected a number between -1 and 1")
    return described


def _told(value: Any) -> str:
    names: Sequence[tuple[type, str]] = ((dict, "an object"), (list, "a list"))
    text = next((name for kind, name in names if isinstance(value, kind)), None)
    return text or (repr(value) if len(repr(value)) <= 40 else repr(value)[:37] + "...")
