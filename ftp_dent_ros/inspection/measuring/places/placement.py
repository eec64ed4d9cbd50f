"""Where a dent lies in the frame of its cloud."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.outlines.outline import Outline
from ftp_dent_ros.inspection.measuring.outlines.patch import Patch
from ftp_dent_ros.inspection.measuring.skin.contour import Contour

# Of a profile, in lengths of the dent.
_PROFILE = np.linspace(-0.83, 0.83, 81)

Vector = NDArray[np.float64]


def axis_along(contour: Contour, normal: Vector, angle: float) -> Vector:
    """Unit vector along the skin at an angle from the contour's x axis."""
    along = contour.axes[0] * math.cos(angle) + contour.axes[1] * math.sin(angle)
    along = along - normal * (along @ normal)
    return along / np.linalg.norm(along)


def on_skin(
    contour: Contour, outline: Outline, depth: float
) -> tuple[Vector, Vector, NDArray[np.float64]]:
    """Centre of an outline, normal there and the outline as a closed line, in the cloud's frame.

    Of shapes (3,), (3,) and (n, 3); the line lies `depth` metres below the contour.
    """
    x, y = outline.centre
    places = (
        np.concatenate([axis, axis[:1], [middle]])
        for axis, middle in ((outline.x, x), (outline.y, y))
    )
    feet, outward = contour.foot(*places)
    return feet[-1], outward[-1], feet[:-1] - depth * outward[:-1]


def profiles_of(
    patch: Patch, sign: int, x: float, y: float, angle: float, sizes: Vector
) -> Vector:
    """Depths along the length and across it, shape (2, n, 2), a third of each beyond both ends."""
    along = sizes[:, None] * _PROFILE
    c, s = math.cos(angle), math.sin(angle)
    at_x, at_y = x + along * [[c], [-s]], y + along * [[s], [c]]
    depth = np.where(patch.is_known(at_x, at_y), sign * patch.at(at_x, at_y), np.nan)
    return np.stack([along, depth], axis=-1)
