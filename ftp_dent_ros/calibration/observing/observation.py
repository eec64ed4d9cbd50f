"""What is observed of the board in one pose: correspondences, of this tool or any other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Observation:
    """A board's corners in one pose, in the order of the board's points.

    Attributes
    ----------
    name : str
        Of the pose, for sentences.
    camera : ndarray, shape (n, 2)
        Camera pixels (u, v); NaN where a corner is not seen.
    projector : ndarray, shape (n, 2)
        Projector pixels (u, v) that light the corners; NaN where not known, one axis alone too.
    """

    name: str
    camera: NDArray[np.float64]
    projector: NDArray[np.float64]

    @property
    def has_projector(self) -> bool:
        """Whether the projector's coordinates of any corner are known."""
        return bool(np.isfinite(self.projector).any())
