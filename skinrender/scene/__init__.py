"""The YAML scene: what a user writes, checked, as frozen models."""

from skinrender.scene.load import load_scene, make_scene
from skinrender.scene.places import about
from skinrender.scene.provenance import BUILD_PARTS, ESTIMATE_PARTS, TRACE_PARTS, scene_hash
from skinrender.scene.schema import Scene, json_schema

__all__ = [
    "BUILD_PARTS",
    "ESTIMATE_PARTS",
    "TRACE_PARTS",
    "Scene",
    "about",
    "json_schema",
    "load_scene",
    "make_scene",
    "scene_hash",
]
