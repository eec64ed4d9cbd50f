"""A cloud as a small mesh for the page's 3-D view."""

from __future__ import annotations

import base64
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pose import Pose

# What stands for no measurement among 16 bits of micrometres.
_MISSING = -32768
_MICROMETRES = 1e6


@dataclass(frozen=True, eq=False)
class Mesh:
    """Every n-th point of a cloud, on its grid.

    Attributes
    ----------
    points : ndarray, shape (rows, columns, 3), float32
        In the report's frame, metres; NaN where nothing is measured.
    inward : ndarray, shape (rows, columns, 3), float32
        Unit vectors into the skin.
    deviation : ndarray, shape (rows, columns), float32
        Depth below the undeformed contour, metres.
    """

    points: NDArray[np.float32]
    inward: NDArray[np.float32]
    deviation: NDArray[np.float32]

    @classmethod
    def of(
        cls,
        points: NDArray[np.float32],
        deviation: NDArray[np.float32],
        pose: Pose,
        vertices: int,
    ) -> Mesh:
        """Mesh of at most about so many vertices, moved to the parent frame of `pose`."""
        step = max(1, math.ceil(math.sqrt(deviation.size / vertices)))
        half = step // 2
        points = pose.apply(points[half::step, half::step])
        if min(points.shape[:2]) < 2:
            inward = np.zeros_like(points)
        else:
            with np.errstate(invalid='ignore'):
                # Along the columns, times down the rows: away from the camera.
                normal = np.cross(np.gradient(points, axis=1), np.gradient(points, axis=0))
                inward = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
        return cls(points, inward.astype(np.float32), deviation[half::step, half::step])

    def packed(self, origin: NDArray[np.float64]) -> dict[str, Any] | None:
        """Mesh about an origin for the page's script, or None if there is nothing in it.

        Little-endian 16-bit positions (with a scale and a middle), deviations in micrometres
        (-32768: nothing there), and 8-bit directions, each as base64.
        """
        valid = np.isfinite(self.points).all(-1) & np.isfinite(self.inward).all(-1)
        valid &= np.isfinite(self.deviation)
        if not valid.any():
            return None
        found = self.points[valid] - origin
        middle = (found.min(axis=0) + found.max(axis=0)) / 2
        scale = max(float(np.abs(found - middle).max()), 1e-9) / 32000
        points = np.zeros((*valid.shape, 3), '<i2')
        points[valid] = np.round((found - middle) / scale)
        deviation = np.full(valid.shape, _MISSING, '<i2')
        limited = np.clip(self.deviation[valid] * _MICROMETRES, -32000, 32000)
        deviation[valid] = np.round(limited)
        inward = np.zeros((*valid.shape, 4), 'i1')
        inward[valid, :3] = np.round(self.inward[valid] * 127)
        return {
            'rows': valid.shape[0],
            'columns': valid.shape[1],
            'middle': [float(value) for value in middle],
            'scale': scale,
            'points': _text(points),
            'deviation': _text(deviation),
            'inward': _text(inward),
        }


def _text(values: NDArray) -> str:
    return base64.b64encode(values.tobytes()).decode('ascii')
