"""skinrender export: a scene, its volume or its picture in other programs' formats."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinrender.cli.console import Console, Row, seconds_row
from skinrender.cli.options import Count, Quantity, on_scene, reporting
from skinrender.errors import InputError

if TYPE_CHECKING:
    from skinrender.cli.job import Job
    from skinrender.skin.volume import SkinVolume

PROGRAMS = ("mitsuba", "mcx", "nrrd", "tiff")


@click.command()
@on_scene
@click.option("--to", "program", type=click.Choice(PROGRAMS), required=True, help="Program or format to write for.")
@click.option(
    "--band",
    "bands_nm",
    type=Quantity(),
    multiple=True,
    metavar="NM",
    help="Wavelength of the band for mitsuba or mcx; may be repeated.  [default: the one nearest 550 nm]",
)
@click.option(
    "--voxel-um",
    type=Quantity(min=1e-3),
    help="Edge of the cubes for mcx.  [default: the finest voxel height, as far as 2e7 cubes go]",
)
@click.option(
    "--picture",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Spectral EXR for tiff.  [default: the scene's <method>.exr in the folder]",
)
@click.option(
    "--samples",
    type=Count(),
    help="Paths a pixel for mitsuba, photons for mcx.  [default: 256 and 1e6]",
)
@reporting
def export(
    scene_path: Path,
    overrides: tuple[str, ...],
    output: Path | None,
    program: str,
    bands_nm: tuple[float, ...],
    voxel_um: float | None,
    picture: Path | None,
    samples: int | None,
    console: Console,
) -> None:
    """Write SCENE for another program.

    \b
    mitsuba  <scene>_<band>nm.xml and its grids: `mitsuba FILE` renders it as it is
    mcx      <scene>_<band>nm.json: `mcx -f FILE`, or pmcxcl.run(pmcx.json2mcx(FILE))
    nrrd     layers.seg.nrrd, melanin.nrrd: 3D Slicer, ITK-SNAP, ParaView
    tiff     <method>.tif: the spectral picture as a labeled stack for ImageJ

    Whatever the other program cannot represent is told, and stands in the file.

    \b
    Example:
      skinrender export configs/fig12_epidermal.yaml --to nrrd
      skinrender export configs/slab_red_matched.yaml --to mitsuba --band 650
    """
    from skinrender.cli.job import open_job
    from skinrender.scene import about

    _check_options(program, {"--band": bands_nm, "--voxel-um": voxel_um, "--picture": picture, "--samples": samples})
    job = open_job(scene_path, overrides, output, console)
    writers: dict[str, Callable[[], tuple[list[Path], list[str], dict[str, Any]]]] = {
        "mitsuba": lambda: _mitsuba(job, bands_nm, samples or 256),
        "mcx": lambda: _mcx(job, bands_nm, voxel_um, samples or 1_000_000),
        "nrrd": lambda: _nrrd(job),
        "tiff": lambda: _tiff(job, picture),
    }
    with about(job.scene):
        files, notes, told = writers[program]()
    summary = {
        "program": program,
        **told,
        "notes": notes,
        "seconds": job.clock.seconds,
        "files": [str(path) for path in files],
    }
    rows: list[Row] = [(key.replace("_", " "), str(value)) for key, value in told.items()]
    rows += [("note", note) for note in notes]
    console.result(summary, [*rows, seconds_row(summary["seconds"]), *(("wrote", str(path)) for path in files)])


_READS = {
    "mitsuba": ("--band", "--samples"),
    "mcx": ("--band", "--voxel-um", "--samples"),
    "nrrd": (),
    "tiff": ("--picture",),
}


def _check_options(program: str, given: dict[str, Any]) -> None:
    """Refuse options that the program's writer does not read."""
    for option, value in given.items():
        if value not in (None, ()) and option not in _READS[program]:
            known = ", ".join(name for name, options in _READS.items() if option in options)
            raise InputError(f"{option} is not for {program}", where=option, remedy=f"it is for --to {known}")


def _mitsuba(job: Job, bands_nm: tuple[float, ...], samples: int) -> tuple[list[Path], list[str], dict[str, Any]]:
    from skinrender.export.mitsuba import write_mitsuba
    from skinrender.photonmap.light import light_from_scene

    volume, files, notes = _volume(job), [], {}
    light, bands = light_from_scene(job.scene), _chosen(volume, bands_nm)
    with job.clock.stage("write"):
        for nm in bands:
            done = write_mitsuba(volume, light, job.scene.camera, nm, _band_file(job, nm, ".xml"), samples)
            files += [done.scene, *done.grids]
            notes |= dict.fromkeys(done.notes)
    return files, list(notes), {"bands_nm": bands}


def _mcx(
    job: Job, bands_nm: tuple[float, ...], voxel_um: float | None, photons: int
) -> tuple[list[Path], list[str], dict[str, Any]]:
    from skinrender.export.mcx import write_mcx
    from skinrender.photonmap.light import light_from_scene

    volume, files, notes = _volume(job), [], {}
    light, bands, seed = light_from_scene(job.scene), _chosen(volume, bands_nm), job.scene.photons.seed
    edge_mm = None if voxel_um is None else 1e-3 * voxel_um
    with job.clock.stage("write"):
        for nm in bands:
            done = write_mcx(
                volume, light, nm, _band_file(job, nm, ".json"), edge_mm=edge_mm, photons=photons, seed=seed
            )
            files.append(done.path)
            notes |= dict.fromkeys(done.notes)
    told = {
        "bands_nm": bands,
        "voxels": list(done.shape),
        "voxel_mm": done.edge_mm,
        "labels": done.labels,
        "label_error": done.label_error,
    }
    return files, list(notes), told


def _nrrd(job: Job) -> tuple[list[Path], list[str], dict[str, Any]]:
    from skinrender.export.nrrd import write_nrrd_volume

    volume = _volume(job)
    with job.clock.stage("write"):
        files = write_nrrd_volume(volume, job.out)
    return files, [], {"layers": list(volume.layer_name[1:])}


def _tiff(job: Job, picture: Path | None) -> tuple[list[Path], list[str], dict[str, Any]]:
    from skinrender.export.tiff import write_tiff
    from skinrender.film.camera import image_plane

    picture = picture or job.exr
    if not picture.is_file():
        raise InputError(
            "there is no picture yet", where=str(picture),
            remedy=f"run `skinrender render {job.scene_path}` (with the same -o and --set), or name one by --picture",
        )  # fmt: skip
    camera = job.scene.camera
    extent = image_plane(camera, tuple(job.scene.patch.size_mm))[2]
    path = job.out / f"{picture.stem}.tif"
    with job.clock.stage("write"):
        pages = write_tiff(picture, path, camera.pixels, (extent[0] / camera.pixels[0], extent[1] / camera.pixels[1]))
    return [path], [], {"pages": pages}


def _volume(job: Job) -> SkinVolume:
    """The scene's volume, built if it is not there."""
    from skinrender.cli.current import current_volume
    from skinrender.cli.stages import run_build

    with job.clock.stage("load"):
        volume = current_volume(job)
    return run_build(job) if volume is None else volume


def _chosen(volume: SkinVolume, bands_nm: tuple[float, ...]) -> list[float]:
    """The bands asked for, checked before anything is written."""
    from skinrender.export.grid import band_index

    if bands_nm:
        return [float(volume.wavelength_nm[band_index(volume, nm)]) for nm in dict.fromkeys(bands_nm)]
    return [float(min(volume.wavelength_nm, key=lambda nm: abs(nm - 550.0)))]


def _band_file(job: Job, nm: float, suffix: str) -> Path:
    return job.out / f"{job.scene.name}_{nm:g}nm{suffix}"
