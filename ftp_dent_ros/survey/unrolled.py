"""A skin that is curved one way, unrolled: along the axis, and around it."""

from __future__ import annotations

import math
from collections.abc import Iterable
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
    """A cylinder, or a plane, near a skin.

    Attributes
    ----------
    origin : ndarray, shape (3,)
        On the skin, metres; where x and y are 0.
    axis, around, normal : ndarray, shape (3,)
        Unit vectors there: of x, of y, and outward.
    radius : float
        Metres, positive if the skin bends away from who looks at it; infinite for a plane.
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
        # The radius by how normals tilt with y; one larger than this is a plane, metres.
        y = along @ around
        slope = float(y @ (normals @ around) / max(y @ y, 1e-12))
        radius = math.inf if abs(slope) < 1 / 100.0 else 1 / slope
        # Towards growing y the outward normal turns that way where the skin bends away.
        return cls(origin, axis, around, normal, radius)

    def place(self, points: NDArray) -> NDArray[np.float64]:
        """Place along the axis (x), around it (y), and height above it, metres, shape (..., 3)."""
        off = np.asarray(points, float) - self.origin
        x, y, z = off @ self.axis, off @ self.around, off @ self.normal
        if math.isinf(self.radius):
            return np.stack([x, y, z], axis=-1)
        sign = math.copysign(1.0, self.radius)
        from_axis = z + self.radius
        y_out = self.radius * np.arctan2(sign * y, sign * from_axis)
        height = sign * np.hypot(y, from_axis) - self.radius
        return np.stack([x, y_out, height], axis=-1)

    def points(self, place: NDArray, height: NDArray | float = 0.0) -> NDArray[np.float64]:
        """Points of places x, y of shape (..., 2) at a height above them, metres, (..., 3)."""
        x, y = np.asarray(place, float)[..., 0], np.asarray(place, float)[..., 1]
        if math.isinf(self.radius):
            along, up = y, np.broadcast_to(height, y.shape)
        else:
            angle, from_axis = y / self.radius, self.radius + height
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
    cells : ndarray, shape (n, 2), int
        Its cells: row and column.
    """

    place: NDArray[np.float64]
    size: NDArray[np.float64]
    area: float
    cells: NDArray[np.int64]


def find_gaps(measured: NDArray[np.bool_], low: NDArray[np.float64]) -> list[Gap]:
    """What was not measured between what was, the largest first.

    Parameters
    ----------
    measured : ndarray, shape (rows, columns), bool
        Of the cells of the unrolled skin; x goes with columns.
    low : ndarray, shape (2,)
        x and y of the first cell's corner, metres.
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
    gaps = []
    for label in range(1, count):
        left, top, *sides, cells = boxes[label]
        box = labels[top : top + sides[1], left : left + sides[0]] == label
        places = np.argwhere(box) + np.array([top, left])
        # Measured cells lie on both sides of most of it, across where it is narrower: else it is
        # a notch in the rim, or a corner that closing rounds off.
        across = [axis for axis in (0, 1) if sides[1 - axis] == min(sides)]
        if all(between[axis][tuple(places.T)].mean() >= 0.5 for axis in across):
            place = low + CELL * (middles[label] + 0.5)
            gaps.append(Gap(place, CELL * np.array(sides), float(cells * CELL**2), places))
    return sorted(gaps, key=lambda gap: -gap.area)


def gap_mask(gaps: Iterable[Gap], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Mask of the cells of all gaps."""
    mask = np.zeros(shape, bool)
    for gap in gaps:
        mask[tuple(gap.cells.T)] = True
    return mask
