"""Windows and doors: where a panel has no skin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.simulation.skin.fields import require_positive
from ftp_dent_ros.simulation.skin.placing import turned

Field = NDArray[np.float64]


@dataclass(frozen=True)
class Opening:
    """A window or door: a rectangle or ellipse without skin.

    Attributes
    ----------
    x, y : float
        Centre on the panel, metres.
    length, width : float
        Metres.
    angle : float
        From the panel's x axis to its length, towards y, radians.
    round : bool
        An ellipse.
    """

    x: float
    y: float
    length: float
    width: float
    angle: float = 0.0
    round: bool = False

    def __post_init__(self) -> None:
        require_positive(self, 'length', 'width')

    def contains(self, x: Field, y: Field) -> NDArray[np.bool_]:
        """Mask of panel coordinates within."""
        along, across = turned(x - self.x, y - self.y, self.angle)
        u, v = along / (self.length / 2), across / (self.width / 2)
        return u * u + v * v < 1 if self.round else np.maximum(np.abs(u), np.abs(v)) < 1
