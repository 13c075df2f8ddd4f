"""What is lit: the patch, its bands, skin by site preset or a slab by its optics, and what lies around."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Literal, get_args

from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from skinrender.scene.schema_base import (
    FIRST_NM,
    LAST_NM,
    MAX_BANDS,
    MIN_VOXEL_MM,
    Anisotropy,
    Coefficient,
    Fraction,
    LengthMm,
    Number,
    Part,
    Pixels,
    RefractiveIndex,
    Text,
    mistake,
    whole,
)

Site = Literal["forearm", "cheek"]
Tone = Literal["very_light", "light", "intermediate", "tan", "brown"]
LayerName = Literal[
    "stratum_corneum",
    "granular_spinous",
    "basal",
    "papillary",
    "subpapillary",
    "upper_plexus",
    "reticular",
    "lower_plexus",
    "subcutis",
]
LAYER_NAMES: tuple[str, ...] = get_args(LayerName)
VoxelLayers = whole(1, 10_000)


class Patch(Part):
    """The rendered piece of skin, seen from above."""

    size_mm: tuple[LengthMm, LengthMm] = Field(description="width (x) and height (y) of the patch")
    columns: tuple[Pixels, Pixels] = Field(
        description="voxel columns along x and y; a pattern image has this many pixels"
    )


Wavelength = Annotated[Number, Field(ge=FIRST_NM, le=LAST_NM)]


class BandRange(Part):
    """Evenly spaced wavelength bands."""

    start: Wavelength = Field(FIRST_NM, description="first wavelength in nm")
    stop: Wavelength = Field(LAST_NM, description="last wavelength in nm; the last band does not lie beyond it")
    step: Annotated[Number, Field(gt=0)] = Field(5.0, description="distance between bands in nm")

    @model_validator(mode="after")
    def _check(self) -> BandRange:
        if self.stop < self.start:
            raise mistake(f"stop ({self.stop:g}) lies before start ({self.start:g}); exchange them")
        if (self.stop - self.start) / self.step >= MAX_BANDS:
            raise mistake(f"a step of {self.step:g} nm makes more than {MAX_BANDS} bands; use a longer step")
        return self


def _ascending(wavelengths: tuple[float, ...]) -> tuple[float, ...]:
    for first, second in pairwise(wavelengths):
        if second <= first:
            raise mistake(f"the wavelengths must ascend, but {second:g} follows {first:g}; sort the list")
    return wavelengths


BandList = Annotated[tuple[Wavelength, ...], Field(min_length=1, max_length=MAX_BANDS), AfterValidator(_ascending)]
Bands = Annotated[
    Annotated[BandRange, Tag("range")] | Annotated[BandList, Tag("list")],
    Discriminator(lambda given: "list" if isinstance(given, (list, tuple)) else "range"),
]


class LayerOverride(Part):
    """Values that replace a layer's preset; what is left out stays as the site has it."""

    thickness_um: Annotated[Number, Field(ge=1e-3, le=1e6)] | None = Field(None, description="thickness of the layer")
    voxel_layers: VoxelLayers | None = Field(None, description="number of voxel layers the layer is divided into")
    melanosome: Fraction | None = Field(None, description="volume fraction of melanosomes")
    blood: Fraction | None = Field(None, description="volume fraction of blood")
    saturation: Fraction | None = Field(None, description="oxygen saturation of the blood")
    vessel_radius_um: Annotated[Number, Field(ge=0, le=1e4)] | None = Field(
        None, description="mean vessel radius, for the blood's self-shading (0 = none)"
    )
    water: Fraction | None = Field(None, description="volume fraction of water in the bloodless tissue")
    fat: Fraction | None = Field(None, description="volume fraction of fat in the bloodless tissue")
    refractive_index: RefractiveIndex | None = Field(
        None, description="refractive index: a number or a table wavelength_nm: value"
    )
    mu_a_per_mm: Coefficient | None = Field(
        None,
        description="absorption coefficient in place of that of blood, water, fat and the layer's own melanin: a number or a table",
    )
    mu_s_per_mm: Coefficient | None = Field(None, description="scattering coefficient: a number or a table")
    g: Anisotropy | None = Field(
        None, description="mean cosine of the scattering angle: a number or a table; alone, it keeps mu_s (1 - g)"
    )

    @model_validator(mode="after")
    def _check(self) -> LayerOverride:
        if (self.water or 0) + (self.fat or 0) > 1:
            raise mistake(f"water ({self.water:g}) and fat ({self.fat:g}) add up to more than 1; lower one of them")
        if self.mu_a_per_mm is not None:
            composition = ("blood", "saturation", "vessel_radius_um", "water", "fat")
            without_effect = [key for key in composition if getattr(self, key) is not None]
            if without_effect:
                raise mistake(
                    f"mu_a_per_mm leaves no effect to {', '.join(without_effect)}; remove the one or the other"
                )
        return self


class BorderWave(Part):
    """The wave of the border between epidermis and dermis."""

    peak_to_valley_um: Annotated[Number, Field(ge=0, le=1000)] | None = Field(
        None, description="height of the wave from valley to peak; 0 = flat; left out = the site's"
    )
    period_um: Annotated[Number, Field(gt=0, le=1e5)] | None = Field(
        None, description="distance from peak to peak; left out = the site's"
    )


class Skin(Part):
    """Skin of a body site, with changes layer by layer."""

    site: Site = Field("forearm", description="the preset that gives every layer its thickness and composition")
    tone: Tone | None = Field(
        None,
        description="class of individual typology angle: changes the preset's melanin and blood; left out = the "
        "Japanese mean of the site",
    )
    pheomelanin: Fraction | None = Field(
        None,
        description="share of the melanosomes, a lesion's too, that holds pheomelanin, which absorbs as nm^-4.75, and not "
        "eumelanin (nm^-3.33); left out = the tone's, without a tone 0",
    )
    layers: dict[LayerName, LayerOverride] = Field(
        default_factory=dict,
        description="changes to the preset, by layer name",
        json_schema_extra={"propertyNames": {"enum": list(LAYER_NAMES)}},
    )
    border_wave: BorderWave = Field(BorderWave(), description="wave of the border between epidermis and dermis")


class SlabLayer(Part):
    """One layer of a slab, by its optics alone."""

    name: Annotated[Text, Field(min_length=1, max_length=64)] | None = Field(
        None, description="name in tables; left out = layer_1, layer_2, … from the top"
    )
    thickness_mm: Annotated[Number, Field(ge=1e-9, le=1e5)] = Field(description="thickness of the layer")
    mu_a_per_mm: Coefficient = Field(description="absorption coefficient: a number or a table wavelength_nm: value")
    mu_s_per_mm: Coefficient = Field(description="scattering coefficient: a number or a table")
    g: Anisotropy = Field(description="mean cosine of the scattering angle: a number or a table")
    refractive_index: RefractiveIndex = Field(description="refractive index: a number or a table")
    voxel_layers: VoxelLayers = Field(1, description="number of voxel layers the layer is divided into")

    @model_validator(mode="after")
    def _check(self) -> SlabLayer:
        if self.thickness_mm < MIN_VOXEL_MM * self.voxel_layers:
            raise mistake(f"{self.voxel_layers} voxel layers in {self.thickness_mm:g} mm are too thin; use fewer")
        return self


class Slab(Part):
    """A stack of layers of given optics, in place of skin."""

    layers: Annotated[tuple[SlabLayer, ...], Field(min_length=1, max_length=254)] = Field(
        description="layers from the lit side down"
    )

    @property
    def layer_names(self) -> tuple[str, ...]:
        """Names from the top; an unnamed layer is called by its number."""
        return tuple(layer.name or f"layer_{i}" for i, layer in enumerate(self.layers, start=1))

    @model_validator(mode="after")
    def _check(self) -> Slab:
        names = self.layer_names
        for name in names:
            if names.count(name) > 1:
                raise mistake(f"two layers are named '{name}'; give each a name of its own")
        if "air" in names:
            raise mistake("a layer is named 'air', which is the name of the space above; give it another name")
        return self


class Outside(Part):
    """The medium above the surface."""

    refractive_index: RefractiveIndex = Field(1.0, description="refractive index: a number or a table")


class Below(Part):
    """The medium under the lowest layer."""

    refractive_index: RefractiveIndex | None = Field(
        None, description="refractive index: a number or a table; null = as the lowest layer"
    )


def band_wavelengths(bands: Any) -> tuple[float, ...]:
    """Wavelengths in nm of the bands, ascending."""
    if not isinstance(bands, BandRange):
        return tuple(bands)
    # The sum of steps may miss `stop` by rounding.
    count = int((bands.stop - bands.start) / bands.step * (1 + 1e-12) + 1e-9) + 1
    return tuple(round(bands.start + i * bands.step, 9) for i in range(count))
