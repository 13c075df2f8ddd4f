"""Who may import whom, and which libraries only one module or package knows."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import skinrender

PACKAGE = Path(skinrender.__file__).parent
ORDER = (
    {"cli"},
    {"analysis"},
    {"engine", "export"},
    {"film", "estimate", "photonmap", "skin"},
    {"optics"},
    {"transport", "scene"},
)
LEVEL = {package: level for level, packages in enumerate(ORDER) for package in packages}
SHARED = {"atomic", "errors", "files", "npz", "sources"}
OWNERS = {
    "click": {"cli"},
    "pydantic": {"scene"},
    "pydantic_core": {"scene"},
    "yaml": {"scene"},
    "numba": {"transport"},
    "colour": {"film/color.py"},
    "OpenEXR": {"film/exr.py"},
    "matplotlib": {"skin/section.py", "analysis/plots.py"},
    "PIL": {"skin/gray.py"},
    "tifffile": {"export/tiff.py"},
    "multiprocessing": {"engine/executor.py"},
    "dask": {"engine"},
    "distributed": {"engine"},
}
HEAVY = ("numpy", "numba", "scipy", "colour", "skimage", "OpenEXR", "matplotlib", "pydantic", "yaml", "PIL", "tqdm")
PRINT_HEAVY = f"import sys; print(*(name for name in {HEAVY} if name in sys.modules), file=sys.stderr)"
RUN_COMMAND = """
from skinrender.cli import main
try:
    main({arguments})
except SystemExit:
    pass
"""


def sources() -> list[str]:
    return sorted(path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py"))


def imports(source: str) -> Iterator[tuple[str, ...]]:
    """Dotted names that a file imports, at its top or inside functions, apart from those for type checking only."""
    tree = ast.parse((PACKAGE / source).read_text(encoding="utf-8"))
    typing_only = {
        id(node)
        for block in ast.walk(tree)
        if isinstance(block, ast.If) and isinstance(block.test, ast.Name) and block.test.id == "TYPE_CHECKING"
        for node in ast.walk(block)
    }
    for node in ast.walk(tree):
        if id(node) in typing_only:
            continue
        if isinstance(node, ast.Import):
            yield from (tuple(alias.name.split(".")) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{source} imports relatively"
            yield from (tuple(f"{node.module}.{alias.name}".split(".")) for alias in node.names)


def test_every_package_has_its_place():
    found = {path.name for path in PACKAGE.iterdir() if path.is_dir() and path.name != "__pycache__"}
    assert found <= LEVEL.keys()


@pytest.mark.parametrize("source", sources())
def test_imports_run_one_way(source):
    package = source.partition("/")[0]
    own = [name[1] for name in imports(source) if name[0] == "skinrender" and len(name) > 1]
    if package not in LEVEL:
        return
    for other in own:
        assert other in SHARED or LEVEL.get(other, -1) >= LEVEL[package], f"{source} imports {other}"
        peers = LEVEL.get(other) == LEVEL[package] and other != package
        assert not (peers and package in ("transport", "scene", "engine", "export")), f"{source} imports {other}"


@pytest.mark.parametrize("source", [source for source in sources() if source.startswith("transport/")])
def test_transport_knows_numpy_and_numba_only(source):
    """And llvmlite, by which numba compiles."""
    foreign = {name[:2] if name[0] == "skinrender" else name[:1] for name in imports(source)}
    known = {("numpy",), ("numba",), ("llvmlite",), ("skinrender", "transport")}
    assert {name for name in foreign - known if name[0] not in sys.stdlib_module_names} == set()


@pytest.mark.parametrize("source", sources())
def test_libraries_stay_with_their_owner(source):
    for name in imports(source):
        owners = OWNERS.get(name[0])
        assert owners is None or source in owners or source.partition("/")[0] in owners, f"{source} imports {name[0]}"
        assert name[:2] != ("matplotlib", "pyplot"), f"{source} imports pyplot"
        pool = "ProcessPoolExecutor" in name and source != "engine/executor.py"
        assert not pool, f"{source} starts processes"


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["trace", "--help"], ["render", "-h"], []])
def test_help_imports_nothing_heavy(arguments):
    code = RUN_COMMAND.format(arguments=arguments) + PRINT_HEAVY
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=PACKAGE.parent)
    assert "skinrender" in done.stdout + done.stderr
    assert done.stderr.splitlines()[-1] == ""


def test_importing_the_package_imports_nothing_heavy():
    done = subprocess.run(
        [sys.executable, "-c", f"import skinrender; {PRINT_HEAVY}"], capture_output=True, text=True, cwd=PACKAGE.parent
    )
    assert done.stderr == "\n"
