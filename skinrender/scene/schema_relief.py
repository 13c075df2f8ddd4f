"""The shape of the skin's surface."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from skinrender.scene.schema_base import LengthMm, Number, Part, Positive, Seed, Text, default_kind, mistake, whole

HEIGHT_IMAGES = (".png", ".tif", ".tiff")


class FlatRelief(Part):
    """A plane surface."""

    kind: Literal["flat"]


class FurrowFamily(Part):
    """Parallel furrows of one direction."""

    angle_deg: Annotated[Number, Field(ge=-360, le=360)] = Field(description="direction of the furrows from the x axis")
    spacing_mm: LengthMm = Field(description="mean distance between furrows")
    depth_um: Annotated[Number, Field(ge=0, le=2000)] = Field(description="mean depth of a furrow")
    width_um: Annotated[Number, Field(gt=0, le=1e5)] = Field(description="mean width of a furrow")


Samples = whole(4, 8192)


class ProceduralRelief(Part):
    """Furrows and noise drawn from a seed."""

    kind: Literal["procedural"] = "procedural"
    families: tuple[FurrowFamily, ...] | None = Field(
        None, description="families of furrows; left out = those of the skin's site"
    )
    age_years: Annotated[Number, Field(ge=0, le=120)] = Field(
        30.0, description="age of the skin: from 30 years on furrows grow fewer, from 40 on deeper"
    )
    anisotropy: Annotated[Number, Field(ge=0, le=0.9)] | None = Field(
        None,
        description="share of their depth that the furrows of the lesser directions have lost, or how much longer than wide "
        "a cheek's polygons are, 1/(1 - a); left out = that of the age",
    )
    noise_um: Annotated[Number, Field(ge=0, le=1000)] = Field(
        2.0, description="standard deviation of the fine roughness added to the furrows"
    )
    seed: Seed = Field(1, description="seed of the furrows' places and the noise")
    samples: tuple[Samples, Samples] | None = Field(
        None, description="samples of the height field along x and y; left out = as many as the furrows need"
    )

    @model_validator(mode="after")
    def _check(self) -> ProceduralRelief:
        aged = {"age_years", "anisotropy"} & self.model_fields_set
        if self.families is not None and aged:
            raise mistake(f"{min(aged)} has no effect on families that are given; remove it")
        return self


def _ascending_range(range_um: tuple[float, float]) -> tuple[float, float]:
    if range_um[1] <= range_um[0]:
        raise mistake(f"got {list(range_um)}; the first height must be the lower one: [of black, of white]")
    return range_um


HeightUm = Annotated[Number, Field(ge=-1e4, le=1e4)]


class HeightMapRelief(Part):
    """A measured surface; heights point outwards (up from the skin)."""

    kind: Literal["height_map"]
    file: Text = Field(description="8 or 16 bit gray PNG or TIFF, or .npy, beside the scene file")
    range_um: Annotated[tuple[HeightUm, HeightUm], AfterValidator(_ascending_range)] | None = Field(
        None, description="heights that black and white stand for, of an image"
    )
    um_per_unit: Positive | None = Field(None, description="height of one unit, of a .npy array")

    @model_validator(mode="after")
    def _check(self) -> HeightMapRelief:
        suffix = "." + self.file.rpartition(".")[2].lower()
        if suffix == ".npy":
            needed, other = "um_per_unit", "range_um"
        elif suffix in HEIGHT_IMAGES:
            needed, other = "range_um", "um_per_unit"
        else:
            raise mistake(f"the file '{self.file}' is of an unknown kind; allowed: {', '.join(HEIGHT_IMAGES)}, .npy")
        if getattr(self, needed) is None:
            raise mistake(f"a {suffix} file needs {needed}; add it")
        if getattr(self, other) is not None:
            raise mistake(f"{other} has no effect on a {suffix} file; remove it")
        return self


Relief = Annotated[
    FlatRelief | ProceduralRelief | HeightMapRelief, Field(discriminator="kind"), default_kind("procedural")
]
