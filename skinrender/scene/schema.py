"""The scene: every key that a scene file may hold. The descriptions are the scene reference."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, PrivateAttr, model_validator

from skinrender.scene.problems import Places, nearest_mark
from skinrender.scene.schema_base import Flag, Part, Seed, Text, whole
from skinrender.scene.schema_camera import Camera, Finish, OrthographicCamera
from skinrender.scene.schema_lesion import Lesion
from skinrender.scene.schema_light import Light, PointLight
from skinrender.scene.schema_relief import Relief
from skinrender.scene.schema_skin import BandRange, Bands, Below, Outside, Patch, Skin, Slab, band_wavelengths

StoredCount = whole(1, 10**13)
GatherCount = whole(1, 10**9)
Subpixels = whole(1, 64)


class Photons(Part):
    """The photon pass."""

    stored: StoredCount = Field(
        10_000_000, description="photons to store; the pass stops after the round that reaches it"
    )
    seed: Seed = Field(1, description="seed of the photons' histories")
    roulette: Flag = Field(True, description="store fewer of the photons that hardly show, with a higher weight")
    wavelengths: Literal["uniform", "visible"] = Field(
        "uniform",
        description="as many histories in every band, or more in the bands by which a picture has its color: two "
        "thirds of the time to the same noise of luminance and color, half as much noise again in the deep red",
    )


class Estimate(Part):
    """The radiance estimate."""

    method: Literal["beam", "point", "reference"] = Field("beam", description="how radiance is estimated")
    gather_count: GatherCount | None = Field(
        None,
        description="photons that a beam or sample point should meet, on average; null = the widest kernel that keeps the "
        "picture sharp",
    )
    subpixels: Subpixels | None = Field(
        None, description="rays along each side of a pixel for the surface's reflection; null = as many as it needs"
    )


class Scene(Part):
    """A piece of skin or a slab, its light, its camera, and how it is computed."""

    name: Annotated[Text, Field(min_length=1, max_length=100, pattern=r"^[^/\\\x00-\x1f]*[^/\\\x00-\x1f.]$")] = Field(
        "scene", description="name of the output folder; left out = the file's name"
    )
    description: Text = Field("", description="what the scene shows")
    patch: Patch = Field(description="the piece of skin: size and voxel columns")
    bands_nm: Bands = Field(
        BandRange(), description="wavelength bands: {start, stop, step} or an ascending list of at most 255"
    )
    skin: Skin | None = Field(None, description="skin of a body site (a scene has either skin or slab)")
    slab: Slab | None = Field(None, description="layers of given optics (a scene has either skin or slab)")
    relief: Relief = Field(
        None, validate_default=True, description="shape of the surface; left out = the site's for skin, flat for a slab"
    )
    outside: Outside = Field(Outside(), description="the medium above")
    below: Below = Field(Below(), description="the medium below")
    sides: Literal["periodic", "open", "dielectric"] = Field(
        "periodic",
        description="what happens at the patch's sides: go on at the opposite side, leave, or the faces of a free block",
    )
    inner_borders: Literal["auto", "fresnel", "matched"] = Field(
        "auto", description="reflection and refraction between layers; auto = for slabs of flat borders only"
    )
    lesions: Annotated[tuple[Lesion, ...], Field(max_length=64)] = Field((), description="lesions, applied in order")
    light: Light = Field(PointLight(), description="the light")
    camera: Camera = Field(OrthographicCamera(), description="the camera")
    finish: Finish = Field(Finish(), description="how the surface reflects")
    photons: Photons = Field(Photons(), description="the photon pass")
    estimate: Estimate = Field(Estimate(), description="the radiance estimate")

    _source_dir: Path = PrivateAttr(default=Path("."))
    _places: Places = PrivateAttr(default=Places())

    @model_validator(mode="before")
    @classmethod
    def _default_relief(cls, data: Any) -> Any:
        if isinstance(data, dict) and data.get("relief") is None:
            return {**data, "relief": {"kind": "procedural" if data.get("skin") is not None else "flat"}}
        return data

    def model_post_init(self, context: Any) -> None:
        if context:
            self._source_dir, self._places = Path(context["source_dir"]), Places(context["marks"])

    @property
    def source_dir(self) -> Path:
        """Folder that relative files of the scene are looked for in."""
        return self._source_dir

    @property
    def wavelength_nm(self) -> tuple[float, ...]:
        """Wavelengths of the bands, ascending."""
        return band_wavelengths(self.bands_nm)

    def place(self, key: Sequence[str | int]) -> str | None:
        """``file:line:col`` of a value, or of the nearest section around it; None where the scene has no file."""
        mark = nearest_mark(tuple(map(str, key)), self._places.marks)
        return None if mark is None else str(mark)

    def path(self, file: str) -> Path:
        """Place of a file that the scene names, relative to the scene file."""
        return self._source_dir / file


def json_schema() -> dict[str, Any]:
    """JSON Schema of a scene file, for editors."""
    schema = Scene.model_json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
