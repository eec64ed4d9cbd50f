"""A skin that is curved one way, unrolled: along its lines, and around it.

A cylinder is a cone that does not narrow, and a plane one whose radius is so large that no cell
tells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from ftp_dent_ros.rigid import Array

#: Side of a cell of what was measured, metres: the least dent is as wide.
CELL = 0.01
#: Of a skin, square metres: more than the fuselage of an airliner has.
LARGEST = 1000.0
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Unrolled:
    """A cone near a skin, laid flat: lengths on it are those on the map.

    Attributes
    ----------
    origin : ndarray, shape (3,)
        On the skin, metres; where x and y are 0.
    axis, around, normal : ndarray, shape (3,)
        Unit vectors there: of x, of y, and outward.
    radius : float
        Of the bend along y there, metres, positive if the skin bends away from who looks at it;
        1000 km for a plane.
    taper : float
        Between the cone's axis and its lines, radians, positive if it narrows towards growing x;
        0 of a cylinder.
    """

    origin: Array
    axis: Array
    around: Array
    normal: Array
    radius: float
    taper: float = 0.0

    @classmethod
    def through(cls, points: Array, normals: Array, up: Array = _UP) -> Unrolled:
        """Cone near points of shape (n, 3), by them and their outward normals.

        Its y is up, as far as the skin stands, or around the skin.
        """
        origin, normal = points.mean(axis=0), normals.mean(axis=0)
        # The axis is across all normals.
        axis = np.linalg.svd(normals, full_matrices=False)[2][2]
        axis = axis - normal * (axis @ normal) / (normal @ normal)
        start = np.stack([axis, np.cross(normal, axis), normal])
        start /= np.linalg.norm(start, axis=1)[:, None]
        y = (points - origin) @ start[1]
        bend = float(y @ (normals @ start[1])) / max(float(y @ y), 1e-12)

        def cone(form: Array) -> Unrolled:
            x, y, z = Rotation.from_rotvec(form[1:4] @ start).apply(start)
            curve = math.copysign(max(abs(form[4]), 1e-6), form[4])
            return cls(origin + form[0] * start[2], x, y, z, 1 / curve, float(form[5]))

        # Dents and laps, metres, that do not bend the form.
        form = least_squares(
            lambda form: cone(form).place(points)[:, 2],
            [0.0, 0.0, 0.0, 0.0, bend, 0.0],
            x_scale=[1e-3, 1e-2, 1e-2, 1e-2, 0.1, 0.1],
            loss='soft_l1',
            f_scale=1e-3,
            max_nfev=30,
        ).x
        found = cone(form)
        y = found.place(points)[:, 1]
        # What bends by less over all of it, metres, is flat to the eye: a plane.
        if np.ptp(y) ** 2 / (8 * abs(found.radius)) < 1e-3:
            level = up - found.normal * (up @ found.normal)
            around = level / np.linalg.norm(level)
            right = np.cross(around, found.normal)
            return replace(found, axis=right, around=around, radius=1e6, taper=0.0)
        if found.around @ up + found.axis @ up / 10 > 0:
            return found
        return replace(found, axis=-found.axis, around=-found.around, taper=-found.taper)

    @property
    def _lines(self) -> tuple[Array, float, float]:
        """Unit vectors along the cone's axis, out and aside, (3, 3); cosine and sine of taper."""
        cosine, sine = math.cos(self.taper), math.sin(self.taper)
        along = cosine * self.axis + sine * self.normal
        out = cosine * self.normal - sine * self.axis
        return np.stack([along, out, self.around]), cosine, sine

    def place(self, points: NDArray) -> Array:
        """Place along x and y, and height above it, metres, shape (..., 3)."""
        lines, cosine, sine = self._lines
        off = np.asarray(points, float) - self.origin + self.radius * self.normal
        along, out, aside = np.moveaxis(off @ lines.T, -1, 0)
        sign = math.copysign(1.0, self.radius)
        from_axis, angle = sign * np.hypot(out, aside), np.arctan2(sign * aside, sign * out)
        height = from_axis * cosine + along * sine - self.radius
        # Along a line of the cone, and how far the skin is from its axis there.
        line = along * cosine - from_axis * sine
        wide = self.radius * cosine - line * sine
        half = angle * sine / 2
        x = line + wide * angle * np.sin(half) * np.sinc(half / np.pi)
        y = wide * angle * np.sinc(2 * half / np.pi)
        return np.stack([x, y, height], axis=-1)

    def points(self, place: NDArray, height: NDArray | float = 0.0) -> Array:
        """Points of places x, y of shape (..., 2) at a height above them, metres, (..., 3)."""
        lines, cosine, sine = self._lines
        sine = math.copysign(max(abs(sine), 1e-12), sine)
        x, y = np.asarray(place, float)[..., 0], np.asarray(place, float)[..., 1]
        # By the cone's tip, which may be ever so far off.
        tip = sine / cosine / self.radius
        line = (2 * x - tip * (x * x + y * y)) / (1 + np.hypot(1 - tip * x, tip * y))
        angle = np.arctan2(tip * y, 1 - tip * x) / sine
        height = np.asarray(height, float)
        from_axis = self.radius * cosine - line * sine + height * cosine
        along = self.radius * sine + line * cosine + height * sine
        parts = along, from_axis * np.cos(angle), from_axis * np.sin(angle)
        return self.origin - self.radius * self.normal + np.stack(parts, axis=-1) @ lines


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
    # Of the cells that have measured ones on both sides, along columns and along rows.
    down, along = (_between(measured), _between(measured.T).T)
    mask = down & along
    for between, found in ((down, mask), (along.T, mask.T)):
        count, labels, boxes, _ = cv2.connectedComponentsWithStats(
            between.astype(np.uint8), connectivity=4
        )
        for label, (left, top, width, height, cells) in enumerate(boxes[:count]):
            box = slice(top, top + height), slice(left, left + width)
            # So it is across where it is narrower: else it is a notch in the rim.
            if label and cells < width**2:
                found[box] |= labels[box] == label
    count, _, boxes, middles = cv2.connectedComponentsWithStats(
        mask.astype(np.uint8), connectivity=4
    )
    gaps = [
        Gap(low + CELL * (middles[k] + 0.5), CELL * np.array(boxes[k, 2:4], float), area)
        for k, area in enumerate((boxes[:, 4] * CELL**2).tolist())
        if k
    ]
    return sorted(gaps, key=lambda gap: -gap.area), mask


def _between(measured: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Cells that were not measured, with some of their column that were on both sides."""
    before, after = (np.logical_or.accumulate(measured[::way])[::way] for way in (1, -1))
    return before & after & ~measured
