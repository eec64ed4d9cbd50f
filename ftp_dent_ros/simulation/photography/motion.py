"""Motion during an exposure, as the camera's rays see it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

Field = NDArray[np.float64]


class Rays(NamedTuple):
    """Camera rays, each at its moment of the exposure.

    Attributes
    ----------
    directions : ndarray, shape (n, 3)
        In the camera's frame.
    origin : ndarray, shape (3,) or (n, 3)
        Where the rays start in the frame that the camera has in mid-exposure.
    towards : ndarray, shape (n, 3)
        Their directions in that frame; a point at ``origin + scale * towards`` there is at
        ``scale * directions`` in the camera's frame at the ray's moment.
    """

    directions: Field
    origin: Field
    towards: Field


def still(directions: Field) -> Rays:
    """Rays of shape (n, 3) in mid-exposure."""
    return Rays(directions, np.zeros(3), directions)


@dataclass(frozen=True, eq=False)
class Motion:
    """How the surface moves in the camera's frame during the exposure, at constant rates.

    Attributes
    ----------
    rotation : ndarray, shape (3,)
        Rotation vector from the exposure's begin to its end, radians.
    translation : ndarray, shape (3,)
        Metres.
    """

    rotation: Field = field(default_factory=lambda: np.zeros(3))
    translation: Field = field(default_factory=lambda: np.zeros(3))

    def __bool__(self) -> bool:
        return bool(self.rotation.any() or self.translation.any())

    def rays(self, directions: Field, moments: ArrayLike) -> Rays:
        """Rays at moments of the exposure, with the motion of the surface undone.

        Parameters
        ----------
        directions : ndarray, shape (..., k, 3)
            In the camera's frame.
        moments : ndarray, shape (k,)
            -1/2 at the exposure's begin, 1/2 at its end.
        """
        flat = directions.reshape(-1, 3)
        if not self:
            return still(flat)
        moments = np.asarray(moments, float)[:, None]
        turn = Rotation.from_rotvec(-moments * self.rotation).as_matrix()
        start = -(turn @ (moments * self.translation)[..., None])[..., 0]
        towards = np.einsum('kij,...kj->...ki', turn, directions)
        origin = np.broadcast_to(start, directions.shape)
        return Rays(flat, origin.reshape(-1, 3), towards.reshape(-1, 3))
