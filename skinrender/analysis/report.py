"""The report on error against run time: runs, page, table and plots, in one folder."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skinrender.analysis.error_levels import Level, Series
from skinrender.analysis.error_runs import PARTS_NAME, Outcome, StudyRun, left_out_lines
from skinrender.analysis.error_stats import PowerLaw, Uncertain
from skinrender.analysis.error_study import Study
from skinrender.analysis.plots import save
from skinrender.analysis.report_findings import Findings, gather_findings
from skinrender.analysis.report_page import report_page, table1_markdown
from skinrender.analysis.report_plots import draw_color_noise, draw_errors, draw_pictures, draw_stages
from skinrender.analysis.stability_page import PAGE_NAME
from skinrender.atomic import whole_file
from skinrender.engine.lock import folder_lock


@dataclass(frozen=True, eq=False)
class Report:
    """A finished report.

    Parameters
    ----------
    files : that were written, the page first.
    """

    outcome: Outcome
    findings: tuple[Findings, ...]
    files: tuple[Path, ...]

    def as_json(self) -> dict[str, Any]:
        """The object that ``skinrender report --json`` prints."""
        return {
            "runs": len(self.outcome.rows),
            "runs_new": self.outcome.new_rows,
            "left_out": left_out_lines(self.outcome.left_out),
            "scenes": [_scene_json(found) for found in self.findings],
            "seconds": {"total": self.outcome.seconds},
            "files": [str(path) for path in self.files],
        }


def report(
    study: Study,
    out: Path,
    *,
    command: str = "",
    progress: bool = True,
    detail: Callable[[str], None] = lambda _: None,
) -> Report:
    """Run what is not in the folder yet, and write the report.

    Parameters
    ----------
    study : what is compared.
    out : folder, which exists.
    command : told in the page.
    progress, detail : see `error_runs.StudyRun`.

    Raises
    ------
    InputError : another run has the folder, a file in it is not this program's, or a scene has no picture.
    RunError : the disk is full or read-only.
    Interrupted : finished runs are kept.
    """
    with folder_lock(out):
        outcome = StudyRun(study, out, progress=progress, detail=detail).run()
        findings = gather_findings(study, outcome, out)
        return Report(outcome, findings, _write(study, outcome, findings, out, command))


def _write(
    study: Study, outcome: Outcome, findings: Sequence[Findings], out: Path, command: str
) -> tuple[Path, ...]:
    page, table = out / PARTS_NAME / "index.html", out / "table1.md"
    stability = f"../{PAGE_NAME}" if (out / PAGE_NAME).is_file() else None
    _write_text(page, report_page(study, outcome, findings, command, stability))
    _write_text(table, table1_markdown(findings))
    plots = _write_plots([found for found in findings if found.series], out)
    return (page, out / "error_vs_time.csv", *plots, table)


def _write_plots(findings: Sequence[Findings], out: Path) -> tuple[Path, ...]:
    """Every plot of the page as PNG and SVG, the main one in the report's folder itself."""
    if not findings:
        return ()
    folder = out / PARTS_NAME / "plots"
    folder.mkdir(exist_ok=True)
    figures = {
        out / "error_vs_time": draw_errors(findings),
        folder / "color_difference": draw_color_noise(findings),
        folder / "stages": draw_stages(findings),
    }
    for number, found in enumerate(findings, start=1):
        figures[folder / f"pictures_{number}"] = draw_pictures(found)
    paths = {path.with_suffix(f".{kind}"): figure for path, figure in figures.items() for kind in ("png", "svg")}
    for path, figure in paths.items():
        save(figure, path)
    return tuple(paths)


def _write_text(path: Path, text: str) -> None:
    path.parent.mkdir(exist_ok=True)
    with whole_file(path) as partial:
        partial.write_text(text, encoding="utf-8")


def _scene_json(found: Findings) -> dict[str, Any]:
    reference = found.reference
    return {
        "scene": found.subject.label,
        "hash": found.subject.identity,
        "reference": {
            "kind": reference.kind,
            "why": found.why,
            "photons": reference.photons,
            "noise_relative": reference.noise,
            "delta_e_noise": reference.color_noise,
        },
        "series": [_series_json(series) for series in found.series],
    }


def _series_json(series: Series) -> dict[str, Any]:
    return {
        "method": series.method.name,
        "gather_count": series.method.gather_count,
        "slope_seconds": _law_json(series.by_seconds),
        "slope_photons": _law_json(series.by_photons),
        "bias_squared": None if series.floor is None else _with_error(series.floor),
        "verdict": series.verdict(),
        "photons_at_floor": series.photons_at_floor,
        "seconds_at_floor": series.seconds_at_floor,
        "levels": [_level_json(level) for level in series.levels],
    }


def _level_json(level: Level) -> dict[str, Any]:
    return {
        "photons": level.photons,
        "photons_stored": level.stored,
        "runs": len(level.rows),
        "seconds": level.seconds,
        "rmse": level.mean("rmse"),
        "relmse": _with_error(level.relmse),
        "bias": _with_error(level.bias),
        "delta_e_mean": level.mean("delta_e_mean"),
        "delta_e_p95": level.mean("delta_e_p95"),
        "delta_e_noise": level.delta_e_noise,
        "ssim": level.mean("ssim"),
        "stderr_relative_claimed": level.claimed,
        "stderr_relative_true": level.true_noise,
        "efficiency_per_s": level.efficiency,
    }


def _law_json(law: PowerLaw | None) -> dict[str, Any] | None:
    return None if law is None else {"value": law.slope, "half_width_95": law.half_width, "runs": law.points}


def _with_error(pair: Uncertain) -> dict[str, float | None]:
    return {"value": pair.value, "stderr": pair.stderr if math.isfinite(pair.stderr) else None}
