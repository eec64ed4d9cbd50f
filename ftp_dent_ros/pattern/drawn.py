"""A pattern read back from the image that is projected, which is all that a rig has to share."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import PatternError
from ftp_dent_ros.pattern.pattern import SEQUENCES, Pattern, fringe_order

# Whole fringes that tell which they are: the length of the sequences' words.
_LEAST_FRINGES = 8
_LAST = SEQUENCES.shape[1] - 1
# Levels by which numbers that are not quite those meant may draw a pixel otherwise.
_ROUNDING = 2
# Difference of the contrast from row to row that is rounding.
_EVEN = 1e-3


def pattern_from_image(image: NDArray[np.uint8]) -> Pattern:
    """Read period, place and code back from the pixels of a drawn pattern.

    Parameters
    ----------
    image : ndarray, shape (height, width, 3), uint8
        The projected image, RGB.

    Returns
    -------
    Pattern
        The roundest period and centre that draw these pixels; to 1e-4 and 3e-4 pixels where they
        are not round. Of a code without a stripe, the centre is that of the fringe nearest to the
        image's middle, and the lower contrast is one of whole hundredths.

    Raises
    ------
    PatternError
        The image is no such pattern.
    """
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
        raise PatternError(
            f'the pattern image has the shape {image.shape} and type {image.dtype}: '
            'publish an rgb8 image'
        )
    if image.size and _spread(image, axis=0) > _spread(image, axis=1):
        return _upright(image.transpose(1, 0, 2)).transposed
    return _upright(image)


def _spread(image: NDArray[np.uint8], axis: int) -> float:
    """How much the levels differ along an axis, in the middle of the image."""
    middle = image.take(image.shape[1 - axis] // 2, axis=1 - axis)
    return float(middle.astype(float).std(axis=0).mean())


def _upright(image: NDArray[np.uint8]) -> Pattern:
    """Pattern of an image of upright fringes."""
    height, width, _ = image.shape
    # Along the first row, the contrast is that of the code alone.
    row = image[0].astype(float) if height else np.zeros((0, 3))
    stripe = np.flatnonzero((row[:, 0] > 64) & (row[:, 1:].max(axis=1) == 0))
    red = row[:, 0]
    if not image.size or red.min() == red.max() or (len(stripe) and (image != image[0]).any()):
        raise PatternError(
            'the pattern image shows no straight fringes: publish the image that '
            'pattern_publisher draws'
        )
    u = np.arange(width)
    levels = 255 if red.max() > 254 else 254
    shape = {'width': width, 'height': height, 'levels': levels}
    if len(stripe):
        found = [_roundest(shape, _fit_fringes(u, red, stripe.mean()), u, red)]
    else:
        found = [
            _roundest({**shape, 'code': 'contrast', 'low_contrast': low}, fringes, u, red)
            for fringes, low in _coded_fringes(u, red, levels)
        ]
    pattern, misfit = min(found, key=lambda each: each[1])
    outside = ~pattern.in_stripe(u)
    if misfit > 2 or (row[outside, 1:] != row[outside, :1]).any():
        raise PatternError(
            'the pattern image is not a sinusoid of one period with one red stripe, nor a '
            'coded one: publish the image that pattern_publisher draws'
        )
    return pattern if len(stripe) else _with_rows(pattern, image)


def _roundest(
    fields: dict[str, Any], fringes: tuple[float, float], u: NDArray, level: NDArray
) -> tuple[Pattern, float]:
    """The pattern of the roundest numbers that draw these very pixels, and its misfit, levels."""
    for decimals in range(5):
        period, centre = (round(value, decimals) for value in fringes)
        pattern = Pattern(period_px=period, stripe_center_px=centre, **fields)
        drawn = pattern.intensity(u)
        misfit = float(np.abs(drawn * (drawn @ level) / (drawn @ drawn) - level).max())
        if misfit < 0.6:
            break
    return pattern, misfit


def _with_rows(pattern: Pattern, image: NDArray[np.uint8]) -> Pattern:
    """The pattern with the contrast that its image has along the fringes."""
    if _misfit(pattern, image) == (0, 0):
        return pattern
    swing = pattern.levels * (pattern.intensity(np.arange(pattern.width)) - 0.5)
    contrast = (image[..., 0] - pattern.levels / 2) @ swing / (swing @ swing)
    found = [replace(pattern, row_depth=0.0)]
    if np.ptp(contrast) > _EVEN:
        v = np.arange(pattern.height)
        period, _ = _fit_fringes(v, contrast, 0.0)
        wave = (1 - np.cos(2 * np.pi / period * v)) / 2
        depth = float(wave @ (1 - contrast) / (wave @ wave))
        if 0 < depth <= 0.3 and period >= 16:
            found += [
                replace(
                    pattern, row_depth=round(depth, 2 + more), row_period_px=round(period, more)
                )
                for more in range(5)
            ]
    # Of those that draw it as well, the roundest.
    best = min(found, key=lambda each: _misfit(each, image))
    if _misfit(best, image)[0] <= _ROUNDING:
        return best
    raise PatternError(
        'the contrast of the pattern image does not change along its fringes as a pattern has '
        'it: publish the image that pattern_publisher draws'
    )


def _misfit(pattern: Pattern, image: NDArray[np.uint8]) -> tuple[int, int]:
    """Levels by which pixels differ from those that the pattern draws: at most, and in all."""
    away = cv2.absdiff(pattern.draw(), np.ascontiguousarray(image))
    return int(away.max()), int(away.sum(dtype=np.int64))


def _coded_fringes(
    u: NDArray, level: NDArray, levels: int
) -> list[tuple[tuple[float, float], float]]:
    """Period and centre of fringes whose contrast is a code, and the lower contrast.

    By each of the sequences that the fringes may be: few fringes may be of several.
    """
    half = levels / 2
    period, centre = _fit_fringes(u, level, len(u) / 2)
    phase = 2 * np.pi / period * (u - centre)
    order = fringe_order(phase)
    first = int(order[0])
    cosine = np.cos(phase)
    swing = np.bincount(order - first, (level - half) * cosine)
    contrast = swing / (half * np.bincount(order - first, cosine * cosine))
    # The first and the last fringe are cut by the image's border.
    whole = contrast[1:-1]
    high = whole > 1 - (1 - whole.min(initial=1)) / 2
    index = np.arange(1, len(contrast) - 1)
    # The fit may take the first column for the fringe beside.
    fitting = [
        (sequence, lead)
        for sequence in SEQUENCES
        for lead in (0, 1, -1)
        if (high == sequence[index + lead & _LAST]).all()
    ]
    if len(whole) < _LEAST_FRINGES or not fitting:
        raise PatternError(
            'the pattern image shows neither a red stripe nor fringes with the contrast of the '
            'code: publish the image that pattern_publisher draws'
        )
    low_contrast = np.median(whole[~high]) / np.median(whole[high])
    found = []
    for sequence, lead in fitting:
        code = np.where(sequence, 1, low_contrast)[order - first + lead & _LAST]
        even = half + (level - half) / code
        fringes = _fit_fringes(u, even, centre)
        found.append((fringes, round(float(low_contrast), 2)))
    return found


def _fit_fringes(u: NDArray, level: NDArray, near: float) -> tuple[float, float]:
    """Period and centre of the peak nearest `near` by least squares on phase and frequency."""
    centred = level - level.mean()
    size = 8 * len(u)
    spectrum = np.abs(np.fft.rfft(centred * np.hanning(len(u)), size))
    frequency = (np.argmax(spectrum[8:]) + 8) / size
    centre = float(near)
    for _ in range(8):
        angle = 2 * np.pi * frequency * (u - centre)
        cosine, sine = np.cos(angle), np.sin(angle)
        moment = 2 * np.pi * (u - centre)
        basis = np.stack([np.ones_like(cosine), cosine, sine, moment * sine], axis=1)
        _, amplitude, quadrature, slope = np.linalg.lstsq(basis, level, rcond=None)[0]
        frequency -= slope / np.hypot(amplitude, quadrature)
        centre += np.arctan2(quadrature, amplitude) / (2 * np.pi * frequency)
    centre -= round((centre - near) * frequency) / frequency
    return float(1 / frequency), float(centre)
