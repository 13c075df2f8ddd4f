"""report/index.html: error against run time, for a reader who was not there."""

from __future__ import annotations

import math
import os
import platform
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

from skinrender.analysis import html_page as html
from skinrender.analysis import table1
from skinrender.analysis.error_levels import Level, Series
from skinrender.analysis.error_runs import Outcome, left_out_lines
from skinrender.analysis.error_stats import PowerLaw, divisor_side
from skinrender.analysis.error_study import Study, count_text
from skinrender.analysis.plots import as_bytes
from skinrender.analysis.report_findings import Findings
from skinrender.analysis.report_plots import draw_color_noise, draw_errors, draw_pictures, draw_stages
from skinrender.engine.clock import cpu_name
from skinrender.files import printable

LIBRARIES = ("skinrender", "numpy", "numba", "scipy", "scikit-image", "colour-science", "OpenEXR", "matplotlib")
DEFINITIONS = (
    "relMSE: mean over the pixels of (A − R)² / R², luminance of picture A against the reference R. R comes in two independent "
    "halves R₁, R₂; (A − R₁)(A − R₂) is taken for the square, so that the reference's own variance is not in it. Where the error "
    "is smaller than the noise of this difference, the number may come out negative. RMSE: the same without dividing by R², its root.",
    "± and error bars: 95 % confidence for relMSE, from the spread over 16 parts of the picture; standard error elsewhere.",
    "Bias: mean A / mean R − 1; its standard error holds the noise of both, from independent batches of rounds. "
    "Bias squared, pixel by pixel, comes from products of the errors of different seeds, in which noise has no part; it is called seen when 0 is ruled out at 99.9 %.",
    "Claimed: the noise of a pixel that the picture itself states (stderr.Y over Y, mean). True: what pairs of seeds show. "
    "A claim is too low where pixels have met no photon at all.",
    "ΔE00 (CIEDE2000) and SSIM are against the reference as it is, its noise included.",
    "Efficiency: 1 / (relMSE · s). Unbiased and limited by noise, it does not depend on the photon count.",
    "Slopes: log relMSE (less the bias squared, where one is seen) against log photons and log seconds, by least squares, over the "
    "runs in which noise rules, with the 95 % interval. Pure "
    "noise falls as 1 / photons; against seconds the slope is steeper as long as fixed costs rule.",
    "Seconds: one process that has loaded its libraries and compiled its kernels; a command of its own takes one to two seconds "
    "more. The methods of one seed share one trace, which counts for each of them.",
)  # fmt: skip


def report_page(
    study: Study, outcome: Outcome, findings: Sequence[Findings], command: str, stability: str | None = None
) -> str:
    """The page, one HTML file.

    Parameters
    ----------
    command : how it came about.
    stability : the page of stiff and extreme cases that lies beside it, as a link.
    """
    seen = [found for found in findings if found.series]
    parts = [*_head(study, outcome)]
    if seen:
        parts += _errors(seen)
        parts += _pictures(seen)
        parts += _times(seen)
        parts += _numbers(seen)
    parts.append("<h2>Stiff and extreme cases</h2>")
    parts.append(_stability(stability))
    parts += _settings(study, findings, command)
    return html.page("Error against run time", parts)


def table1_markdown(findings: Sequence[Findings]) -> str:
    """Seconds of each stage, scene by scene, beside the paper's."""
    parts = ["# Seconds of each stage, beside the paper's table 1", ""]
    for found in findings:
        pair = _point_and_beam(found)
        if pair is not None:
            photons, point, beam = pair
            parts += [f"## {html.text(found.subject.label)}, {count_text(photons)} photons", "", table1.table(point, beam), ""]
    parts += [f"Here: {_machine(_workers(findings))}.", f"Paper: {table1.PAPER_HARDWARE}.", ""]
    return "\n".join(parts)


def _head(study: Study, outcome: Outcome) -> Iterator[str]:
    yield "<h1>Error against run time</h1>"
    scenes = ", ".join(subject.label for subject in study.subjects)
    methods = "; ".join(method.label for method in study.methods)
    yield (
        f'<p class="lead">Scenes: {html.text(scenes)}. Radiance estimates: {html.text(methods)}. {len(outcome.rows)} runs, '
        f"{study.seeds} seeds a photon count.</p>"
    )
    if outcome.left_out:
        yield "<p>Left out, as the time allowed (--target-seconds) was used up:</p>"
        yield html.items(left_out_lines(outcome.left_out))


def _errors(findings: Sequence[Findings]) -> Iterator[str]:
    yield "<h2>Error against time</h2>"
    yield html.figure(
        as_bytes(draw_errors(findings), "svg"), "svg",
        "Relative mean square error of luminance against total seconds. Large marks: mean over the seeds with its 95 % interval; "
        "small ones: single runs. Dashed: the bias squared, to which a line flattens; dotted: no bias was seen, and it is surely "
        "below this.",
        "relMSE against seconds, logarithmic axes",
    )  # fmt: skip
    rows = [(found.subject.label, s.method.label, s.verdict(), _slope(s.by_photons), _slope(s.by_seconds)) for found in findings for s in found.series]
    yield html.table(("scene", "estimate", "noise and bias", "slope in photons", "slope in seconds"), rows, text_columns=3)
    yield html.items(_caveats(findings))
    yield html.figure(
        as_bytes(draw_color_noise(findings), "svg"), "svg",
        "Color difference of a pixel against total seconds. Where the solid line leaves the dashed one, the difference is no "
        "longer noise of the picture, but bias or noise of the reference (lowest line).",
        "CIEDE2000 against seconds, logarithmic axes",
    )  # fmt: skip


def _caveats(findings: Sequence[Findings]) -> Iterator[str]:
    """What the reference cannot show."""
    for found in findings:
        reference = found.reference
        noise = f"{100 * reference.noise:.2g} % of a pixel's luminance (rms), ΔE00 {reference.color_noise:.2g}"
        told = f"{found.subject.label}: reference by {reference.kind} ({found.why}), {count_text(reference.photons)} photons; its noise is {noise}"
        side = divisor_side(reference.halves)
        if side > 1:
            told += f". For relMSE the R² below the line is averaged over {side} × {side} pixels, so that this noise does no harm"
        if reference.kind == "beam":
            told += ". A bias of the beam estimate itself is in the reference too and cannot show here"
        yield told + "."


def _pictures(findings: Sequence[Findings]) -> Iterator[str]:
    yield "<h2>Pictures at nearly equal time</h2>"
    for found in findings:
        name = found.subject.label
        yield html.figure(
            as_bytes(draw_pictures(found), "png"), "png",
            f"{name}. Above: the reference and one run of each estimate, at the longest time that all of them reached. Below: the "
            "signed difference of luminance from the reference.",
            f"pictures and difference images of {name}",
        )  # fmt: skip


def _times(findings: Sequence[Findings]) -> Iterator[str]:
    yield "<h2>Seconds of each stage, beside the paper's table 1</h2>"
    for found in findings:
        pair = _point_and_beam(found)
        if pair is None:
            yield f"<p>{html.text(found.subject.label)}: needs runs by point and by beam of one photon count.</p>"
            continue
        photons, point, beam = pair
        head, *rows = table1.cells(point, beam)
        pixels = " × ".join(str(n) for n in found.subject.scene.camera.pixels)
        yield html.table(
            head,
            rows,
            f"{found.subject.label}: {pixels} pixels, {count_text(photons)} photons stored; mean over the seeds",
        )
    yield (
        f'<p class="soft">Here: {html.text(_machine(_workers(findings)))}. Paper: {html.text(table1.PAPER_HARDWARE)}. '
        "Other scenes, sizes and machines: compare the ratios, not the seconds.</p>"
    )
    yield "<h2>Where the time goes</h2>"
    yield html.figure(
        as_bytes(draw_stages(findings), "svg"), "svg", "Share of each stage in the total, whose seconds stand at the right.",
        "shares of load, trace, estimate and write in the total seconds",
    )  # fmt: skip


def _numbers(findings: Sequence[Findings]) -> Iterator[str]:
    yield "<h2>All numbers</h2>"
    head = (
        "estimate", "photons", "stored", "seconds", "RMSE", "relMSE", "bias / %", "ΔE00 mean", "ΔE00 95 %", "SSIM",
        "claimed / %", "true / %", "efficiency / s⁻¹",
    )  # fmt: skip
    for found in findings:
        rows = [_level_cells(s, level) for s in found.series for level in s.levels]
        yield html.table(head, rows, f"{found.subject.label}: means over the seeds; one row a run in error_vs_time.csv")
    yield html.items(DEFINITIONS)


def _level_cells(series: Series, level: Level) -> tuple[str, ...]:
    low, high = level.relmse.interval
    return (
        series.method.label, count_text(level.photons), count_text(level.stored), _number(level.seconds["total"]), _number(level.mean("rmse")),
        _rounded(level.relmse.value, 0.5 * (high - low)),
        _rounded(100 * level.bias.value, 100 * level.bias.stderr),
        _number(level.mean("delta_e_mean")), _number(level.mean("delta_e_p95")), _number(level.mean("ssim")),
        _number(100 * level.claimed), _number(100 * level.true_noise), _number(level.efficiency),
    )  # fmt: skip


def _stability(link: str | None) -> str:
    if link is None:
        return "<p><code>skinrender check</code> with the same <code>-o</code> runs them; their page is then linked here.</p>"
    return f'<p>Each with what it could break, what was measured, the bound and the verdict: <a href="{html.text(link)}">check.html</a>.</p>'


def _settings(study: Study, findings: Sequence[Findings], command: str) -> Iterator[str]:
    yield "<h2>Settings and provenance</h2>"
    yield f"<p><code>{html.text(command)}</code></p>"
    rows: list[tuple[str, Any]] = [
        ("made", datetime.now(UTC).isoformat(timespec="seconds")),
        ("machine", f"{_machine(_workers(findings))}, {platform.system()} {platform.machine()}"),
        (
            "versions",
            ", ".join([f"python {platform.python_version()}", *(f"{name} {version(name)}" for name in LIBRARIES)]),
        ),
    ]
    for found in findings:
        subject = found.subject
        counts = ", ".join(count_text(count) for count in study.counts_of(subject))
        seeds = ", ".join(str(seed) for seed in study.seeds_of(subject))
        pixels = " × ".join(str(n) for n in subject.scene.camera.pixels)
        rows.append((
            subject.label,
            f"{printable(subject.path)}, hash {subject.identity}; {pixels} pixels, {len(subject.scene.wavelength_nm)} bands; photons {counts}; "
            f"seeds {seeds}; reference {found.reference.identity} by {found.reference.kind}",
        ))  # fmt: skip
    yield html.table(("", ""), rows, text_columns=2)


def _point_and_beam(found: Findings) -> tuple[int, dict[str, float], dict[str, float]] | None:
    """Seconds by point and by beam at the largest photon count of both."""
    first = {series.method.name: series for series in reversed(found.series)}
    if not {"point", "beam"} <= first.keys():
        return None
    levels = [{level.photons: level for level in first[name].levels} for name in ("point", "beam")]
    common = levels[0].keys() & levels[1].keys()
    return (max(common), *(of[max(common)].seconds for of in levels)) if common else None


def _machine(workers: str) -> str:
    return f"{cpu_name()}, {os.cpu_count()} cores, photons walked by {workers} process{'' if workers == '1' else 'es'}"


def _workers(findings: Sequence[Findings]) -> str:
    """Processes that walked the photons, as text."""
    workers = {row.workers for found in findings for s in found.series for level in s.levels for row in level.rows}
    return " or ".join(str(count) for count in sorted(workers)) or "no"


def _slope(law: PowerLaw | None) -> str:
    if law is None:
        return "–"
    return f"{law.slope:.2f}" + (f" ± {law.half_width:.2f}" if math.isfinite(law.half_width) else "")


def _rounded(value: float, error: float) -> str:
    """A value rounded to two digits of what it is uncertain by."""
    if not (math.isfinite(error) and error > 0):
        return _number(value)
    digits = 1 - math.floor(math.log10(error))
    if digits > 6:
        return f"{value:.2e} ± {error:.1e}"
    return f"{round(value, digits):.{max(0, digits)}f} ± {round(error, digits):.{max(0, digits)}f}"


def _number(value: float, digits: int = 3) -> str:
    return f"{value:.{digits}g}" if math.isfinite(value) else "–"
