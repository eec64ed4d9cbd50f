"""The projected fringe pattern: vertical sinusoidal fringes, the central one red.

``I(u) = (1 + cos(2 pi (u - stripe_center_px) / period_px)) / 2``; over the one period around
``stripe_center_px`` green and blue are 0. The pattern draws itself, and reads itself back from
an image of it, so that the projected image is the only thing that a rig has to share.
"""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import yaml
from numpy.typing import ArrayLike, NDArray

from ftp_dent_ros.errors import PatternError
from ftp_dent_ros.files import read_yaml, written_aside
from ftp_dent_ros.rig import Lens

# An even number, so that the mean level is a whole grey level and the rounding of the two
# halves of a fringe cancels: 255 levels shift a fringe by up to 0.003 pixels.
_LEVELS = 254


@dataclass(frozen=True)
class Pattern:
    """A fringe pattern with a red stripe.

    Attributes
    ----------
    width, height : int
        The projector's image size, pixels.
    period_px : float
        Fringe period T_p, projector pixels.
    stripe_center_px : float
        Column at the middle of the red stripe, where the phase is zero, projector pixels.
    axis : str
        The axis along which the intensity varies; ``'u'``.
    levels : int
        Grey level of the brightest pixels: 254 as `draw` makes them, 255 as others do.

    Raises
    ------
    PatternError
        A value is out of its range.
    """

    width: int
    height: int
    period_px: float
    stripe_center_px: float
    axis: str = 'u'
    levels: int = _LEVELS

    def __post_init__(self) -> None:
        for name in ('width', 'height'):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or not 0 < value <= 65536:
                raise PatternError(f'{name} is {value!r}, not a number of pixels: correct it')
        if self.levels not in (254, 255):
            raise PatternError(f'levels is {self.levels!r}, neither 254 nor 255: correct it')
        for name in ('period_px', 'stripe_center_px'):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise PatternError(f'{name} is {value!r}, not a number: correct it')
        if not 3.0 <= self.period_px <= self.width / 4:
            raise PatternError(
                f'period_px is {self.period_px:g}, outside 3 to {self.width / 4:g} '
                '(a quarter of the width): correct it'
            )
        low, high = self.period_px / 2, self.width - 1 - self.period_px / 2
        if not low <= self.stripe_center_px <= high:
            raise PatternError(
                f'stripe_center_px is {self.stripe_center_px:g}, so that the stripe leaves the '
                f'image: set it between {low:g} and {high:g}'
            )
        if self.axis != 'u':
            raise PatternError(f'axis is {self.axis!r}: only u (vertical fringes) is built')

    def intensity(self, u: ArrayLike) -> NDArray[np.float64]:
        """Intensity, 0 to 1, at projector columns `u`; it goes on beyond the panel."""
        return (1 + np.cos(self.phase(u))) / 2

    def phase(self, u: ArrayLike) -> NDArray[np.float64]:
        """Absolute phase ``2 pi (u_p - stripe_center_px) / T_p`` at projector columns `u`."""
        return 2 * np.pi / self.period_px * (np.asarray(u, float) - self.stripe_center_px)

    def column(self, phase: ArrayLike) -> NDArray[np.float64]:
        """Projector column of an absolute phase: the inverse of `phase` (eq. 16)."""
        return self.stripe_center_px + self.period_px / (2 * np.pi) * np.asarray(phase, float)

    def in_stripe(self, u: ArrayLike) -> NDArray[np.bool_]:
        """Whether projector columns `u` lie in the red stripe."""
        return np.abs(np.asarray(u, float) - self.stripe_center_px) <= self.period_px / 2

    @property
    def rounding_variance(self) -> float:
        """Variance of the fringes' phase by the rounding of pixels to whole levels, radians^2.

        A fringe's phase is off by ``2 / (n B) sum e sin Phi`` for the errors e of its n pixels
        and the amplitude B. What lies halfway between two levels is rounded by luck.
        """
        u = np.arange(self.width)
        phase = self.phase(u)
        meant = self.levels * self.intensity(u)
        error = np.rint(meant) - meant
        by_luck = np.abs(error) > 0.5 - 1e-6
        sine = np.sin(phase)
        order = np.rint(phase / (2 * np.pi)).astype(int)
        order -= order.min()
        scale = 4 / (self.period_px * self.levels)
        shift = scale * np.bincount(order, np.where(by_luck, 0, error) * sine)
        chance = scale**2 * np.bincount(order, by_luck * np.square(sine)) / 4
        return float(np.mean(np.square(shift[1:-1])) + np.mean(chance[1:-1]))

    def draw(self) -> NDArray[np.uint8]:
        """Draw the pattern's pixels, RGB, shape (height, width, 3)."""
        u = np.arange(self.width)
        row = np.repeat(np.rint(self.levels * self.intensity(u))[:, None], 3, axis=1)
        row[self.in_stripe(u), 1:] = 0
        return np.tile(row.astype(np.uint8), (self.height, 1, 1))

    def check_fits(self, projector: Lens) -> None:
        """Raise `PatternError` unless the pattern is as large as the projector's image."""
        if (self.width, self.height) != (projector.width, projector.height):
            raise PatternError(
                f'the pattern is {self.width}x{self.height}, the projector '
                f'{projector.width}x{projector.height} pixels: use the pattern of this rig'
            )


def read_pattern(path: str | os.PathLike[str]) -> Pattern:
    """Read ``pattern.yaml``; raises `PatternError` with the field that is wrong."""
    return pattern_from_fields(read_yaml(path, PatternError), str(path))


def pattern_from_fields(data: dict[str, Any], where: str) -> Pattern:
    """Pattern of the fields of ``pattern.yaml``; errors name `where` they came from."""
    for name in ('width', 'height', 'period_px', 'stripe_center_px'):
        if name not in data:
            raise PatternError(f'{where}: {name} is missing: add it')
    unknown = data.keys() - Pattern.__dataclass_fields__.keys()
    if unknown:
        raise PatternError(f'{where}: unknown field {sorted(unknown)[0]!r}: remove it')
    try:
        # Whoever draws a pattern without a word about it takes white for 255.
        return Pattern(**{'levels': 255, **data})
    except PatternError as reason:
        raise PatternError(f'{where}: {reason}') from None


def write_pattern(path: str | os.PathLike[str], pattern: Pattern) -> None:
    """Write ``pattern.yaml``; a file under that name is whole or not there."""
    with written_aside(path) as aside:
        aside.write_text(yaml.safe_dump(asdict(pattern), sort_keys=False), encoding='utf-8')


def pattern_from_image(image: NDArray[np.uint8]) -> Pattern:
    """Read period and stripe back from the pixels of a drawn pattern.

    Parameters
    ----------
    image : ndarray, shape (height, width, 3), uint8
        The projected image, RGB.

    Returns
    -------
    Pattern
        The roundest period and centre that draw these pixels; to 1e-4 pixels where they are
        not round.

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
    if len(stripe) == 0 or (image != image[height // 2]).any():
        raise PatternError(
            'the pattern image shows no vertical fringes with one red stripe: '
            'publish the image that pattern_publisher draws'
        )
    u = np.arange(width)
    period, center = _fit_fringes(u, row[:, 0], stripe.mean())
    levels = 255 if row.max() > 254 else 254
    # The roundest numbers that draw these very pixels are the ones that were meant.
    for decimals in range(5):
        pattern = Pattern(
            width, height, round(period, decimals), round(center, decimals), levels=levels
        )
        drawn = pattern.intensity(u)
        misfit = np.abs(drawn * (drawn @ row[:, 0]) / (drawn @ drawn) - row[:, 0]).max()
        if misfit < 0.6:
            break
    outside = ~pattern.in_stripe(u)
    if misfit > 2 or (row[outside, 1] != row[outside, 0]).any():
        raise PatternError(
            'the pattern image is not a sinusoid of one period with one red stripe: '
            'publish the image that pattern_publisher draws'
        )
    return pattern


def _fit_fringes(u: NDArray, level: NDArray, stripe: float) -> tuple[float, float]:
    """Period and centre of the peak nearest `stripe` by least squares on phase and frequency."""
    centred = level - level.mean()
    size = 8 * len(u)
    spectrum = np.abs(np.fft.rfft(centred * np.hanning(len(u)), size))
    frequency = (np.argmax(spectrum[8:]) + 8) / size
    centre = float(stripe)
    for _ in range(8):
        angle = 2 * np.pi * frequency * (u - centre)
        cosine, sine = np.cos(angle), np.sin(angle)
        moment = 2 * np.pi * (u - centre)
        basis = np.stack([np.ones_like(cosine), cosine, sine, moment * sine], axis=1)
        _, amplitude, quadrature, slope = np.linalg.lstsq(basis, level, rcond=None)[0]
        frequency -= slope / np.hypot(amplitude, quadrature)
        centre += np.arctan2(quadrature, amplitude) / (2 * np.pi * frequency)
    centre -= round((centre - stripe) * frequency) / frequency
    return float(1 / frequency), float(centre)
