"""Whether a file that is there was made from just this scene, by this program."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from skinrender.cli.job import Job
from skinrender.engine.identity import ESTIMATE_SOURCES
from skinrender.errors import InputError
from skinrender.sources import sources_hash

if TYPE_CHECKING:
    from skinrender.photonmap.photon_map import PhotonMap
    from skinrender.scene import Scene
    from skinrender.skin.volume import SkinVolume


def matching_volume(job: Job) -> SkinVolume:
    """The volume of this scene; raises `InputError` with the remedy if there is none or it is another scene's."""
    from skinrender.scene import BUILD_PARTS, scene_hash
    from skinrender.skin.volume import load_volume

    remedy = f"run `skinrender build {job.scene_path}` (with the same -o and --set), or `skinrender render`"
    if not job.volume.is_file():
        raise InputError("there is no volume yet", where=str(job.volume), remedy=remedy)
    volume = load_volume(job.volume)
    if volume.provenance.get("hash") != scene_hash(job.scene, BUILD_PARTS):
        told = f"was built from another scene; it differs in: {_changed_parts(volume.provenance, job.scene)}"
        raise InputError(told, where=str(job.volume), remedy=remedy)
    return volume


def current_volume(job: Job) -> SkinVolume | None:
    """The volume, if it and its section need not be made again."""
    from skinrender.skin.builder import BUILD_SOURCES

    try:
        volume = matching_volume(job)
    except InputError as error:
        _say_why(job, "build", error)
        return None
    if volume.provenance.get("program") != sources_hash(BUILD_SOURCES):
        job.console.detail(f"build: {job.volume} was built by another version of this program")
        return None
    return volume if job.section.is_file() else None


def matching_map(job: Job, *, just_made: bool = False) -> PhotonMap:
    """The photon map of this volume and light; raises `InputError` with the remedy if there is none.

    Checksum and every photon are looked at unless it was just made.
    """
    from skinrender.engine.recipe import scene_recipe
    from skinrender.photonmap.photon_map import open_map

    remedy = f"run `skinrender trace {job.scene_path}` (with the same -o and --set), or `skinrender render`"
    if not job.photons.is_file():
        raise InputError("there is no photon map yet", where=str(job.photons), remedy=remedy)
    photon_map = open_map(job.photons)
    recipe = as_json(scene_recipe(job.scene, job.volume).provenance)
    unlike = [key for key in ("volume", "light") if photon_map.provenance.get(key) != recipe[key]]
    if unlike:
        raise InputError(
            f"was traced for another scene; it differs in: {', '.join(unlike)}", where=str(job.photons), remedy=remedy
        )
    return photon_map if just_made else open_map(job.photons, verify=True, check_photons=True)


def current_map(job: Job) -> PhotonMap | None:
    """The photon map, if it need not be traced again."""
    from skinrender.engine.identity import program_identity
    from skinrender.engine.recipe import scene_recipe
    from skinrender.engine.stop import StoredCount, described

    try:
        photon_map = matching_map(job)
    except InputError as error:
        _say_why(job, "trace", error)
        return None
    photons, found = job.scene.photons, photon_map.provenance
    wanted = {
        **scene_recipe(job.scene, job.volume).provenance,
        "seed": photons.seed,
        "program": program_identity(),
        "stop": described(StoredCount(photons.stored)),
    }
    unlike = _unlike(found, as_json(wanted))
    if unlike == ["stop"] and len(photon_map) == 0:
        return photon_map  # a scene that stores no photons at all
    if unlike:
        job.console.detail(f"trace: {job.photons} differs in: {', '.join(unlike)}")
    return None if unlike else photon_map


def estimate_provenance(job: Job, photons: Mapping[str, Any], reflectance: bool) -> dict[str, Any]:
    """What determines the picture; photons: provenance of what it shows."""
    from skinrender.scene import ESTIMATE_PARTS, scene_hash

    return as_json(
        {
            "stage": "estimate",
            "hash": scene_hash(job.scene, ESTIMATE_PARTS),
            "scene": job.scene.model_dump(mode="json", exclude_none=True),
            "reflectance": reflectance,
            "program": sources_hash(ESTIMATE_SOURCES),
            "photon_map": dict(photons),
        }
    )


def current_summary(job: Job, provenance: Mapping[str, Any]) -> dict[str, Any] | None:
    """The summary of the picture that is there, if it need not be made again."""
    from skinrender.film.exr import read_exr

    if not (job.exr.is_file() and job.png.is_file()):
        return None
    try:
        found = read_exr(job.exr).provenance
    except InputError as error:
        _say_why(job, "estimate", error)
        return None
    unlike = _unlike(found, {key: value for key, value in provenance.items() if key != "scene"})
    if unlike:
        job.console.detail(f"estimate: {job.exr} differs in: {', '.join(unlike)}")
        return None
    return found.get("summary")


def as_json(value: Mapping[str, Any]) -> dict[str, Any]:
    """As it will be read back from a file."""
    return json.loads(json.dumps(value))


def _say_why(job: Job, stage: str, error: InputError) -> None:
    job.console.detail(f"{stage}: {str(error).splitlines()[0]}")


def _unlike(found: Mapping[str, Any], wanted: Mapping[str, Any]) -> list[str]:
    return [key for key, value in wanted.items() if found.get(key) != value]


def _changed_parts(provenance: Mapping[str, Any], scene: Scene) -> str:
    from skinrender.scene import BUILD_PARTS

    built, now = provenance.get("scene"), scene.model_dump(mode="json", include=set(BUILD_PARTS), exclude_none=True)
    built = built if isinstance(built, Mapping) else {}
    parts = [part for part in BUILD_PARTS if now.get(part) != built.get(part)]
    return ", ".join(parts) or "the content of a file that it names"
