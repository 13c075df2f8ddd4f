"""skinrender check: the stiff and extreme cases, or the photon walk against truths."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinrender.cli.console import Console, Row, marked, seconds_row
from skinrender.cli.options import Quantity, reporting, with_workers
from skinrender.errors import RunError

if TYPE_CHECKING:
    from skinrender.analysis.slab_stats import Result
    from skinrender.analysis.stability import Found


@click.command()
@click.option(
    "--slabs", "slabs", metavar="FILE", type=click.Path(path_type=Path),
    help="Check instead truths of layered slabs (JSON): totals, fields or radial profiles.",
)
@click.option("--only", metavar="PATTERN", help="Cases or records whose name begins so or matches, e.g. 'thin*'.")
@click.option(
    "--stderr", type=Quantity(1e-5, 0.1), default=1e-3, show_default=True,
    help="With --slabs: standard error wanted of fractions; that of scattering events is 20 times it, relative.",
)
@click.option("--seed", type=click.IntRange(0, 2**63 - 1), default=1, show_default=True, help="Seed of the photons.")
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), metavar="DIR", default=Path("out/check"), show_default=True,
    help="Folder to write to.",
)
@with_workers
@reporting
def check(
    slabs: Path | None, only: str | None, stderr: float, seed: int, output: Path, workers: int | None, console: Console
) -> None:  # fmt: skip
    """Check that nothing breaks in stiff and extreme cases.

    Each case is a small run of the whole chain, judged by closed forms and invariants. With --slabs FILE the photon
    walk is checked against truths instead: each quantity with what is expected, what was got, the standard error and
    their z, which must stay below 4. Writes check.csv; the cases also as a page, check.html.

    \b
    Example:
      skinrender check
      skinrender check --only 'grazing*'
      skinrender check --slabs tests/truth/layered_slabs.json --only 'skin7*'
    """
    if slabs is None:
        _check_cases(only, seed, output, workers, console)
    else:
        _check_slabs(slabs, only, stderr, seed, output, workers, console)


def _check_cases(only: str | None, seed: int, output: Path, workers: int | None, console: Console) -> None:
    from skinrender.analysis.stability import planned_cases, run_cases, write_cases
    from skinrender.analysis.stability_page import write_page
    from skinrender.cli.job import make_folder

    numbers, folder = planned_cases(only), make_folder(output)
    found = run_cases(numbers, seed, workers, _watch(console, " cases"))
    write_cases(folder / "check.csv", found)
    write_page(folder / "check.html", found, seed)
    off = [one for one in found if not one.ok]
    summary = {
        "cases": [one.as_json() for one in found],
        "ok": not off,
        "seconds": {"cases": sum(one.seconds for one in found)},
    }
    verdict = ("all within their bounds", "NO" if off else "yes")
    console.result(summary, [*_case_table(found), ("", ""), verdict, seconds_row(summary["seconds"])])
    if off:
        raise RunError(f"{len(off)} of {len(found)} cases are off: {', '.join(one.case for one in off)}")


def _check_slabs(
    slabs: Path, only: str | None, stderr: float, seed: int, output: Path, workers: int | None, console: Console
) -> None:
    from skinrender.analysis.slab_walk import Accuracy
    from skinrender.analysis.slabs import planned_checks, run_checks, write_results
    from skinrender.cli.job import make_folder

    checks = planned_checks(slabs, only=only, seed=seed, wanted=Accuracy(stderr, 20.0 * stderr))
    folder = make_folder(output)
    found = run_checks(checks, workers, _watch(console, " records"))
    results, summary = found.results, found.as_json()
    write_results(folder / "check.csv", results)
    for note in summary["notes"]:
        console.warn(note)
    console.result(summary, [*_table(results), *_conclusion(summary), seconds_row(summary["seconds"])])
    failed = [result for result in results if not result.ok]
    if failed:
        worst = max(failed, key=lambda result: abs(result.z))
        raise RunError(f"{len(failed)} of {len(results)} quantities are off, the worst {worst.id} {worst.quantity}")


def _watch(console: Console, unit: str) -> Callable[[Iterable, int], Iterable]:
    """Shows progress of so many items on a terminal."""
    from tqdm import tqdm

    hide = None if console.progress else True
    return lambda items, count: tqdm(items, desc="check", total=count, unit=unit, disable=hide, leave=False)


def _case_table(found: Iterable[Found]) -> list[Row]:
    """Case, what could break, what was measured, its bound, verdict: the last three under the first two."""
    rows = []
    for one in found:
        worst = one.decisive
        measured = f"{worst.quantity} {worst.measured:.3g}, bound {worst.bound:g}"
        rows += [(one.case, one.could_break), ("", f"  {measured}: {'ok' if one.ok else marked('OFF', 'red')}")]
    return rows


def _table(results: Iterable[Result]) -> list[Row]:
    rows = [("quantity", f"{'expected':>13} {'got':>13} {'stderr':>9} {'z':>7}  ok")]
    for r in results:
        values = (
            f"{r.expected:13.7g} {r.got:13.7g} {r.stderr:9.2g} {r.z:7.2f}  {'yes' if r.ok else marked('NO', 'red')}"
        )
        rows.append((f"{r.id} {r.quantity}", values))
    return rows


def _conclusion(summary: dict[str, Any]) -> list[Row]:
    of_r = summary["R_total_z"]
    rows = [("", ""), ("all within 4 standard errors", "yes" if summary["ok"] else "NO")]
    if of_r["mean"] is not None:
        squares = f"sum of squares {of_r['sum_z2']:.1f} of {of_r['count']} (p {of_r['p_chi2']:.2g})"
        told = f"mean {of_r['mean']:+.2f}, {squares}, Kolmogorov-Smirnov p {of_r['p_ks']:.2g}"
        rows.append(("z of R_total over the records", told))
    return rows
