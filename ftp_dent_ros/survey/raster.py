"""From a cloud's own grid, which is its camera's, to regular ones: of a plane, of the skin."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.polynomial.polynomial import polygrid2d, polyvander2d
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.errors import CloudError
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rigid import Array
from ftp_dent_ros.survey.unrolled import LARGEST, Unrolled

Grid = NDArray[np.float32]
Window = tuple[slice, slice]


class Raster:
    """A regular grid of pixels on the unrolled skin.

    Parameters
    ----------
    skin : Unrolled
    low, high : ndarray, shape (2,)
        Least and largest x and y, metres.
    pitch : float
        Side of a pixel, metres.
    together : int
        Rows and columns are whole multiples of it.

    Raises
    ------
    CloudError
        The skin would be too large.
    """

    def __init__(
        self, skin: Unrolled, low: NDArray, high: NDArray, pitch: float, together: int = 1
    ) -> None:
        side, self._whole = pitch * together, together
        self.skin, self.pitch, self.low = skin, pitch, np.floor(low / side) * side
        columns, rows = (np.ceil((high - self.low) / side).astype(int) + 1) * together
        self.shape = int(rows), int(columns)
        if rows * columns * pitch**2 > LARGEST:
            raise CloudError(
                f'the clouds are spread over {columns * pitch:.0f} m by {rows * pitch:.0f} m: '
                'check their poses'
            )

    def places(self, cloud: Cloud, pose: Pose) -> Array:
        """Places of a cloud on the skin, as of `Unrolled.place`; NaN where it has no point."""
        points = np.where(cloud.valid[..., None], cloud.points, np.nan).astype(float)
        return self.skin.place(pose.apply(points))

    def window(self, places: Array) -> Window:
        """Rows and columns about places of shape (n, 2 or more), as far as the raster goes."""
        at, whole = (places[:, :2] - self.low) / self.pitch, self._whole
        # Of pixels: about a cloud its grid may reach into them.
        low, high = np.floor((at.min(axis=0) - 4) / whole), np.ceil((at.max(axis=0) + 4) / whole)
        sides = whole * np.array([low, high])
        (left, down), (right, up) = np.clip(sides, 0, self.shape[::-1]).astype(int)
        return slice(down, up), slice(left, right)

    def corner(self, window: Window) -> Array:
        """X and y of the middle of a window's first pixel."""
        return self.low + self.pitch * (np.array([window[1].start, window[0].start]) + 0.5)

    def in_pixels(self, places: Array, window: Window) -> tuple[Grid, Grid]:
        """Columns and rows in a window at which places of shape (..., 2 or more) lie."""
        at = (places[..., :2] - self.corner(window)) / self.pitch
        return at[..., 0].astype(np.float32), at[..., 1].astype(np.float32)

    def laid(
        self, cloud: Cloud, pose: Pose, known: NDArray[np.bool_]
    ) -> tuple[Array, Window, Grid, Grid]:
        """A cloud's points on the skin, and the pixels about those that are known.

        Parameters
        ----------
        cloud : Cloud
        pose : Pose
        known : ndarray, shape (height, width), bool
            Points that are taken.

        Returns
        -------
        places : ndarray, shape (height, width, 3)
            As of `places`.
        window : (slice, slice)
        columns, rows : ndarray, shape (window's rows, window's columns)
            Where on the cloud's grid the window's pixels lie.
        """
        places, some = self.places(cloud, pose), some_of(known)
        window = self.window(places[known])
        size = np.array([each.stop - each.start for each in window[::-1]])
        # From the corner on, single precision is enough.
        flat = np.where(known[..., None], places[..., :2] - self.corner(window), np.nan)
        at = cells(flat.astype(np.float32), some, np.zeros(2), self.pitch, size)
        return places, window, *at


def some_of(mask: NDArray[np.bool_], about: int = 1000) -> tuple[NDArray, NDArray]:
    """Rows and columns of about so many cells of a mask, on a regular grid."""
    step = max(1, math.isqrt(np.count_nonzero(mask) // about))
    row, column = np.nonzero(mask[::step, ::step])
    return step * row, step * column


def cells(
    places: Grid, some: tuple[NDArray, NDArray], low: NDArray, size: float, count: NDArray
) -> tuple[Grid, Grid]:
    """Columns and rows of a cloud's grid at which the cells' x and y are.

    Parameters
    ----------
    places : ndarray, shape (height, width, 2), float32
        x and y of the cloud in the cells' frame, metres; NaN where there is no point.
    some : (rows, columns)
        Of points by which the way back is found, nearly.
    low : ndarray, shape (2,)
        x and y of the first cell, metres.
    size : float
        Of a cell, metres.
    count : ndarray, shape (2,)
        Cells along x and y.
    """
    place, indices = places[some].astype(float), np.stack(some[::-1], axis=-1)
    low_place, high_place = place.min(axis=0), place.max(axis=0)
    middle, half = (low_place + high_place) / 2, np.maximum((high_place - low_place) / 2, 1e-12)
    # What bends a camera's grid over a skin is cubic at most.
    across, down = ((place - middle) / half).T
    terms = polyvander2d(across, down, [3, 3])
    weights = np.linalg.lstsq(terms, indices, rcond=None)[0].reshape(4, 4, -1)
    x, y = (low[axis] + size * np.arange(count[axis]) for axis in (0, 1))
    scaled = (x - middle[0]) / half[0], (y - middle[1]) / half[1]
    u, v = polygrid2d(*scaled, weights).swapaxes(1, 2).astype(np.float32)
    # How column and row change with x and y: as in the middle is near enough.
    changes = np.stack([weights[1, 0] / half[0], weights[0, 1] / half[1]])
    along_x, along_y = changes.astype(np.float32)
    wanted_x, wanted_y = x.astype(np.float32), y.astype(np.float32)[:, None]
    # After two corrections it is exact.
    for _ in range(2):
        here_x, here_y = cv2.split(remap(places, u, v))
        # Where there is no point the first guess stays.
        off_x, off_y = np.nan_to_num(wanted_x - here_x), np.nan_to_num(wanted_y - here_y)
        u = u + along_x[0] * off_x + along_y[0] * off_y
        v = v + along_x[1] * off_x + along_y[1] * off_y
    return u, v


def remap(field: NDArray[Any], u: Grid, v: Grid, how: int = cv2.INTER_LINEAR) -> Grid:
    """Values of a field at columns `u` and rows `v`, as OpenCV interpolates; NaN beyond it."""
    result: Any = cv2.remap(
        field.astype(np.float32, copy=False),
        np.where(u > -9, u, np.float32(-9)),
        np.where(v > -9, v, np.float32(-9)),
        how,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=(np.nan,) * 4,
    )
    return result
