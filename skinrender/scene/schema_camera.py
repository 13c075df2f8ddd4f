"""The camera, and the finish of the surface that it sees."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from skinrender.scene.schema_base import (
    Azimuth,
    Flag,
    Fraction,
    LengthMm,
    Number,
    Part,
    Pixels,
    Positive,
    Zenith,
    default_kind,
)


class _View(Part):
    pixels: tuple[Pixels, Pixels] = Field((200, 200), description="width and height of the image")
    center_mm: tuple[Number, Number] | None = Field(
        None, description="x and y of the point the camera looks at; left out = the patch's center"
    )
    window_mm: tuple[LengthMm, LengthMm] | None = Field(
        None, description="what the image spans in the plane through the center; left out = the whole patch"
    )
    zenith_deg: Zenith = Field(0.0, description="angle between the line of sight and the surface's normal")
    azimuth_deg: Azimuth = Field(0.0, description="direction the camera stands in, from the x axis towards y")
    cross_polarized: Flag = Field(False, description="leave out the light reflected by the surface")


class OrthographicCamera(_View):
    """A camera of parallel lines of sight."""

    kind: Literal["orthographic"] = "orthographic"


class PerspectiveCamera(_View):
    """A pinhole camera."""

    kind: Literal["perspective"]
    distance_mm: Annotated[Positive, Field(le=1e7)] = Field(description="distance from the pinhole to the center")


Camera = Annotated[OrthographicCamera | PerspectiveCamera, Field(discriminator="kind"), default_kind("orthographic")]


class Finish(Part):
    """How the surface reflects."""

    roughness: Annotated[Number, Field(gt=0, le=1)] = Field(0.35, description="microfacet roughness alpha")
    oil: Fraction = Field(0.0, description="share of the reflection that a smooth film of oil takes over")
