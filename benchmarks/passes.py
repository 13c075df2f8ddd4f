"""Where the photon walk's time goes, pass by pass: `python -m benchmarks.passes`.

`walk` itself is timed: its source with a reading of the cycle counter after each pass. A pass that another process or
the system broke into is left out.
"""

from __future__ import annotations

import argparse
import ast
import inspect
import textwrap
import time

import numba
import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from benchmarks.walk import CASES, make_pass
from skinrender.photonmap import photon_pass as passes_of
from skinrender.transport import tally
from skinrender.transport import walk as walk_module

BROKEN = 100_000  # cycles: more than any pass over a block takes
BROKEN_RELAUNCH = 500_000  # this one may let a block of histories arrive
LONGEST = 64  # passes
USUAL = ["RED", "forearm flat, macule", "forearm relief"]


@intrinsic
def clock(typingctx):
    """Reading of the processor's cycle counter."""

    def codegen(context, builder, signature, args):
        counter = builder.module.declare_intrinsic("llvm.readcyclecounter", (), ir.FunctionType(ir.IntType(64), ()))
        return builder.call(counter, ())

    return types.int64(), codegen


@numba.njit
def add_cycles(spent, k, last, broken):
    """Adds the cycles since `last` to pass k; returns the time."""
    cycles = clock() - last
    if cycles < broken:
        spent[k] += cycles
    return clock()


def timed_walk():
    """`walk` that adds the cycles of each pass to a last argument, `spent`; and the names of the passes."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(walk_module.walk.py_func)))
    (function,) = tree.body
    function.decorator_list.clear()
    function.args.args.append(ast.arg("spent"))
    names: list[str] = []
    loop = next(node for node in ast.walk(function) if isinstance(node, ast.While))
    for node in ast.walk(loop):
        if isinstance(node, ast.While | ast.If):
            _read_after_calls(node.body, names)
            _read_after_calls(node.orelse, names)
    loop.body.insert(0, ast.parse("last = clock()").body[0])
    space = {**vars(walk_module), "clock": clock, "add_cycles": add_cycles}
    exec(compile(ast.fix_missing_locations(tree), "timed walk", "exec"), space)
    return numba.njit(nogil=True, error_model="numpy", _nrt=False)(space["walk"]), names


def _read_after_calls(body: list[ast.stmt], names: list[str]) -> None:
    for index, statement in reversed(list(enumerate(body))):
        call = getattr(statement, "value", None)
        if isinstance(call, ast.Call) and call.args and ast.unparse(call.args[0]) in ("f", "w"):
            body.insert(index + 1, _reading(len(names), call.func.id))
            names.append(call.func.id)


def _reading(k: int, name: str) -> ast.stmt:
    broken = BROKEN_RELAUNCH if name == "relaunch" else BROKEN
    return ast.parse(f"last = add_cycles(spent, {k}, last, {broken})").body[0]


def cycles_per_ns() -> float:
    """Rate of the cycle counter."""
    read = numba.njit(lambda: clock())
    read()
    began, cycles = time.perf_counter_ns(), read()
    time.sleep(0.2)
    return (read() - cycles) / (time.perf_counter_ns() - began)


def profile(case: str, storing: bool, runs: int, histories: int) -> list[tuple[float, dict[str, float]]]:
    """For each band its wavelength and the ns per scattering event of each pass, in the best of some runs."""
    photon_pass = make_pass(*CASES[case])
    layers, rate = len(photon_pass.layer_names), cycles_per_ns()
    timed, names = timed_walk()
    spent = np.zeros(LONGEST, np.int64)
    passes_of.walk = lambda *arguments: timed(*arguments, spent)
    result = []
    for band, wavelength in enumerate(photon_pass.volume.wavelength_nm):
        best = None
        for k in range(runs):
            count = np.zeros(photon_pass.bands, np.int64)
            count[band] = histories
            spent[:] = 0
            counts = photon_pass.walk(k, count, storing).tallies[band]
            events = counts[tally.scattered(layers)].sum() + counts[tally.absorbed(layers)].sum()
            found = spent / rate / events
            if best is None or found.sum() < best.sum():
                best = found
        by_name: dict[str, float] = {}
        for name, ns in reversed(list(zip(names, best))):
            by_name[name] = by_name.get(name, 0.0) + ns
        result.append((float(wavelength), by_name))
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", default=USUAL, help=f"of {', '.join(CASES)}")
    parser.add_argument("--storing", action="store_true")
    parser.add_argument("--runs", type=int, default=15)
    parser.add_argument("--histories", type=int, default=16_000)
    options = parser.parse_args()
    for case in options.cases:
        for wavelength, by_name in profile(case, options.storing, options.runs, options.histories):
            shares = "  ".join(f"{name} {ns:.2f}" for name, ns in by_name.items() if ns > 0.0)
            print(f"{case} {wavelength:.0f} nm: {sum(by_name.values()):.1f} ns/event: {shares}", flush=True)


if __name__ == "__main__":
    main()
