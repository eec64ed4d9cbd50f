"""Light from elsewhere that falls on a part of the skin: sun, beside a wing's shadow."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import ConfigurationError

# Half the narrowest ramp, metres: an edge is never sharper than a tenth of a millimetre.
_SHARP = 5e-5


@dataclass(frozen=True)
class Sunlight:
    """Light on one side of a line across a panel.

    Attributes
    ----------
    level : float
        On the lit side, as a fraction of the projector's full light on the white patch of the
        photometry, as its `ambient` is.
    edge : tuple of 3 floats
        ``(n_x, n_y, offset)``: where n_x x + n_y y > offset on the panel it is lit.
    softness : float
        Width of the half shadow, metres: 9 mm behind an edge one metre away, in the sun.
    """

    level: float
    edge: tuple[float, float, float]
    softness: float = 0.0

    def __post_init__(self) -> None:
        if self.level < 0 or self.softness < 0 or not math.hypot(*self.edge[:2]) > 0:
            raise ConfigurationError(
                f'sunlight of level {self.level!r} and softness {self.softness!r} has the edge '
                f'{list(self.edge)}: give none below 0, and a direction'
            )

    def at(self, x: NDArray, y: NDArray) -> NDArray:
        """Light at panel coordinates of any shape."""
        n_x, n_y, offset = self.edge
        width = max(self.softness, 2 * _SHARP) * math.hypot(n_x, n_y)
        ramp = np.clip((n_x / width) * x + (n_y / width) * y + (0.5 - offset / width), 0, 1)
        # The sun's disc behind an edge: the part of it in view.
        return self.level * ramp * ramp * (3 - 2 * ramp)
