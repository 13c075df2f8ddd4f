"""The parts every section of the scene is made of: the model base, number types, coefficients by wavelength."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Discriminator, Field, Tag
from pydantic_core import PydanticCustomError

FIRST_NM = 380.0
LAST_NM = 780.0
MAX_BANDS = 255
MAX_COEFFICIENT_PER_MM = 1e6
MIN_LENGTH_MM = 1e-3
MAX_LENGTH_MM = 1e4
MIN_VOXEL_MM = 1e-10


class Part(BaseModel):
    """A section of the scene: frozen, with no keys but its own."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def mistake(text: str) -> PydanticCustomError:
    """A validator's own message, shown to the user as it is."""
    return PydanticCustomError("scene", "{text}", {"text": text})


def _whole(value: Any) -> Any:
    """Let 1e7 stand for a whole number."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


def whole(lowest: int, highest: int) -> Any:
    """A whole number within bounds."""
    return Annotated[int, Field(strict=True, ge=lowest, le=highest), BeforeValidator(_whole)]


def default_kind(kind: str) -> BeforeValidator:
    """Let a section without the key `kind` be of its usual kind."""

    def fill(value: Any) -> Any:
        return {"kind": kind, **value} if isinstance(value, dict) else value

    return BeforeValidator(fill)


Number = Annotated[float, Field(strict=True)]
Positive = Annotated[Number, Field(gt=0)]
Fraction = Annotated[Number, Field(ge=0, le=1)]
Text = Annotated[str, Field(strict=True)]
Flag = Annotated[bool, Field(strict=True)]
Seed = whole(0, 2**63 - 1)
LengthMm = Annotated[Number, Field(ge=MIN_LENGTH_MM, le=MAX_LENGTH_MM)]
Zenith = Annotated[Number, Field(ge=0, lt=90)]
Azimuth = Annotated[Number, Field(ge=-360, le=360)]
Pixels = whole(1, 8192)


def _sorted_table(table: dict[float, float]) -> dict[float, float]:
    return dict(sorted(table.items()))


# Wavelengths are lax: a table read back from JSON has text keys.
_WavelengthKey = Annotated[float, Field(ge=100, le=3000)]


def _by_wavelength(value: Any) -> Any:
    """A number, or a table wavelength_nm -> number, interpolated linearly."""
    table = Annotated[dict[_WavelengthKey, value], Field(min_length=1), AfterValidator(_sorted_table), Tag("table")]
    return Annotated[
        Annotated[value, Tag("number")] | table,
        Discriminator(lambda given: "table" if isinstance(given, dict) else "number"),
    ]


Coefficient = _by_wavelength(Annotated[Number, Field(ge=0, le=MAX_COEFFICIENT_PER_MM)])
Anisotropy = _by_wavelength(Annotated[Number, Field(gt=-1, lt=1)])
RefractiveIndex = _by_wavelength(Annotated[Number, Field(ge=1, le=3)])
