"""What the code makes of the fringes' contrast: steps from fringe to fringe, through a blur."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pattern.pattern import SEQUENCES, Pattern
from ftp_dent_ros.profilometry.least_squares.code.fringe_contrast import fringe_contrasts

# Variance of a usual blur, and of others that are asked for, radians^2: one blurs the fringes'
# steps by a fifth more than the one before.
BLURS = 0.6, 1.6, 2.6, 3.6
# Fringes beyond the frame's rim that blur makes.
_BEYOND = 2
# Samples of a fringe, and their light, grey levels.
_SAMPLES, _LEVEL = 32, 1e4


@dataclass(frozen=True, eq=False)
class ExpectedSteps:
    """Steps of the contrast's logarithm from each fringe to the next.

    Attributes
    ----------
    first : int
        Order of the fringe before the first step.
    steps : ndarray, shape (n,)
        Over the panel, and none for a few fringes beyond it: the blurred rim of the frame looks
        like a fringe of its own.
    """

    first: int
    steps: NDArray[np.float64]

    @classmethod
    def of(cls, pattern: Pattern, blur: float = BLURS[0]) -> ExpectedSteps:
        """Those of a pattern.

        Parameters
        ----------
        pattern : Pattern
        blur : float
            Variance of the blur, radians^2.
        """
        orders = pattern.fringe_orders
        contrast = pattern.fringe_contrast(np.arange(orders.start, orders.stop))
        return cls(orders.start - _BEYOND, np.pad(_steps(contrast, blur), _BEYOND))

    @classmethod
    def of_others(cls, pattern: Pattern) -> Iterator[ExpectedSteps]:
        """Those of all other sequences, of the same contrasts."""
        for each in SEQUENCES:
            if (each != pattern.sequence).any():
                contrast = np.where(each, 1, pattern.low_contrast).astype(np.float32)
                yield cls(0, _steps(contrast, BLURS[0]))

    @property
    def size(self) -> float:
        """The largest step."""
        return float(np.abs(self.steps).max())


def _steps(contrast: NDArray[np.float32], blur: float) -> NDArray[np.float64]:
    """Steps as they are seen of fringes of these contrasts through a blur."""
    size = len(contrast) * _SAMPLES
    phase = 2 * math.pi * ((np.arange(size) + 0.5) / _SAMPLES - 0.25)
    light = 1 + np.repeat(contrast, _SAMPLES) * np.cos(phase)
    sigma = math.sqrt(blur) * _SAMPLES / (2 * math.pi)
    seen: Any = cv2.GaussianBlur(_LEVEL * light[None], (0, 1), sigmaX=sigma, sigmaY=1)
    everywhere = np.ones((1, size), bool)
    found = fringe_contrasts(
        seen.astype(np.float32), phase[None].astype(np.float32), everywhere, everywhere
    )
    return np.diff(found.logarithm.astype(float))
