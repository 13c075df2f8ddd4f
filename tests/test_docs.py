"""The documentation says what the program does: its generated parts are whole, what it names is there."""

from __future__ import annotations

import re
import runpy
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from skinrender.cli import COMMANDS
from skinrender.scene import json_schema

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.glob("*.md"))
FEW = ("bands_nm=[450,550,650]", "photons.stored=2e4", "camera.pixels=[8,8]", "relief={kind: flat}")


@pytest.fixture
def pages(monkeypatch):
    """The site's hook, as mkdocs loads it."""
    monkeypatch.syspath_prepend(DOCS / "hooks")
    return runpy.run_path(str(DOCS / "hooks" / "pages.py"))


def parts(schema: dict) -> Iterator[tuple[str, dict]]:
    yield "the scene", schema
    yield from ((name, part) for name, part in schema["$defs"].items() if "properties" in part)


def test_scene_reference_has_every_key_of_the_schema(pages):
    sections = re.split(r"^## ", pages["scene_reference"](json_schema()), flags=re.MULTILINE)[1:]
    schema = json_schema()
    assert len(sections) == len(list(parts(schema)))
    for name, part in parts(schema):
        heading = "The scene\n" if name == "the scene" else f"{{ #{name.lower()} }}\n"
        (section,) = [section for section in sections if heading in section]
        rows = dict(re.findall(r"^\| `(\w+)` (\|.*)$", section, flags=re.MULTILINE))
        assert rows.keys() == part["properties"].keys()
        for key, value in part["properties"].items():
            assert value.get("description", "") in rows[key], f"{name}.{key}"
            assert ("| required |" in rows[key]) == (key in part.get("required", ())), f"{name}.{key}"


def test_scene_reference_tells_bounds_and_choices(pages):
    told = pages["scene_reference"](json_schema())
    assert "| `oil` | number 0 to 1 | `0.0` |" in told
    assert "| `zenith_deg` | number ≥ 0, < 90 |" in told
    assert "| `sides` | `periodic`, `open`, `dielectric` | `periodic` |" in told
    assert "| `mu_s_per_mm` | number 0 to 1e+06 or table nm: number 0 to 1e+06 | required |" in told
    assert "[mole](#mole)" in told and "{ #mole }" in told


def test_every_command_has_its_help_and_its_row(pages):
    told = pages["command_reference"]()
    table = (DOCS / "commands.md").read_text(encoding="utf-8")
    for command in COMMANDS:
        assert f"## {command} {{ #{command} }}\n\n```text\nUsage: skinrender {command} " in told
        assert f"| `{command}" in table


def test_each_generated_part_has_a_page(pages):
    texts = [page.read_text(encoding="utf-8") for page in PAGES]
    for marker in pages["MARKERS"]:
        (text,) = [text for text in texts if marker in text]
        assert marker not in pages["on_page_markdown"](text)


def test_every_page_is_in_the_navigation():
    nav = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]
    assert sorted(_leaves(nav)) == [page.name for page in PAGES]


def _leaves(node: object) -> Iterator[str]:
    if isinstance(node, str):
        yield node
    for child in node.values() if isinstance(node, dict) else node if isinstance(node, list) else ():
        yield from _leaves(child)


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES], ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for link in re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text(encoding="utf-8")):
        assert link.startswith("http") or (page.parent / link).is_file(), link


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES], ids=lambda page: page.name)
def test_named_sources_scenes_and_targets_are_there(page):
    text = page.read_text(encoding="utf-8")
    folders = {path.name for path in (ROOT / "skinrender").iterdir() if path.is_dir()}
    for name in re.findall(r"`((?:[\w]+/)+[\w]+\.(?:py|csv|json|yaml|png))`", text):
        inside = name.partition("/")[0] in folders
        assert (ROOT / "skinrender" / name if inside else ROOT / name).is_file(), name
    for scene in re.findall(r"configs/\w+\.yaml", text):
        assert (ROOT / scene).is_file(), scene
    targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert set(re.findall(r"`make ([\w-]+)", text)) <= {*targets, "figures"}


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES], ids=lambda page: page.name)
def test_no_table_is_still_to_be_filled_in(page):
    """A line that is one word in capitals stands for what somebody meant to measure."""
    assert re.findall(r"^[A-Z_]{4,}$", page.read_text(encoding="utf-8"), flags=re.MULTILINE) == []


def test_example_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["more_melanin.py", *FEW])
    found = runpy.run_path(str(DOCS / "examples" / "more_melanin.py"))
    light, dark = (found["spectra"][scale].inside for scale in (0.05, 0.4))
    error = (light.total_stderr**2 + dark.total_stderr**2) ** 0.5
    assert ((light.total - dark.total) / error > 4).all()
    assert {path.name for path in Path("out/more_melanin").iterdir()} >= {"pictures.png", "spectra.png"}
    assert capsys.readouterr().out.count("melanin_scale") == 4


def test_example_becomes_text_and_code(pages):
    source = '"""Not shown."""\n\n# %% [markdown]\n# Some *text*.\n#\n# More.\n\n# %%\nx = 1\n\n# a comment\n'
    assert pages["notebook"](source) == "Some *text*.\n\nMore.\n\n```python\nx = 1\n\n# a comment\n```\n"
