"""What lies on a paint: dirt, streaks, scratches, letters and patches.

A mark is a factor on the paint's albedo at panel coordinates of shape (...): one for all colours,
of the same shape, or one a colour, shape (3, ...).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.simulation.skin.fields import require_positive
from ftp_dent_ros.simulation.skin.placing import turned
from ftp_dent_ros.simulation.skin.textures import LETTER, letters_of, noise, sampled

# Standard deviations that 99 % of a normal distribution lie within.
_WITHIN = 2.576
# Half the ramp at a mark's border, metres: paint ends within a tenth of a millimetre.
_SOFT = 5e-5

# float32, for which OpenCV's annotations are too wide.
Image = NDArray[Any]
Colour = tuple[float, float, float]
Box = tuple[float, float, float]


class Mark(Protocol):
    """A factor on the albedo of a paint."""

    @property
    def smooth(self) -> bool:
        """Whether it is grey, and changes over several pixels only."""

    @property
    def coloured(self) -> bool:
        """Whether its factor differs from colour to colour."""

    @property
    def box(self) -> Box | None:
        """Centre and half the side of a square that holds it, metres; None for everywhere."""

    def factor(self, x: Image, y: Image) -> Image:
        """At panel coordinates, metres, of shape (...): shape (...) or (3, ...)."""


@dataclass(frozen=True)
class Dirt:
    """Smooth random albedo of several scales, the same everywhere.

    Attributes
    ----------
    contrast : float
        Half the range that holds 99 % of the factor, whose mean is 1.
    scales : tuple of float
        Widths of the grains (at half of their correlation), metres; each gives the same variance.
    seed : int
    stretch : float
        How many times longer than wide the grains are: streaks.
    angle : float
        From the panel's x axis to their length, towards y, radians.
    """

    contrast: float
    scales: tuple[float, ...] = (0.064, 0.016, 0.004)
    seed: int = 0
    stretch: float = 1.0
    angle: float = 0.0

    smooth = True
    coloured = False
    box = None

    def __post_init__(self) -> None:
        require_positive(self, 'stretch')
        if not 0 <= self.contrast <= 1 or not self.scales or min(self.scales) <= 0:
            raise ConfigurationError(
                f'dirt has a contrast of {self.contrast!r} in scales {self.scales!r}: '
                'give 0 to 1, and positive lengths'
            )

    def factor(self, x: Image, y: Image) -> Image:
        """At panel coordinates, metres."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        along, across = (c * x + s * y) / self.stretch, c * y - s * x
        total = np.zeros(x.shape, np.float32)
        for index, scale in enumerate(self.scales):
            total += noise(self.seed, index, along / scale, across / scale)
        total *= np.float32(self.contrast / (_WITHIN * math.sqrt(len(self.scales))))
        total += 1
        # No dirt swallows all light, nor does any lack of it more than double it.
        return np.clip(total, 0.1, 1.9, out=total)


@dataclass(frozen=True)
class Patch:
    """A rectangle or ellipse of another paint; long and narrow, it is a stripe or a scratch.

    Attributes
    ----------
    x, y : float
        Centre on the panel, metres.
    length, width : float
        Metres.
    tint : tuple of 3 floats
        Factor on the albedo of red, green and blue light.
    angle : float
        From the panel's x axis to its length, towards y, radians.
    round : bool
        An ellipse.
    """

    x: float
    y: float
    length: float
    width: float
    tint: Colour
    angle: float = 0.0
    round: bool = False

    smooth = False

    def __post_init__(self) -> None:
        require_positive(self, 'length', 'width')

    @property
    def coloured(self) -> bool:
        """Whether its factor differs from colour to colour."""
        return len(set(self.tint)) > 1

    @property
    def box(self) -> Box:
        """Centre and half the side of a square that holds it, metres."""
        return self.x, self.y, math.hypot(self.length, self.width) / 2

    def factor(self, x: Image, y: Image) -> Image:
        """At panel coordinates, metres."""
        along, across = _from_centre(self, x, y)
        half_length, half_width = self.length / 2, self.width / 2
        if self.round:
            r = np.hypot(along / half_length, across / half_width)
            beyond = (r - 1) * min(half_length, half_width)
        else:
            beyond = np.maximum(np.abs(along) - half_length, np.abs(across) - half_width)
        return _tinted(np.clip(0.5 - beyond / (2 * _SOFT), 0, 1), self.tint)


@dataclass(frozen=True)
class Lettering:
    """A line of text.

    Attributes
    ----------
    x, y : float
        Its centre on the panel, metres.
    text : str
    height : float
        Of a capital letter, metres.
    tint : tuple of 3 floats
        Factor on the albedo of red, green and blue light.
    angle : float
        From the panel's x axis to the way it is read, towards y, radians.
    """

    x: float
    y: float
    text: str
    height: float
    tint: Colour
    angle: float = 0.0

    smooth = False

    def __post_init__(self) -> None:
        require_positive(self, 'height')

    @property
    def coloured(self) -> bool:
        """Whether its factor differs from colour to colour."""
        return len(set(self.tint)) > 1

    @property
    def box(self) -> Box:
        """Centre and half the side of a square that holds it, metres."""
        letters = letters_of(self.text)
        return self.x, self.y, math.hypot(*letters.shape) / 2 * self.height / LETTER

    def factor(self, x: Image, y: Image) -> Image:
        """At panel coordinates, metres."""
        letters = letters_of(self.text)
        along, across = _from_centre(self, x, y)
        scale = np.float32(LETTER / self.height)
        column = along * scale + np.float32((letters.shape[1] - 1) / 2)
        row = across * scale + np.float32((letters.shape[0] - 1) / 2)
        return _tinted(sampled(letters, column, row), self.tint)


def scratches(
    count: int, extent: tuple[float, float, float, float], seed: int = 0
) -> tuple[Patch, ...]:
    """Narrow light and dark marks, 0.2 to 0.8 mm wide and 10 to 80 mm long.

    Parameters
    ----------
    count : int
    extent : tuple of 4 floats
        x_min, x_max, y_min, y_max that their centres lie in, metres.
    seed : int
    """
    rng = np.random.default_rng(seed)
    x_min, x_max, y_min, y_max = extent
    found = []
    for _ in range(count):
        tint = float(rng.choice([rng.uniform(0.25, 0.7), rng.uniform(1.1, 1.25)]))
        found.append(
            Patch(
                float(rng.uniform(x_min, x_max)),
                float(rng.uniform(y_min, y_max)),
                float(rng.uniform(0.01, 0.08)),
                float(rng.uniform(0.0002, 0.0008)),
                (tint,) * 3,
                float(rng.uniform(0, math.pi)),
            )
        )
    return tuple(found)


def _from_centre(mark: Patch | Lettering, x: Image, y: Image) -> tuple[Image, Image]:
    """Coordinates along and across a mark from its centre, metres, float32."""
    dx, dy = (x - mark.x).astype(np.float32), (y - mark.y).astype(np.float32)
    return turned(dx, dy, mark.angle)


def _tinted(cover: Image, tint: Colour) -> Image:
    """Factor where a mark covers a part of what is seen."""
    if min(tint) == max(tint):
        return 1 - cover * np.float32(1 - tint[0])
    return np.stack([1 - cover * np.float32(1 - part) for part in tint])
