"""A pattern read back from the image that is projected, which is all that a rig has to share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import PatternError
from ftp_dent_ros.pattern import SEQUENCE, Pattern, fringe_order

# Whole fringes that tell which they are: the length of the sequence's words.
_LEAST_FRINGES = 8
_LAST = len(SEQUENCE) - 1


def pattern_from_image(image: NDArray[np.uint8]) -> Pattern:
    """Read period, place and code back from the pixels of a drawn pattern.

    Parameters
    ----------
    image : ndarray, shape (height, width, 3), uint8
        The projected image, RGB.

    Returns
    -------
    Pattern
        The roundest period and centre that draw these pixels; to 1e-4 pixels where they are
        not round. Of a code without a stripe, the centre is that of the fringe nearest to the
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
    height, width, _ = image.shape
    row = image[height // 2].astype(float) if height else np.zeros((0, 3))
    stripe = np.flatnonzero((row[:, 0] > 64) & (row[:, 1:].max(axis=1) == 0))
    red = row[:, 0]
    if not image.size or red.min() == red.max() or (image != image[height // 2]).any():
        raise PatternError(
            'the pattern image shows no vertical fringes: publish the image that '
            'pattern_publisher draws'
        )
    u = np.arange(width)
    levels = 255 if red.max() > 254 else 254
    if len(stripe):
        fringes, low_contrast = _fit_fringes(u, red, stripe.mean()), None
    else:
        fringes, low_contrast = _coded_fringes(u, red, levels)
    # The roundest numbers that draw these very pixels are the ones that were meant.
    for decimals in range(5):
        period, center = (round(value, decimals) for value in fringes)
        pattern = Pattern(width, height, period, center, levels=levels)
        if low_contrast is not None:
            pattern = replace(pattern, code='contrast', low_contrast=low_contrast)
        drawn = pattern.intensity(u)
        misfit = np.abs(drawn * (drawn @ red) / (drawn @ drawn) - red).max()
        if misfit < 0.6:
            break
    outside = ~pattern.in_stripe(u)
    if misfit > 2 or (row[outside, 1:] != row[outside, :1]).any():
        raise PatternError(
            'the pattern image is not a sinusoid of one period with one red stripe, nor a '
            'coded one: publish the image that pattern_publisher draws'
        )
    return pattern


def _coded_fringes(u: NDArray, level: NDArray, levels: int) -> tuple[tuple[float, float], float]:
    """Period and centre of fringes whose contrast is the code, and the lower contrast."""
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
    leads = [lead for lead in (0, 1, -1) if (high == SEQUENCE[index + lead & _LAST]).all()]
    if len(whole) < _LEAST_FRINGES or not leads:
        raise PatternError(
            'the pattern image shows neither a red stripe nor fringes with the contrast of the '
            'code: publish the image that pattern_publisher draws'
        )
    low_contrast = np.median(whole[~high]) / np.median(whole[high])
    code = np.where(SEQUENCE, 1, low_contrast)[order - first + leads[0] & _LAST]
    even = half + (level - half) / code
    period, centre = _fit_fringes(u, even, centre)
    cosine = np.cos(2 * np.pi / period * (u - centre))
    low, full = (
        ((level - half) * cosine)[chosen].sum() / np.square(cosine[chosen]).sum()
        for chosen in (code < 1, code == 1)
    )
    return (period, centre), round(float(low / full), 2)


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
