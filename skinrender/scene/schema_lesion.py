"""Lesions: melanin or ink added by a pattern image (macules: paper, sections 5 and 6; moles, tattoos)."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from skinrender.scene.schema_base import MAX_LENGTH_MM, Fraction, LengthMm, Number, Part, Text, mistake, whole

# The inks that the optics package has a table for.
INKS = ("carbon_black", "red", "blue", "green")

Pattern = Annotated[
    Text,
    Field(min_length=1, description="gray PNG beside the scene file, one pixel a voxel column; black = most melanin or ink"),
]
VoxelLayers = whole(1, 10_000)
CenterLayer = whole(1, 10_000)
HalfLayers = whole(0, 10_000)
MelaninScale = Annotated[Fraction, Field(description="melanosome fraction that black stands for")]


class EpidermalMacule(Part):
    """Melanin added to the basal layer and, falling off upwards, to the layers above it."""

    kind: Literal["epidermal"]
    pattern: Pattern
    melanin_scale: MelaninScale = 1.0


class DermalMacule(Part):
    """Melanin added around one voxel layer of the dermis, as thick as the pattern is dark."""

    kind: Literal["dermal"]
    pattern: Pattern
    melanin_scale: MelaninScale = 1.0
    center_layer: CenterLayer = Field(
        description="voxel layer in the middle, counted from 1 at the bottom of the reticular layer upwards"
    )
    half_layers: HalfLayers = Field(description="voxel layers that black adds on each side of the middle one")


class Mole(Part):
    """Melanin added to the epidermis as by a macule, and to nests that reach down into the dermis."""

    kind: Literal["mole"]
    pattern: Pattern
    melanin_scale: MelaninScale = 1.0
    depth_mm: LengthMm | None = Field(
        None, description="how far below the top of the dermis the nests under black reach; or give depth_layers"
    )
    depth_layers: VoxelLayers | None = Field(
        None, description="the same in voxel layers, counted from 1 at the top of the dermis downwards"
    )
    dermal_share: Fraction = Field(
        0.3, description="melanin of the uppermost nests relative to what the basal layer gains; it falls to 0 at the depth"
    )

    @model_validator(mode="after")
    def _check(self) -> Mole:
        if (self.depth_mm is None) == (self.depth_layers is None):
            raise mistake("a mole needs either depth_mm or depth_layers; give one of them")
        return self


def _downwards(depth_mm: tuple[float, float]) -> tuple[float, float]:
    if depth_mm[1] <= depth_mm[0]:
        raise mistake(f"got {list(depth_mm)}; the upper depth comes first and must be the smaller one: [top, bottom]")
    return depth_mm


DepthMm = Annotated[Number, Field(ge=0, le=MAX_LENGTH_MM)]


class Tattoo(Part):
    """Ink in the dermis, with an absorption spectrum of its own."""

    kind: Literal["tattoo"]
    pattern: Pattern
    ink: Annotated[Text, Field(min_length=1)] = Field(
        "carbon_black",
        description="ink (" + ", ".join(INKS) + ") or a CSV file (wavelength_nm,mu_a_per_mm at volume fraction 1)",
    )
    volume_fraction: Fraction = Field(description="volume fraction of ink that black stands for")
    depth_mm: Annotated[tuple[DepthMm, DepthMm], AfterValidator(_downwards)] | None = Field(
        None, description="top and bottom of the ink below the top of the dermis; or give center_layer and half_layers"
    )
    center_layer: CenterLayer | None = Field(
        None, description="voxel layer in the middle, counted from 1 at the bottom of the reticular layer upwards"
    )
    half_layers: HalfLayers | None = Field(None, description="voxel layers of ink on each side of the middle one")

    @model_validator(mode="after")
    def _check(self) -> Tattoo:
        layers = (self.center_layer, self.half_layers)
        if (layers == (None, None)) == (self.depth_mm is None) or (None in layers and layers != (None, None)):
            raise mistake("a tattoo needs either depth_mm, or center_layer and half_layers; give one or the other")
        return self


Lesion = Annotated[EpidermalMacule | DermalMacule | Mole | Tattoo, Field(discriminator="kind")]
