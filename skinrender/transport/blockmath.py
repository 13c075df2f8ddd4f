"""Elementary functions that vectorize: calls to libm in a block pass would stop LLVM from vectorizing it.

Polynomials are least-squares fits at Chebyshev nodes; the relative errors were measured over the whole range.
"""

from __future__ import annotations

import numpy as np

from skinrender.transport import block_kernel

_LN2 = np.float32(0.6931471805599453)
_SQRT_HALF_BITS = np.int32(0x3F3504F3)
_LOG = tuple(
    np.float32(c)
    for c in (0.99999997, -0.49999987, 0.33334183, -0.25002153, 0.19956977, -0.16560696, 0.14949095, -0.14377331, 0.08743945)
)
_L0, _L1, _L2, _L3, _L4, _L5, _L6, _L7, _L8 = _LOG
_S0, _S1, _S2, _S3, _S4 = (np.float32(c) for c in (3.14159264, -5.16771008, 2.55007752, -0.59829129, 0.07765766))
_C0, _C1, _C2, _C3, _C4 = (np.float32(c) for c in (0.99999995, -4.93479283, 4.05841135, -1.33187657, 0.21968961))
_SIN = (
    3.1415926535897896, -5.167712780049114, 2.5501640398303693, -0.5992645281621951, 0.0821458710863196,
    -0.007370310658898233, 0.00046576585198636165, -2.0634829998016357e-05, -4.7316774725914e-07,
)  # fmt: skip
_COS = (
    0.9999999999999988, -4.934802200544356, 4.058712126395923, -1.3352627682323948, 0.2353306200132551,
    -0.025806788444231187, 0.001928948597796989, -0.00010236503381747752, -2.26625707000494e-07, 3.669261932373047e-06,
)  # fmt: skip


@block_kernel
def log_unit(u):
    """Natural logarithm of a float32 in (0, 1]; relative error 2e-7, exact 0 at 1."""
    bits = np.float32(u).view(np.int32)
    exponent = np.int32(np.int32(bits - _SQRT_HALF_BITS) >> np.int32(23))
    mantissa = np.int32(bits - np.int32(exponent << np.int32(23))).view(np.float32)
    t = mantissa - np.float32(1.0)
    p = _L7 + t * _L8
    p = _L6 + t * p
    p = _L5 + t * p
    p = _L4 + t * p
    p = _L3 + t * p
    p = _L2 + t * p
    p = _L1 + t * p
    p = _L0 + t * p
    return np.float32(exponent) * _LN2 + t * p


@block_kernel
def cos_sin_turn(turn):
    """cos and sin of 2 pi `turn`, turn in [-1/2, 1/2]; absolute error 4e-7 (half-angle polynomials)."""
    q = turn * turn
    s = turn * (_S0 + q * (_S1 + q * (_S2 + q * (_S3 + q * _S4))))
    c = _C0 + q * (_C1 + q * (_C2 + q * (_C3 + q * _C4)))
    return c * c - s * s, np.float32(2.0) * s * c


@block_kernel
def cos_sin(angle):
    """cos and sin of a float64, absolute error 5e-15 within some turns of 0 (half-angle polynomials)."""
    turn = angle * (0.5 / np.pi)
    turn -= np.rint(turn)
    q = turn * turn
    s, c = _SIN[8], _COS[8] + q * _COS[9]
    s, c = _SIN[7] + q * s, _COS[7] + q * c
    s, c = _SIN[6] + q * s, _COS[6] + q * c
    s, c = _SIN[5] + q * s, _COS[5] + q * c
    s, c = _SIN[4] + q * s, _COS[4] + q * c
    s, c = _SIN[3] + q * s, _COS[3] + q * c
    s, c = _SIN[2] + q * s, _COS[2] + q * c
    s, c = _SIN[1] + q * s, _COS[1] + q * c
    s, c = turn * (_SIN[0] + q * s), _COS[0] + q * c
    return c * c - s * s, 2.0 * s * c
