"""From a scene file, or plain data, to a checked Scene."""

from __future__ import annotations

import copy
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from skinrender.errors import InputError
from skinrender.files import printable
from skinrender.scene.checks import cross_problems, presence_problems
from skinrender.scene.messages import validation_problems
from skinrender.scene.overrides import Override, apply_overrides
from skinrender.scene.problems import raise_problems
from skinrender.scene.schema import Scene
from skinrender.scene.yaml_source import Source, read_source

# Take the place of a section with mistakes while the checks between the other sections run.
_STAND_INS: dict[str, Any] = {
    "patch": {"size_mm": [1, 1], "columns": [1, 1]},
    "skin": {},
    "slab": {"layers": [{"thickness_mm": 1, "mu_a_per_mm": 0, "mu_s_per_mm": 0, "g": 0, "refractive_index": 1}]},
}


def load_scene(path: str | Path, overrides: Iterable[str | Override] = ()) -> Scene:
    """Read and check a scene file.

    Parameters
    ----------
    path : the YAML file; files it names are relative to it.
    overrides : `key.path=value` texts that replace or add values.

    Raises
    ------
    InputError
        Telling everything that is wrong with the file and the overrides, one mistake a line.
    """
    path = Path(path)
    source = read_source(path)
    if source.data is None:
        raise InputError("is empty", where=str(path), remedy="a scene needs at least patch and skin or slab")
    if not isinstance(source.data, dict):
        raise InputError(
            "a scene is a mapping of keys such as 'patch:' and 'skin:'",
            where=str(source.marks[()]),
            remedy="write 'key: value' lines; see the shipped scenes in configs/",
        )
    apply_overrides(source, overrides)
    source.data.setdefault("name", printable(path.stem))
    return _checked(source, path.resolve().parent)


def make_scene(data: dict[str, Any], *, source_dir: str | Path = ".") -> Scene:
    """A checked Scene from plain data, as a scene file would hold it.

    Parameters
    ----------
    data : mapping of the keys of the scene reference; it is left as it is.
    source_dir : folder that files named in it are relative to.

    Raises
    ------
    InputError
        Telling everything that is wrong, one mistake a line.
    """
    return _checked(Source(copy.deepcopy(data)), Path(source_dir).resolve())


def _checked(source: Source, source_dir: Path) -> Scene:
    data, context = source.data, {"source_dir": source_dir, "marks": source.marks}
    problems = [*source.problems, *presence_problems(data)]
    wrong: frozenset[str] = frozenset()
    try:
        scene = Scene.model_validate(data, context=context)
    except ValidationError as error:
        problems += validation_problems(error, data)
        wrong = frozenset(str(item["loc"][0]) for item in error.errors(include_url=False) if item["loc"])
        kept = {key: value for key, value in data.items() if isinstance(key, str) and key not in wrong}
        stand_ins = {key: _STAND_INS[key] for key in wrong & _STAND_INS.keys()}
        scene = Scene.model_validate({**kept, **stand_ins}, context=context)
    problems += cross_problems(scene, wrong)
    raise_problems(problems, source.marks)
    return scene
