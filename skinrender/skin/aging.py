"""What age does to the relief: fewer, deeper furrows, and one direction of them left.

- Depth of the forearm's furrows is level to 40 years and then rises, to more than twice that at 80; their number a
  centimeter falls meanwhile (P. Corcuff et al., J. Soc. Cosmet. Chem. 34 (1983), 177). Here: 1 to 2.2 from 40 to 80
  years, and half the number from 30 to 80.
- The furrows of all but one direction flatten (J. M. Lagarde et al., Skin Res. Technol. 11 (2005), 110). Here: from
  equal at 30 years to 60 % shallower at 80.
- Of all sites of the face the cheek's relief depends on age the least (Y. Takema et al., J. Dermatol. Sci. 15 (1997),
  55). Here: half as much.

The directions are measured, the straight lines between two ages are assumed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

YOUNG_YEARS = 30.0
_DEEPER_FROM, _OLD = 40.0, 80.0
_DEPTH_AT_OLD = 2.2
_DENSITY_AT_OLD = 0.5
_ANISOTROPY_AT_OLD = 0.6
SHARE = {"forearm": 1.0, "cheek": 0.5}


@dataclass(frozen=True)
class Aging:
    """Factors of a relief.

    Parameters
    ----------
    depth, spacing : on those of young skin; furrows widen as they deepen.
    anisotropy : share of their depth that furrows of the lesser directions have lost.
    """

    depth: float
    spacing: float
    anisotropy: float


YOUNG = Aging(depth=1.0, spacing=1.0, anisotropy=0.0)


def aging(site: str, age_years: float, anisotropy: float | None = None) -> Aging:
    """The relief of a site at an age; an anisotropy that is given replaces that of the age."""
    share = SHARE[site]
    deeper = share * (_DEPTH_AT_OLD - 1) * np.interp(age_years, [_DEEPER_FROM, _OLD], [0, 1])
    since_young = share * np.interp(age_years, [YOUNG_YEARS, _OLD], [0, 1])
    if anisotropy is None:
        anisotropy = _ANISOTROPY_AT_OLD * since_young
    return Aging(float(1 + deeper), float(1 / (1 - (1 - _DENSITY_AT_OLD) * since_young)), float(anisotropy))
