"""What all clouds of a place tell of it together: heights averaged on the unrolled skin."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.raster import Grid, Raster, Window, remap
from ftp_dent_ros.survey.unrolled import Unrolled

# Side of a pixel: narrower than the points of a cloud lie apart, metres.
PIXEL = 0.001


class Fusion(Raster):
    """Weighted means of the heights of clouds above the unrolled skin, and their scatter.

    Parameters
    ----------
    skin : Unrolled
    low, high : ndarray, shape (2,)
        Least and largest x and y, metres.

    Raises
    ------
    CloudError
        The skin would be too large.
    """

    def __init__(self, skin: Unrolled, low: NDArray, high: NDArray) -> None:
        super().__init__(skin, low, high, PIXEL)
        # Weight, weighted mean and squares about it, weighted resolution, and number of clouds:
        # what is never written takes no memory.
        self._weight, self._mean, self._squares, self._resolution = np.zeros(
            (4, *self.shape), np.float32
        )
        self._count = np.zeros(self.shape, np.uint16)

    def add(self, cloud: Cloud, pose: Pose) -> None:
        """Another cloud, in its camera's frame; one that tells no uncertainty is left out."""
        known = cloud.valid & (cloud.sigma > 0)
        if not known.any():
            return
        places, window, u, v = self.laid(cloud, pose, known)
        height = remap(np.where(known, places[..., 2], np.nan), u, v, cv2.INTER_CUBIC)
        sigma = remap(cloud.sigma, u, v)
        resolution = remap(cloud.resolution, u, v)
        known = np.isfinite(height) & (sigma > 0) & np.isfinite(resolution)
        weight = np.where(known, 1 / np.square(np.where(known, sigma, 1)), 0).astype(np.float32)
        total = self._weight[window] + weight
        off = np.where(known, height - self._mean[window], 0)
        moved = off * weight / np.maximum(total, 1)
        self._mean[window] += moved
        self._squares[window] += weight * off * (off - moved)
        self._resolution[window] += np.where(known, resolution * weight, 0)
        self._weight[window] = total
        self._count[window] += known

    def fused(self, cloud: Cloud, pose: Pose) -> Cloud:
        """A cloud that was added, with what all others tell of its points.

        Its uncertainty is what bare skin shows by chance. Where the clouds agree with each other
        worse than this one is sure of itself, it stays as it is.
        """
        places = self.places(cloud, pose)
        window = self.window(places[cloud.valid])
        mean, wavelength, scattered = self._together(window)
        u, v = self.in_pixels(np.where(cloud.valid[..., None], places, -np.inf), window)
        height = remap(mean, u, v, cv2.INTER_CUBIC)
        spread = np.sqrt(remap(scattered, u, v))
        better = cloud.valid & np.isfinite(height) & (spread < cloud.sigma)
        # Of the skin's normal that of the cloud's middle: heights differ by little.
        middle = places[cloud.valid].mean(axis=0)[:2]
        up = pose.rotation.inv().apply(self.skin.points(middle, 1.0) - self.skin.points(middle))
        moved = np.where(better, height - places[..., 2], 0)
        points = cloud.points + moved[..., None] * up
        resolution = np.where(better, remap(wavelength, u, v), cloud.resolution)
        return replace(
            cloud,
            points=points.astype(np.float32),
            sigma=np.where(better, spread, cloud.sigma).astype(np.float32),
            resolution=resolution.astype(np.float32),
        )

    def heights(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points of the skin above or below places, shape (..., 3), in the frame of the poses.

        NaN where fewer than two clouds tell of one.
        """
        flat = self.skin.place(places)[..., :2]
        window = self.window(flat.reshape(-1, 2))
        at = self.in_pixels(flat, window)
        height = remap(self._together(window)[0], *at, cv2.INTER_CUBIC)
        return self.skin.points(flat, height.astype(float))

    def _together(self, window: Window) -> tuple[Grid, Grid, Grid]:
        """What clouds tell together of the pixels of a window; NaN where fewer than two do.

        Returns
        -------
        mean, resolution : ndarray, shape (rows, columns), float32
            Metres.
        scattered : ndarray, shape (rows, columns), float32
            Variance of the mean if the clouds' errors are each their own, as those of bare skin
            are: the fringes lie elsewhere in each cloud. What scatters more than it tells counts
            as that.
        """
        weight, count = self._weight[window], self._count[window].astype(np.float32)
        several = count > 1
        # Side of the square over which the scatter of several clouds is pooled, metres: it holds
        # several of the places over which noise is correlated, and no more than a dent.
        side = 2 * round(0.015 / PIXEL / 2) + 1
        free = _pooled(np.where(several, count - 1, 0), side)
        ratio = _pooled(np.where(several, self._squares[window], 0), side) / np.maximum(free, 1e-6)
        stated = count / np.maximum(weight, 1)  # mean of the variances that the clouds tell
        mean, resolution, scattered = (
            np.where(several, values, np.float32(np.nan)).astype(np.float32)
            for values in (
                self._mean[window],
                self._resolution[window] / np.maximum(weight, 1),
                stated / np.maximum(count, 1) * np.maximum(ratio, 1),
            )
        )
        return mean, resolution, scattered


def _pooled(values: NDArray, side: int) -> Grid:
    result: Any = cv2.boxFilter(values.astype(np.float32), -1, (side, side), normalize=False)
    return np.maximum(result, 0)
