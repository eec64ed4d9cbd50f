"""Floating point grids as whole numbers: equal steps of the value, its inverse, its logarithm."""

from __future__ import annotations

from enum import Enum

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.coding.planes import Mask
from ftp_dent_ros.errors import CodecError

# Whole numbers beyond it are not differenced without loss of their sign.
_LARGEST = 2**29
# 2^(k/4), written out: powers are not the same on every machine.
_PARTS = 4
_POWERS = np.array([1.0, 1.189207115002721, 1.4142135623730951, 1.681792830507429])
# Halfway between them: the mantissas of float32 (23 bits) from which on the next one is nearer,
# those of 2^(1/8), 2^(3/8), 2^(5/8), 2^(7/8).
_NEXT = 759234, 2490071, 4548395, 6996167
_MANTISSA, _BITS, _BIAS = (1 << 23) - 1, 23, 127


class Scale(str, Enum):
    """What has equal steps; those of the logarithm are a quarter of an octave: 9 % off at most."""

    LINEAR = 'linear'
    INVERSE = 'inverse'
    LOGARITHM = 'logarithm'


def quantise(
    values: NDArray[np.float32], mask: Mask, scale: Scale, step: float
) -> NDArray[np.int32]:
    """Nearest whole numbers of steps; where the mask is false, what is easily predicted.

    Parameters
    ----------
    values : ndarray, shape (rows, columns)
        Finite where the mask is true; with `Scale.INVERSE` not 0, with `Scale.LOGARITHM`
        positive (and below 1e-38 taken for that).
    mask : Mask
    scale : Scale
    step : float
        In the unit of the value or of its inverse; of no meaning to `Scale.LOGARITHM`.

    Raises
    ------
    CodecError
        A step is too small for the values.
    """
    there = np.where(mask.where, values, np.float32(1))
    if scale is Scale.LOGARITHM:
        return mask.fill(_quarters(there))
    if scale is Scale.INVERSE:
        steps = np.reciprocal(there, dtype=np.float64)
        steps /= step
    else:
        steps = np.divide(there, step, dtype=np.float64)
    np.rint(steps, out=steps)
    # All places are of values, or of 1.
    if not (steps.max(initial=0.0) < _LARGEST and steps.min(initial=0.0) > -_LARGEST):
        raise CodecError(f'a step of {step:g} is too small for the values: choose a larger one')
    return mask.fill(steps.astype(np.int32))


def _quarters(values: NDArray[np.float32]) -> NDArray[np.int32]:
    """Four times the logarithm to base 2, rounded, out of the numbers' own bits."""
    bits = np.ascontiguousarray(values, np.float32).view(np.int32)
    mantissa = bits & np.int32(_MANTISSA)
    parts = np.zeros(bits.shape, np.uint8)
    for least in _NEXT:
        parts += mantissa >= least
    return ((bits >> _BITS) - _BIAS) * _PARTS + parts


def restore(steps: NDArray[np.int32], scale: Scale, step: float) -> NDArray[np.float32]:
    """Values of `quantise`'s whole numbers, shape (rows, columns); inf for an inverse of 0."""
    if scale is Scale.LOGARITHM:
        power = _POWERS.astype(np.float32)[steps & (_PARTS - 1)]
        return np.ldexp(power, np.clip(steps >> 2, -120, 120))
    with np.errstate(divide='ignore', over='ignore'):
        values = steps * np.float64(step)
        if scale is Scale.INVERSE:
            np.reciprocal(values, out=values)
        return values.astype(np.float32)
