"""What the page draws of dents and clouds."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.robust import NORMAL_SPREAD

_ROUND = 32  # points of an outline
# Standard deviations of the points off a quadric beyond which one is a dent's; the least such
# deviation, metres.
_OUTLYING, _LEAST = 2.5, 1e-7


def ring(dent: dict[str, Any]) -> NDArray[np.float64]:
    """Ellipse of a dent's length and width on the skin, in the map."""
    axis, normal = np.array(dent['axis'], float), np.array(dent['normal'], float)
    turn = np.linspace(0, 2 * np.pi, _ROUND, endpoint=False)[:, None]
    length, width = (float(dent[name] or 0) * 0.5e-3 for name in ('length_mm', 'width_mm'))
    along, across = length * np.cos(turn) * axis, width * np.sin(turn) * np.cross(normal, axis)
    return np.array(dent['place'], float) + along + across


def corners(cloud: Cloud) -> NDArray[np.float64] | None:
    """The four measured points nearest to the grid's corners, in order around it."""
    rows, columns = np.nonzero(cloud.valid)
    if len(rows) < 4:
        return None
    picked = [
        int(np.argmin(sign_row * rows + sign_column * columns))
        for sign_row, sign_column in ((1, 1), (1, -1), (-1, -1), (-1, 1))
    ]
    return cloud.points[rows[picked], columns[picked]].astype(float)


def relief(cloud: Cloud) -> bytes:
    """Points and their deviation from the smooth skin, a quadric over the grid."""
    valid = cloud.valid
    points = cloud.points[valid].astype(float)
    if len(points) < 10:
        return b''
    centre = points.mean(axis=0)
    x, y, z = (points - centre).T
    basis = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    use = np.ones(len(z), bool)
    for _ in range(3):  # without the dents themselves
        coefficients, *_ = np.linalg.lstsq(basis[use], z[use], rcond=None)
        off = z - basis @ coefficients
        use = np.abs(off) <= _OUTLYING * max(NORMAL_SPREAD * float(np.median(np.abs(off))), _LEAST)
    # Away from the camera is into the skin: a dent is positive.
    values = np.column_stack([points - centre, 1e3 * off])
    return values.astype('<f4').tobytes()
