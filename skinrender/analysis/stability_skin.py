"""Extremes of skin: nothing but blood, nothing but melanin, none of either; all layers, relief and wave."""

from __future__ import annotations

from typing import Any

from skinrender.analysis.stability_case import Case
from skinrender.analysis.stability_judges import judged, pictures_agree, reflects_as_its_index
from skinrender.analysis.stability_scenes import NORMAL
from skinrender.skin.anatomy import DERMIS, EPIDERMIS

ALL = (*EPIDERMIS, *DERMIS, "subcutis")
FLAT = {"relief": {"kind": "flat"}}


def skin(changes: dict[str, dict[str, float]], bands_nm: list[float], **sections: Any) -> dict[str, Any]:
    """A piece of forearm."""
    flat = {"peak_to_valley_um": 0}
    return {
        "patch": {"size_mm": [1.0, 1.0], "columns": [16, 16]},
        "bands_nm": bands_nm,
        "skin": {"layers": changes, "border_wave": flat if sections.get("relief") else {}},
        "light": NORMAL,
        "camera": {"pixels": [8, 8]},
        **sections,
    }


CASES = (
    Case(
        "pure blood in the dermis",
        "absorption of 280 per mm at 414 and 433 nm beside 0.1 at 690 nm",
        [skin({name: {"blood": 1.0} for name in DERMIS}, [414, 433, 690], **FLAT)],
        judged(reflects_as_its_index, pictures_agree),
    ),
    Case(
        "melanin 100 % in the epidermis",
        "170 per mm in the first free path; roulette by depth; nothing comes back",
        [skin({name: {"melanosome": 1.0} for name in EPIDERMIS}, [380, 580, 780], **FLAT)],
        judged(reflects_as_its_index, pictures_agree),
    ),
    Case(
        "neither melanin nor blood",
        "albedo above 0.999 through 4.4 mm",
        [skin({name: {"melanosome": 0.0, "blood": 0.0} for name in ALL}, [380, 780], **FLAT)],
        judged(reflects_as_its_index, pictures_agree),
    ),
    Case(
        "relief and wave, camera and light at 85 degrees",
        "furrows seen along their walls; rays that miss; re-entry",
        [
            skin({}, [450, 650], light={**NORMAL, "zenith_deg": 85.0}, camera={"pixels": [8, 8], "zenith_deg": 85.0}),
            skin({}, [550], light={"kind": "sky", "spectrum": "E"}),
        ],
        lambda outcomes: [],
    ),
    Case(
        "melanin 100 % and pure blood under relief",
        "the strongest absorption where voxels are cut by furrows",
        [skin({**{n: {"melanosome": 1.0} for n in EPIDERMIS}, **{n: {"blood": 1.0} for n in DERMIS}}, [380, 433, 780])],
        lambda outcomes: [],
    ),
)
