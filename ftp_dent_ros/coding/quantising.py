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
        positive.
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
        steps = np.log2(there).astype(np.float64) * _PARTS
    elif scale is Scale.INVERSE:
        steps = np.reciprocal(there, dtype=np.float64)
        steps /= step
    else:
        steps = np.divide(there, step, dtype=np.float64)
    np.rint(steps, out=steps)
    # All places are of values, or of 1.
    if not (steps.max(initial=0.0) < _LARGEST and steps.min(initial=0.0) > -_LARGEST):
        raise CodecError(f'a step of {step:g} is too small for the values: choose a larger one')
    return steps.astype(np.int32).ravel()[mask.nearest]


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
