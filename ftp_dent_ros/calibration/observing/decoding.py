"""Photographs of a sequence to the projector pixel that lights each camera pixel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.calibration.observing.sequence import Frame, Sequence
from ftp_dent_ros.errors import CalibrationError

# A lit pixel is brighter by this than an unlit one: three times what rounding and read noise do.
_LEAST_CONTRAST = 6.0
# Phases noisier than this could be of the next code word; radians.
_LARGEST_PHASE_NOISE = 0.4
_SATURATED = 254
# Wrong bits in dark squares put fewer codes than this off the projector.
_OUTSIDE = 0.05

Photographs = Mapping[Frame, NDArray[np.uint8]]


@dataclass(frozen=True, eq=False)
class Codes:
    """Projector pixels seen by camera pixels.

    Attributes
    ----------
    u, v : ndarray, shape (height, width), float32
        NaN where unknown.
    troubles : tuple of str
        What could not be decoded, and why.
    """

    u: NDArray[np.float32]
    v: NDArray[np.float32]
    troubles: tuple[str, ...] = ()


def decode(photographs: Photographs, sequence: Sequence, part: tuple[slice, slice]) -> Codes:
    """Decode one pose.

    Parameters
    ----------
    photographs : mapping of Frame to ndarray, shape (height, width), uint8
        Grey photographs; some may be missing.
    sequence : Sequence
    part : (slice, slice)
        Rows and columns to decode; the rest is NaN.

    Returns
    -------
    Codes
        An axis that cannot be decoded is all NaN, with a trouble that says why.
    """
    shape = next(iter(photographs.values())).shape
    axes: list[NDArray[np.float32]] = []
    troubles: list[str] = []
    for axis in 'uv':
        whole = np.full(shape, np.nan, np.float32)
        try:
            whole[part] = _decode_axis(photographs, sequence, axis, part)
        except CalibrationError as error:
            troubles.append(str(error))
        axes.append(whole)
    return Codes(axes[0], axes[1], tuple(troubles))


def lit_evenly(photographs: Photographs, steps: int) -> dict[str, NDArray[np.uint8]]:
    """Photographs, taken or composed, in which the board is lit evenly, by when they were taken.

    The sum of a bit and its inverse are such, and the mean of shifts, of `steps` a period, whose
    fringes and second harmonics cancel: that of a whole period or of every other step of it.
    """
    found: dict[str, NDArray[np.uint8]] = {}
    if Frame('white') in photographs:
        found['the white one'] = photographs[Frame('white')]
    for axis, word in (('u', 'columns'), ('v', 'rows')):
        shifts = {
            frame.index: image
            for frame, image in photographs.items()
            if frame.kind == 'shift' and frame.axis == axis
        }
        turns = np.exp(2j * np.pi * np.array(list(shifts)) / steps)
        cancel = max(abs(turns.sum()), abs((turns * turns).sum())) < 1e-6
        pairs = [
            (image, photographs[Frame('inverse', axis, frame.index)])
            for frame, image in photographs.items()
            if frame.kind == 'gray'
            and frame.axis == axis
            and Frame('inverse', axis, frame.index) in photographs
        ]
        if len(shifts) > 2 and cancel:
            mean = np.mean(np.stack(list(shifts.values())), axis=0, dtype=np.float32)
            found[f'those of the {word}'] = _stretched(mean)
        elif pairs:
            mean = np.mean(
                np.concatenate([np.stack(pair) for pair in pairs]), axis=0, dtype=np.float32
            )
            found[f'those of the {word}'] = _stretched(mean)
    if Frame('white', '', 1) in photographs:
        found['the last one'] = photographs[Frame('white', '', 1)]
    return found


def _stretched(mean: Any) -> NDArray[np.uint8]:
    """Grey levels over their whole range: rounding would cost sub-pixel accuracy."""
    return np.clip(np.rint(mean * (254 / max(float(mean.max()), 1))), 0, 255).astype(np.uint8)


def _decode_axis(
    photographs: Photographs, sequence: Sequence, axis: str, part: tuple[slice, slice]
) -> NDArray[np.float32]:
    shifts = {
        frame.index: photographs[frame][part].astype(np.float32)
        for frame in sequence.frames
        if frame.kind == 'shift' and frame.axis == axis and frame in photographs
    }
    word, lost, lit = _words(photographs, sequence, axis, part, shifts)
    if not sequence.period:
        coarse = 1 << lost
        value = word.astype(np.float32) * coarse + (coarse - 1) / 2
        return _on_projector(value, lit, sequence, axis)
    if lost > 0:
        raise CalibrationError(f'{_word(axis)}: the finest Gray bit is missing')
    if len(shifts) < 3:
        raise CalibrationError(
            f'{_word(axis)}: {len(shifts)} of {sequence.steps} shifted photographs are there, '
            'fewer than 3'
        )
    phase, noise, _ = _phase(shifts, sequence.steps)
    turn = np.mod(phase / (2 * np.pi), 1)
    order = np.where(
        turn < 0.25, (word + 1) // 2, np.where(turn < 0.75, word // 2, (word - 1) // 2)
    )
    value = ((order + turn) * sequence.period).astype(np.float32)
    return _on_projector(value, lit & (noise <= _LARGEST_PHASE_NOISE), sequence, axis)


def _on_projector(
    value: NDArray[np.float32], known: NDArray[np.bool_], sequence: Sequence, axis: str
) -> NDArray[np.float32]:
    """Values without those that are not known or off the projector, of which there are few."""
    size = sequence.size(axis)
    beyond = value > size - 0.5
    if np.any(known) and float(np.mean(beyond[known])) > _OUTSIDE:
        raise CalibrationError(
            f'{_word(axis)}: codes reach {np.percentile(value[known], 98):.0f}, and the projector '
            f'has {size} of them: give its width and height in this order, and the photographs '
            'in that of their projection'
        )
    value[~known | beyond | (value < -0.5)] = np.nan
    return value


def _words(
    photographs: Photographs,
    sequence: Sequence,
    axis: str,
    part: tuple[slice, slice],
    shifts: Mapping[int, NDArray[np.float32]],
) -> tuple[NDArray[np.int32], int, NDArray[np.bool_]]:
    """Gray code words, how many of their finest bits are missing, and where they can be read."""
    white, black = (photographs.get(Frame(kind)) for kind in ('white', 'black'))
    middle: NDArray | None = None
    if white is not None and black is not None:
        middle = (white[part].astype(np.float32) + black[part]) / 2
    elif len(shifts) > 2:
        _, _, middle = _phase(shifts, sequence.steps)
    bits: list[NDArray[np.bool_] | None] = []
    contrast: list[NDArray[np.float32]] = []
    for index in range(sequence.bits(axis)):
        bit = photographs.get(Frame('gray', axis, index))
        inverse = photographs.get(Frame('inverse', axis, index))
        if bit is not None and inverse is not None:
            difference = bit[part].astype(np.float32) - inverse[part]
            contrast.append(np.abs(difference))
        elif middle is not None and (bit is not None or inverse is not None):
            there, sign = (bit, 2) if bit is not None else (inverse, -2)
            difference = sign * (np.asarray(there)[part] - middle)
            contrast.append(np.abs(difference))
        else:
            bits.append(None)
            continue
        bits.append(difference > 0)
    known = [bit is not None for bit in bits]
    lost = known[::-1].index(True) if any(known) else len(known)
    if not all(known[: len(known) - lost]) or lost > 3:
        missing = [index for index, there in enumerate(known) if not there]
        raise CalibrationError(
            f'{_word(axis)}: the photographs of {len(missing)} of {len(known)} Gray bits are '
            f'missing (bit {", ".join(map(str, missing))})'
        )
    if white is not None and black is not None:
        lit = white[part].astype(np.float32) - black[part] > _LEAST_CONTRAST
    else:
        lit = np.max(contrast, axis=0) > _LEAST_CONTRAST
    word = np.zeros(lit.shape, np.int32)
    last = np.zeros(lit.shape, bool)
    for each in bits[: len(bits) - lost]:
        last = last ^ each
        word = 2 * word + last
    return word, lost, lit


def _phase(
    shifts: Mapping[int, NDArray[np.float32]], steps: int
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Phase by least squares over the steps there are, its standard deviation, and the mean."""
    angle = 2 * np.pi * np.array(list(shifts)) / steps
    basis = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=1)
    inverse = np.linalg.pinv(basis).astype(np.float32)
    stack = np.stack(list(shifts.values()))
    mean, cosine, sine = np.tensordot(inverse, stack, axes=(1, 0))
    modulation = np.maximum(np.hypot(cosine, sine), 1e-3)
    clipped = (stack > _SATURATED).any(axis=0)
    noise = np.sqrt(2 / len(stack)) / modulation
    noise[clipped] = np.inf
    return np.arctan2(sine, cosine), noise, mean


def _word(axis: str) -> str:
    return 'columns' if axis == 'u' else 'rows'
