"""The form of a skin without its dents: flat or part of a cylinder, and wavy."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.simulation.fields import require_positive

Field = NDArray[np.float64]


def turned(x: NDArray[Any], y: NDArray[Any], angle: float) -> tuple[NDArray[Any], NDArray[Any]]:
    """Coordinates along and across a direction.

    Parameters
    ----------
    x, y : ndarray
        On the panel from the part's centre, of any shape and floating-point type.
    angle : float
        From the panel's x axis to the direction, towards y, radians.

    Returns
    -------
    along, across : ndarray
        Of the same shape and type.
    """
    c, s = math.cos(angle), math.sin(angle)
    return x * c + y * s, y * c - x * s


@dataclass(frozen=True)
class Wave:
    """A sinusoidal waviness that runs across the whole panel.

    Attributes
    ----------
    amplitude : float
        Metres.
    wavelength : float
        Metres.
    angle : float
        From the panel's x axis to the direction in which it varies, towards y, radians.
    phase : float
        At the panel's origin, radians: ``amplitude * sin(phase)`` there.
    """

    amplitude: float
    wavelength: float
    angle: float = 0.0
    phase: float = 0.0

    def __post_init__(self) -> None:
        require_positive(self, 'wavelength')

    def height(self, x: Field, y: Field) -> tuple[Field, Field, Field]:
        """Height and its derivatives along x and y, at panel coordinates of any shape."""
        number = 2 * math.pi / self.wavelength
        along_x, along_y = number * math.cos(self.angle), number * math.sin(self.angle)
        phase = along_x * x + along_y * y + self.phase
        slope = self.amplitude * np.cos(phase)
        return self.amplitude * np.sin(phase), slope * along_x, slope * along_y


def waviness(
    amplitude: float, wavelength: float, seed: int = 0, count: int = 3
) -> tuple[Wave, ...]:
    """Waves in several directions that add up to an amplitude at most, metres.

    Their wavelengths lie within a quarter of `wavelength`, as those of a skin on its frames do.
    """
    rng = np.random.default_rng(seed)
    shares = rng.dirichlet(np.full(count, 4.0))
    return tuple(
        Wave(
            amplitude * float(share),
            wavelength * float(rng.uniform(0.8, 1.25)),
            float(rng.uniform(0, math.pi)),
            float(rng.uniform(0, 2 * math.pi)),
        )
        for share in shares
    )


def cylinder(radius: float, x: Field) -> tuple[Field, Field]:
    """Height of ``R - sqrt(R^2 - x^2)`` and its derivative; a radius of 0 is flat."""
    if not radius:
        return np.zeros_like(x), np.zeros_like(x)
    root = np.sqrt(np.maximum(radius**2 - x * x, 1e-12))
    # R - sqrt(R^2 - x^2) without its cancellation.
    return x * x / (radius + root), x / root


def height(radius: float, waves: Iterable[Wave], x: Field, y: Field) -> tuple[Field, Field, Field]:
    """Height of a cylinder with waves, and its derivatives along x and y."""
    rise, along_x = cylinder(radius, x)
    along_y = np.zeros_like(rise)
    for wave in waves:
        more, slope_x, slope_y = wave.height(x, y)
        rise, along_x, along_y = rise + more, along_x + slope_x, along_y + slope_y
    return rise, along_x, along_y
