"""A skin that is curved one way, unrolled: along the axis, and around it.

A plane is a cylinder whose radius is so large that no cell tells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

#: Side of a cell of what was measured, metres: the least dent is as wide.
CELL = 0.01
#: Of a skin, square metres: more than the fuselage of an airliner has.
LARGEST = 1000.0


@dataclass(frozen=True, eq=False)
class Unrolled:
    """A cylinder near a skin.

    Attributes
    ----------
    origin : ndarray, shape (3,)
        On the skin, metres; where x and y are 0.
    axis, around, normal : ndarray, shape (3,)
        Unit vectors there: of x, of y, and outward.
    radius : float
        Metres, positive if the skin bends away from who looks at it; 1000 km for a plane.
    """

    origin: NDArray[np.float64]
    axis: NDArray[np.float64]
    around: NDArray[np.float64]
    normal: NDArray[np.float64]
    radius: float

    @classmethod
    def through(cls, points: NDArray[np.float64], normals: NDArray[np.float64]) -> Unrolled:
        """Cylinder of points of shape (n, 3) and their outward normals."""
        origin, normal = points.mean(axis=0), normals.mean(axis=0)
        normal /= np.linalg.norm(normal)
        # The axis is across all normals; of a plane, along the longer side.
        spread = np.cov((normals - np.outer(normals @ normal, normal)).T)
        along = points - origin
        along = along - np.outer(along @ normal, normal)
        _, _, sides = np.linalg.svd(along, full_matrices=False)
        bends = np.array([side @ spread @ side for side in sides[:2]])
        axis = sides[int(np.argmin(bends))] if bends.max() > 4 * bends.min() else sides[0]
        around = np.cross(normal, axis)
        # The curvature by how normals tilt with y: towards growing y the outward normal turns that
        # way where the skin bends away.
        y = along @ around
        bend = float(y @ (normals @ around) / max(y @ y, 1e-12))
        return cls(origin, axis, around, normal, 1 / math.copysign(max(abs(bend), 1e-6), bend))

    def place(self, points: NDArray) -> NDArray[np.float64]:
        """Place along the axis (x), around it (y), and height above it, metres, shape (..., 3)."""
        off = np.asarray(points, float) - self.origin
        x, y, z = off @ self.axis, off @ self.around, off @ self.normal
        sign = math.copysign(1.0, self.radius)
        from_axis = z + self.radius
        y_out = self.radius * np.arctan2(sign * y, sign * from_axis)
        height = sign * np.hypot(y, from_axis) - self.radius
        return np.stack([x, y_out, height], axis=-1)

    def points(self, place: NDArray, height: NDArray | float = 0.0) -> NDArray[np.float64]:
        """Points of places x, y of shape (..., 2) at a height above them, metres, (..., 3)."""
        x, y = np.asarray(place, float)[..., 0], np.asarray(place, float)[..., 1]
        angle, from_axis = y / self.radius, self.radius + np.asarray(height, float)
        along, up = from_axis * np.sin(angle), from_axis * np.cos(angle) - self.radius
        return (
            self.origin
            + x[..., None] * self.axis
            + along[..., None] * self.around
            + up[..., None] * self.normal
        )


@dataclass(frozen=True, eq=False)
class Gap:
    """Cells that were not measured, side by side, between cells that were.

    Attributes
    ----------
    place : ndarray, shape (2,)
        Its middle, unrolled, metres.
    size : ndarray, shape (2,)
        Along x and y, metres.
    area : float
        Square metres.
    """

    place: NDArray[np.float64]
    size: NDArray[np.float64]
    area: float


def find_gaps(
    measured: NDArray[np.bool_], low: NDArray[np.float64]
) -> tuple[list[Gap], NDArray[np.bool_]]:
    """What was not measured between what was.

    Parameters
    ----------
    measured : ndarray, shape (rows, columns), bool
        Of the cells of the unrolled skin; x goes with columns.
    low : ndarray, shape (2,)
        x and y of the first cell's corner, metres.

    Returns
    -------
    gaps : list of Gap
        The largest first.
    mask : ndarray, shape (rows, columns), bool
        Of the cells of all gaps.
    """
    # A gap is no wider than this; a wider one is the rim of what was flown over; metres.
    reach = int(np.ceil(0.1 / CELL / 2))
    wide, size = np.pad(measured.astype(np.uint8), reach), 2 * reach + 1
    closed, *between = (
        cv2.morphologyEx(wide, cv2.MORPH_CLOSE, np.ones(square, np.uint8))[
            reach:-reach, reach:-reach
        ]
        > 0
        for square in ((size, size), (size, 1), (1, size))
    )
    count, labels, boxes, middles = cv2.connectedComponentsWithStats(
        (closed & ~measured).astype(np.uint8), connectivity=4
    )
    gaps, mask = [], np.zeros(measured.shape, bool)
    for label in range(1, count):
        left, top, width, height, cells = boxes[label]
        box = slice(top, top + height), slice(left, left + width)
        inside = labels[box] == label
        # Measured cells lie on both sides of most of it, across where it is narrower: else it is
        # a notch in the rim, or a corner that closing rounds off.
        across = [axis for axis, side in ((0, height), (1, width)) if side == min(width, height)]
        if all(between[axis][box][inside].mean() >= 0.5 for axis in across):
            place, sides = low + CELL * (middles[label] + 0.5), CELL * np.array([width, height])
            gaps.append(Gap(place, sides, float(cells * CELL**2)))
            mask[box] |= inside
    return sorted(gaps, key=lambda gap: -gap.area), mask
