"""The light: its kind, place, power and spectrum."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from skinrender.scene.schema_base import Azimuth, Number, Part, Text, Zenith, default_kind

# The CIE illuminants that the optics package has tables or formulas for.
ILLUMINANTS = (
    "D65",
    "A",
    "E",
    "D50",
    "LED-B1",
    "LED-B2",
    "LED-B3",
    "LED-B4",
    "LED-B5",
    "LED-BH1",
    "LED-RGB1",
    "LED-V1",
    "LED-V2",
)

Power = Annotated[Number, Field(ge=1e-30, le=1e30)]
PositionMm = tuple[Number, Number]
Spectrum = Annotated[
    Text,
    Field(
        description="CIE illuminant (" + ", ".join(ILLUMINANTS) + ") or a CSV file (wavelength_nm,value) "
        "that shares the light's total over the scene's bands"
    ),
]


class PointLight(Part):
    """A lamp that shines alike in all directions."""

    kind: Literal["point"] = "point"
    height_mm: Annotated[Number, Field(ge=1e-3, le=1e7)] = Field(100.0, description="height above the mean surface")
    position_mm: PositionMm | None = Field(None, description="x and y of the lamp; left out = above the patch's center")
    intensity_W_per_sr: Power = Field(1000.0, description="radiant intensity, total of the scene's bands")
    spectrum: Spectrum = "D65"


class CollimatedLight(Part):
    """Parallel light: on the whole patch, on a disc, or a pencil."""

    kind: Literal["collimated"]
    zenith_deg: Zenith = Field(0.0, description="angle between the beam and the surface's normal")
    azimuth_deg: Azimuth = Field(0.0, description="direction the light comes from, from the x axis towards y")
    radius_mm: Annotated[Number, Field(ge=0, le=1e4)] | None = Field(
        None, description="radius of the beam; 0 = pencil; left out = the whole patch"
    )
    position_mm: PositionMm | None = Field(
        None, description="where the beam's axis meets the mean surface; left out = the patch's center"
    )
    irradiance_W_per_mm2: Power = Field(
        1.0, description="irradiance on a plane across the beam, total of the scene's bands"
    )
    power_W: Power = Field(1.0, description="power of a pencil (radius_mm: 0), total of the scene's bands")
    spectrum: Spectrum = "D65"


class SkyLight(Part):
    """Light of the same radiance from every direction above."""

    kind: Literal["sky"]
    radiance_W_per_mm2_sr: Power = Field(1.0, description="radiance, total of the scene's bands")
    spectrum: Spectrum = "D65"


Light = Annotated[PointLight | CollimatedLight | SkyLight, Field(discriminator="kind"), default_kind("point")]
