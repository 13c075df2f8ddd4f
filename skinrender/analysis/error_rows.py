"""error_vs_time.csv: tidy data, one row a run, appended as the runs end."""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Iterable
from dataclasses import astuple, dataclass, fields
from pathlib import Path

from skinrender.atomic import whole_file
from skinrender.errors import InputError, RunError

STAGES = ("load", "trace", "estimate", "write", "total")


@dataclass(frozen=True)
class ErrorRow:
    """One run: what was run, how long each stage took, how far its picture is from the reference; nan = undefined.

    Parameters
    ----------
    scene : label, for people.
    scene_hash, method, photons, seed, program : the key; `program` fingerprints sources, machine and workers.
    gather_count : photons that a beam or sample point meets; 0: as many as the tissue allows.
    photons_stored, photons_emitted : as they came out.
    reference : which reference the errors are against.
    load_s ... total_s : seconds.
    rmse : root of the mean (A - B)^2 of luminance; relmse : mean (A - B)^2 / B^2; the reference's variance is subtracted
        from both (`error_stats`); relmse_uncorrected : as `compare` tells it.
    relmse_stderr : from the spread over parts of the picture.
    bias, bias_stderr : mean A / mean B - 1.
    delta_e_mean, delta_e_p95 : CIEDE2000. ssim : structural similarity. All three see the reference's noise too.
    stderr_relative_mean : claimed noise of a pixel.
    mean_stderr_relative : claimed noise of the picture's mean luminance.
    efficiency_per_s : 1 / (relmse total_s).
    picture : file, relative to the CSV.
    """

    scene: str
    scene_hash: str
    method: str
    gather_count: int
    photons: int
    seed: int
    program: str
    workers: int
    photons_stored: int
    photons_emitted: int
    load_s: float
    trace_s: float
    estimate_s: float
    write_s: float
    total_s: float
    reference: str
    rmse: float
    relmse: float
    relmse_stderr: float
    relmse_uncorrected: float
    bias: float
    bias_stderr: float
    delta_e_mean: float
    delta_e_p95: float
    ssim: float
    stderr_relative_mean: float
    mean_stderr_relative: float
    efficiency_per_s: float
    picture: str
    finished: str

    @property
    def key(self) -> tuple[str, str, int, int, int, str]:
        """What tells one run from another."""
        return self.scene_hash, self.method, self.gather_count, self.photons, self.seed, self.program

    @property
    def seconds(self) -> dict[str, float]:
        """By stage."""
        return {stage: getattr(self, f"{stage}_s") for stage in STAGES}


COLUMNS = tuple(field.name for field in fields(ErrorRow))
_PARSE = {"str": str, "int": int, "float": lambda text: float(text) if text else math.nan}
_PARSERS = tuple(_PARSE[field.type] for field in fields(ErrorRow))


class RowFile:
    """The CSV file of a report's rows.

    Parameters
    ----------
    path : need not exist. A last line that a killed run left half written is dropped.

    Raises
    ------
    InputError : the file is another program's, or damaged elsewhere than at its end.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows, whole = _read(path)
        if not whole:
            self.replace(self.rows)

    def append(self, row: ErrorRow) -> None:
        """Add a row; it is on the disk when this returns."""
        try:
            with open(self.path, "a", newline="", encoding="utf-8") as file:
                file.write((_line(COLUMNS) if file.tell() == 0 else "") + _line(_cells(row)))
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise RunError(f"{self.path}: cannot be written ({error.strerror})") from error
        self.rows.append(row)

    def replace(self, rows: Iterable[ErrorRow]) -> None:
        """Write all rows anew."""
        self.rows = list(rows)
        with whole_file(self.path) as partial:
            text = _line(COLUMNS) + "".join(_line(_cells(row)) for row in self.rows)
            partial.write_text(text, encoding="utf-8", newline="")


def _read(path: Path) -> tuple[list[ErrorRow], bool]:
    """The rows of a file, and whether it ends as it should."""
    try:
        text = path.read_bytes().decode("utf-8")
    except FileNotFoundError:
        return [], True
    except UnicodeDecodeError:
        raise _foreign(path, 1) from None
    complete = text[: text.rfind("\n") + 1]
    lines = list(csv.reader(io.StringIO(complete)))
    if not lines:
        return [], False
    if tuple(lines[0]) != COLUMNS:
        raise _foreign(path, 1)
    rows = [_row(path, number, cells) for number, cells in enumerate(lines[1:], start=2)]
    return rows, complete == text


def _row(path: Path, number: int, cells: list[str]) -> ErrorRow:
    try:
        return ErrorRow(*(parse(cell) for parse, cell in zip(_PARSERS, cells, strict=True)))
    except ValueError:
        raise _foreign(path, number) from None


def _foreign(path: Path, line: int) -> InputError:
    return InputError(
        "is not a table of this version of the program", where=f"{path}:{line}",
        remedy="move it away, or choose another folder with -o",
    )  # fmt: skip


def _cells(row: ErrorRow) -> list[str]:
    return [_text(value) for value in astuple(row)]


def _text(value: str | int | float) -> str:
    if isinstance(value, float):
        return f"{value:.6g}" if math.isfinite(value) else ""
    return str(value)


def _line(cells: Iterable[str]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue()
