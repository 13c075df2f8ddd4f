"""Macules: melanin added by a pattern image (paper, sections 5 and 6)."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from skinrender.scene.schema_base import Fraction, Part, Text, whole

Pattern = Annotated[
    Text,
    Field(min_length=1, description="grey PNG beside the scene file, one pixel a voxel column; black = most melanin"),
]
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


Lesion = Annotated[EpidermalMacule | DermalMacule, Field(discriminator="kind")]
