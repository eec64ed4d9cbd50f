"""The projected fringe pattern: sinusoidal fringes that tell their order.

``I(u) = (1 + c_k cos Phi) / 2`` with ``Phi = 2 pi (u - stripe_center_px) / period_px``. How a
fringe tells which it is, the code says:

- ``stripe``: c_k = 1, and over the one period around ``stripe_center_px`` green and blue are 0.
- ``contrast``: no colour; the contrast c_k of fringe ``k = floor((Phi + pi / 2) / 2 pi)`` is 1 or
  ``low_contrast``, after a sequence that begins with the panel's first fringe and is another one
  for other periods and zeros. It changes where the cosine is zero, so that the light is
  continuous and its mean the same everywhere. To tell the zero of the phase a whole fringe
  elsewhere changes no pixel. Along the fringes all contrasts are times
  ``r(v) = 1 - row_depth (1 - cos(2 pi v / row_period_px)) / 2``, which tells the rows: over the
  level, a fringe's amplitude is free of paint and dirt.

Fringes of the axis v are the same, turned: read u for v, and width for height.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftp_dent_ros.errors import PatternError
from ftp_dent_ros.fields import Checked, Limits, Pixels
from ftp_dent_ros.rig.rig import Lens

# An even number, so that the mean level is a whole grey level and the rounding of the two
# halves of a fringe cancels: 255 levels shift a fringe by up to 0.003 pixels.
_LEVELS = 254
# Levels by which two flanks that are meant alike may differ as they are computed.
_TIE = 1e-6
CODES = 'stripe', 'contrast'
AXES = 'u', 'v'
# What the contrast's code needs, and the stripe does not.
OF_CODE = 'low_contrast', 'row_depth', 'row_period_px'
# Zeros that differ within a fringe; and periods, by their logarithm over that of 8 px.
_ZEROS, _PERIODS, _PERIOD_STEP, _FIRST_PERIOD = 4, 4, 0.02, 8.0

# Registers: the bits that are added up for the next one, the oldest first; 1 if one more is added;
# and the first word. Of all first words, each is one after which, over 160 bits, words of 16
# differ in 3 places and none of 15 is found mirrored. By search over all registers of 8 bits.
_REGISTERS = (
    (0b11111010, 0, 0b00011100),
    (0b11101010, 1, 0b00000000),
    (0b10111010, 1, 0b11111110),
    (0b11111010, 1, 0b00000000),
    (0b10101110, 1, 0b00000000),
    (0b11111110, 1, 0b00000000),
    (0b11110101, 0, 0b10100010),
    (0b11110101, 1, 0b01011101),
    (0b11111101, 1, 0b00000000),
    (0b10101011, 1, 0b00000000),
    (0b11111011, 1, 0b00000000),
    (0b11010111, 0, 0b10000000),
    (0b11010111, 1, 0b00000000),
    (0b10101111, 0, 0b10000000),
    (0b10101111, 1, 0b10001101),
    (0b11101111, 1, 0b00000000),
)
# Bits of a sequence. From 186 on some begin again.
_LENGTH = 256


@dataclass(frozen=True)
class Pattern(Checked):
    """A fringe pattern and its code.

    Attributes
    ----------
    width, height : int
        The projector's image size, pixels.
    period_px : float
        Fringe period T_p, projector pixels.
    stripe_center_px : float
        Column where the phase is zero, projector pixels; the red stripe's middle, if there is
        one.
    axis : str
        The axis along which the fringes follow one another: ``'u'``, which is upright fringes
        for a projector beside the camera, or ``'v'`` for one above or below it.
    levels : int
        Grey level of the brightest pixels: 254 as `draw` makes them, 255 as others do.
    code : str
        One of `CODES`: a red stripe, or the fringes' contrast.
    low_contrast : float
        Contrast of every other fringe or so, 0.3 to 0.95, where the contrast is the code.
    row_depth, row_period_px : float
        What the contrast loses along the fringes at most, 0 (nothing) to 0.3, and the period of
        it, pixels, where the contrast is the code. The period is no part of most projectors'
        heights: 720 rows are 15 and a half, so that a pattern upside down shows.

    Raises
    ------
    PatternError
        A value is out of its range.
    """

    error = PatternError

    width: Pixels
    height: Pixels
    period_px: float
    stripe_center_px: float
    axis: Annotated[str, Limits(choices=AXES)] = 'u'
    levels: Annotated[int, Limits(choices=(_LEVELS, 255))] = _LEVELS
    code: Annotated[str, Limits(choices=CODES)] = 'stripe'
    low_contrast: Annotated[float, Limits(0.3, 0.95)] = 0.75
    row_depth: Annotated[float, Limits(0, 0.3)] = 0.05
    row_period_px: Annotated[float, Limits(16)] = 46.5

    def __post_init__(self) -> None:
        super().__post_init__()
        length = self.width if self.axis == 'u' else self.height
        if not 3.0 <= self.period_px <= length / 4:
            self.refuse('period_px', f'3 to {length / 4:g}, a quarter of the image')
        low, high = self.period_px / 2, length - 1 - self.period_px / 2
        if not low <= self.stripe_center_px <= high:
            self.refuse(
                'stripe_center_px', f'{low:g} to {high:g}: else the stripe leaves the image'
            )

    @property
    def transposed(self) -> Pattern:
        """The same fringes with columns for rows, and rows for columns."""
        axis = 'v' if self.axis == 'u' else 'u'
        return replace(self, width=self.height, height=self.width, axis=axis)

    def intensity(self, u: ArrayLike) -> NDArray[np.float64]:
        """Intensity, 0 to 1, at projector columns `u` of row 0; it goes on beyond the panel."""
        phase = self.phase(u)
        return (1 + self.contrast(phase) * np.cos(phase)) / 2

    @property
    def tells_rows(self) -> bool:
        """Whether the contrast along the fringes tells the rows."""
        return self.code == 'contrast' and self.row_depth > 0

    def row_contrast(self, v: ArrayLike) -> NDArray[np.float64]:
        """Contrast r(v) at projector rows `v`, over that of row 0; 1 everywhere for the stripe."""
        turn = 2 * np.pi / self.row_period_px * np.asarray(v, float)
        return 1 - self.tells_rows * self.row_depth * (1 - np.cos(turn)) / 2

    def contrast(self, phase: ArrayLike) -> NDArray[np.float32]:
        """Contrast of the fringes at absolute phases; 1 everywhere where it is no code."""
        return self.fringe_contrast(fringe_order(phase))

    def fringe_contrast(self, order: ArrayLike) -> NDArray[np.float32]:
        """Contrast of the fringes of whole orders k; the sequence repeats every 256 fringes."""
        order = np.asarray(order) - self.fringe_orders.start
        if self.code != 'contrast':
            return np.ones(order.shape, np.float32)
        contrasts = np.where(self.sequence, 1, self.low_contrast).astype(np.float32)
        return contrasts[order % len(contrasts)]

    @property
    def sequence(self) -> NDArray[np.bool_]:
        """Which fringes have the full contrast, from the panel's first on.

        Patterns whose periods differ by 2 % or some more, or their zeros by a quarter of a fringe
        or more, have others, so that a wrong pattern shows no code.
        """
        zero = round(_ZEROS * self.stripe_center_px / self.period_px) % _ZEROS
        period = round(math.log(self.period_px / _FIRST_PERIOD) / _PERIOD_STEP) % _PERIODS
        sequence: NDArray[np.bool_] = SEQUENCES[_ZEROS * period + zero]
        return sequence

    @property
    def faintest_contrast(self) -> float:
        """Contrast of the faintest fringes where it is the code; 1 where it is not."""
        return self.low_contrast * (1 - self.row_depth) if self.code == 'contrast' else 1.0

    @property
    def fringe_orders(self) -> range:
        """Orders k of the fringes from the first to the last column."""
        # So that rounding does not tell one fringe from the next at the border.
        rim = self.phase([0, self.width - 1]) + np.array([1e-6, -1e-6]) * 2 * np.pi
        first, last = fringe_order(rim).tolist()
        return range(first, last + 1)

    def phase(self, u: ArrayLike) -> NDArray[np.float64]:
        """Absolute phase ``2 pi (u_p - stripe_center_px) / T_p`` at projector columns `u`."""
        return 2 * np.pi / self.period_px * (np.asarray(u, float) - self.stripe_center_px)

    def column(self, phase: ArrayLike) -> NDArray[np.float64]:
        """Projector column of an absolute phase: the inverse of `phase` (eq. 16 of the paper)."""
        return self.stripe_center_px + self.period_px / (2 * np.pi) * np.asarray(phase, float)

    def in_stripe(self, u: ArrayLike) -> NDArray[np.bool_]:
        """Whether projector columns `u` lie in the red stripe; nowhere if there is none."""
        return (self.code == 'stripe') & (
            np.abs(np.asarray(u, float) - self.stripe_center_px) <= self.period_px / 2
        )

    def draw(self) -> NDArray[np.uint8]:
        """Draw the pattern's pixels, RGB, shape (height, width, 3)."""
        if self.axis == 'v':
            return np.ascontiguousarray(self.transposed.draw().transpose(1, 0, 2))
        u = np.arange(self.width)
        swing = self.levels * (self.intensity(u) - 0.5)
        grey = _whole(self.levels / 2 + np.outer(self.row_contrast(np.arange(self.height)), swing))
        pixels = np.repeat(grey.astype(np.uint8)[..., None], 3, axis=2)
        pixels[:, self.in_stripe(u), 1:] = 0
        return pixels

    def check_fits(self, projector: Lens) -> None:
        """Raise `PatternError` unless the pattern is as large as the projector's image."""
        if (self.width, self.height) != (projector.width, projector.height):
            raise PatternError(
                f'the pattern is {self.width}x{self.height}, the projector '
                f'{projector.width}x{projector.height} pixels: use the pattern of this rig'
            )


def fringe_order(phase: ArrayLike) -> NDArray[np.int32]:
    """Whole orders k of the fringes at absolute phases: ``floor((Phi + pi / 2) / 2 pi)``."""
    turns = np.asarray(phase) / (2 * np.pi) + 0.25
    return np.floor(turns).astype(np.int32)


def _whole(levels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Whole grey levels; those halfway between two go the same way on both flanks of a fringe."""
    return np.rint(_TIE * np.rint(levels / _TIE))


def _sequence(added: int, one_more: int, first: int) -> NDArray[np.bool_]:
    """Bits of a shift register."""
    bits = [first >> place & 1 for place in range(7, -1, -1)]
    taps = [place for place in range(8) if added >> (7 - place) & 1]
    while len(bits) < _LENGTH:
        oldest = len(bits) - 8
        bits.append((sum(bits[oldest + tap] for tap in taps) + one_more) % 2)
    return np.array(bits, bool)


#: All sequences, shape (16, 256).
SEQUENCES = np.stack([_sequence(*register) for register in _REGISTERS])
