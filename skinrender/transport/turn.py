"""What happens at the collision, and the new direction (the paper's steps 2 and 4).

The collision's 32-bit word decides between scattering, absorption and a null collision by integer thresholds made in
float64: a float32 albedo would be off by up to 6 % of the absorption at 1 - 1e-6. Henyey-Greenstein in the form

    s = (1 - g^2) / (1 - g + 2 g u),   1 - cos = (1 - g) (1 - u) (s + 1 - g) / (1 - g + 2 g u),   sin^2 = v (2 - v)

with v = 1 - cos has no special case for any |g| < 1; the textbook inverse gives cos >= 1 for 6 % of the samples at
g = 0.999 in float32 and 0/0 at g = 0.
"""

from __future__ import annotations

import numpy as np

from skinrender.transport import block_kernel
from skinrender.transport.blockmath import cos_sin_turn
from skinrender.transport.lanes import (
    ABSORB_ABOVE,
    BAND,
    BORDER,
    EMPTY,
    ENDED,
    EVENT,
    FRESH,
    INCOMING,
    LANES,
    SCATTER_BELOW,
    SHOWN,
    STRAIGHT,
    TISSUE,
    UX,
    UY,
    UZ,
    WORDS,
    G,
)
from skinrender.transport.rng import next_word, uniform
from skinrender.transport.tally import BORDER_HITS, COLLISIONS_NULL, PER_LAYER

_ONE, _TWO, _HALF = np.float32(1.0), np.float32(2.0), np.float32(0.5)


@block_kernel
def henyey_greenstein(g, u):
    """(1 - cos, sin) of the scattering angle for a uniform variate u in (0, 1]."""
    spread = _ONE - g + _TWO * g * u
    inverse = _ONE / spread
    s = (_ONE - g * g) * inverse
    v = (_ONE - g) * (_ONE - u) * (s + _ONE - g) * inverse
    v = max(min(v, _TWO), g - g)
    return v, np.sqrt(v * (_TWO - v))


@block_kernel
def deflect(ux, uy, uz, one_minus_cos, sin, cos_azimuth, sin_azimuth):
    """Direction after a deflection; the frame is the branchless one of Duff et al. (2017), without a pole.

    One Newton step keeps the length at 1: without it 1e5 scatterings in float32 drift by 1e-4.
    """
    sign = np.copysign(_ONE, uz)
    a = -_ONE / (sign + uz)
    b = ux * uy * a
    p, q, c = sin * cos_azimuth, sin * sin_azimuth, _ONE - one_minus_cos
    vx = p * (_ONE + sign * ux * ux * a) + q * b + c * ux
    vy = p * (sign * b) + q * (sign + uy * uy * a) + c * uy
    vz = p * (-sign * ux) - q * uy + c * uz
    scale = np.float32(1.5) - _HALF * (vx * vx + vy * vy + vz * vz)
    return vx * scale, vy * scale, vz * scale


@block_kernel
def pack_direction(ux, uy, uz):
    """Octahedral code of a unit vector, 16 + 16 bits in an int32 (Cigolle et al. 2014); error below 7e-5 rad."""
    inverse = _ONE / (abs(ux) + abs(uy) + abs(uz))
    px, py = ux * inverse, uy * inverse
    fold_x = (_ONE - abs(py)) * np.copysign(_ONE, px)
    fold_y = (_ONE - abs(px)) * np.copysign(_ONE, py)
    below = uz < np.float32(0.0)
    px = fold_x if below else px
    py = fold_y if below else py
    ix = np.int32(px * np.float32(32767.0) + np.float32(32768.0))
    iy = np.int32(py * np.float32(32767.0) + np.float32(32768.0))
    return np.int32(np.int32(iy << np.int32(16)) | ix)


@block_kernel
def collide(f, w, n, scatterings, columns):
    """Decides what happens to n lanes; those that scatter get a new direction, the old one packed in INCOMING.

    EVENT is the column that counts it, of `columns` a band, the scatterings of the first tissue layer in column
    `scatterings`. A flight that ended on a border has no collision.
    """
    scatterings, absorptions, columns = np.int32(scatterings), np.int32(PER_LAYER), np.int32(columns)
    zero, one = np.int32(0), np.int32(1)
    for i in range(n):
        r, w0, w1, w2, w3 = next_word(
            w[WORDS + i], w[WORDS + LANES + i], w[WORDS + 2 * LANES + i], w[WORDS + 3 * LANES + i]
        )
        r_polar, w0, w1, w2, w3 = next_word(w0, w1, w2, w3)
        r_azimuth, w0, w1, w2, w3 = next_word(w0, w1, w2, w3)
        w[WORDS + i] = w0
        w[WORDS + LANES + i] = w1
        w[WORDS + 2 * LANES + i] = w2
        w[WORDS + 3 * LANES + i] = w3
        ux, uy, uz = f[UX + i], f[UY + i], f[UZ + i]
        one_minus_cos, sin = henyey_greenstein(f[G + i], uniform(r_polar))
        cos_azimuth, sin_azimuth = cos_sin_turn(np.float32(r_azimuth) * np.float32(2.0**-32))
        vx, vy, vz = deflect(ux, uy, uz, one_minus_cos, sin, cos_azimuth, sin_azimuth)
        w[INCOMING + i] = pack_direction(ux, uy, uz)
        collides = w[BORDER + i] == zero
        scattered = (r < w[SCATTER_BELOW + i]) & collides
        absorbed = (r > w[ABSORB_ABOVE + i]) & collides
        f[UX + i] = vx if scattered else ux
        f[UY + i] = vy if scattered else uy
        f[UZ + i] = vz if scattered else uz
        tissue, fresh = w[TISSUE + i], w[FRESH + i]
        other = np.int32(COLLISIONS_NULL) if collides else np.int32(BORDER_HITS)
        other = np.int32(absorptions + tissue) if absorbed else other
        event = np.int32(scatterings + tissue) if scattered else other
        w[EVENT + i] = np.int32(event + np.int32(columns * w[BAND + i]))
        w[SHOWN + i] = np.int32(np.int32(np.int32(fresh & np.int32(STRAIGHT)) ^ one) if scattered else zero)
        w[FRESH + i] = zero if scattered else fresh
        w[ENDED + i] = one if absorbed | (fresh == np.int32(EMPTY)) else zero
