"""The cloud, checked and averaged to cells as coarse as the smallest dent allows."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.cloud.response import halved
from ftp_dent_ros.dents.dent import SmallestDent
from ftp_dent_ros.errors import CloudError
from ftp_dent_ros.robust import median

#: Points that a skin is known by, roughly: clouds of fewer are refused, and fits that are made
# again and again are made to so many.
FEW = 300
# A cloud whose neighbours lie so far apart is not in metres.
_WIDEST_SPACING = 0.05
#: Points that medians and first contours are taken of, about: for speed.
ENOUGH = 5000
#: Cells across the smallest dent.
CELLS = 5
#: Of a dent's depth, where its sizes are measured and its saddle to another one lies lower; and of
# the smallest one's, what matters.
LEVEL = 0.1
#: Of the smallest depth, what a mean over a part of a dent has at least, and skins stand apart by.
LEAST = 0.5
#: Spacings over which points hang together: what lies farther off is on another skin, and a cloud
# that does not state its resolution shows waves that long by half.
TOGETHER = 4.0
#: Smallest widths that a skin is wide at least, and that a gap in it is across at most.
WIDE = 3.0


@dataclass(frozen=True, eq=False)
class Lattice:
    """Means of blocks of the cloud, as it was before it was denoised.

    Attributes
    ----------
    points : ndarray, shape (rows, columns, 3), float32
        Relative to `origin`, metres; 0 where not `valid`.
    valid : ndarray, shape (rows, columns), bool
    sigma : ndarray, shape (rows, columns), float32, or None
        Standard uncertainty of the points along their rays, where the cloud states it.
    resolution : ndarray, shape (rows, columns), float32, or None
        Wavelength of which half is left, metres, where the cloud states it.
    block : int
        Points of the cloud along a cell's side.
    spacing : tuple of 2 floats
        From cell to cell along columns (x) and rows (y), metres.
    origin : ndarray, shape (3,)
        In the cloud's frame.
    all_points : ndarray, shape (rows of the cloud, columns of the cloud, 3), float32
        Relative to `origin`, metres; 0 where not `measured`.
    measured : ndarray, shape (rows of the cloud, columns of the cloud), bool
    """

    points: NDArray[np.float32]
    valid: NDArray[np.bool_]
    sigma: NDArray[np.float32] | None
    resolution: NDArray[np.float32] | None
    block: int
    spacing: tuple[float, float]
    origin: NDArray[np.float64]
    all_points: NDArray[np.float32]
    measured: NDArray[np.bool_]

    @classmethod
    def of(cls, cloud: Cloud, settings: SmallestDent, viewpoint: NDArray[np.float64]) -> Lattice:
        """Check a cloud and average it.

        Parameters
        ----------
        cloud : Cloud
        settings : SmallestDent
        viewpoint : ndarray, shape (3,)
            Of the camera in the cloud's frame.

        Raises
        ------
        CloudError
            The cloud cannot be inspected; the message says why.
        """
        origin = _checked(cloud)
        points, sigma = _before_denoising(cloud, viewpoint)
        relative = _moved(points, -origin)
        finite = np.isfinite(relative[..., 0] + relative[..., 1] + relative[..., 2])
        # A bit pattern is 0 after an exclusive or with itself, also that of NaN.
        cv2.bitwise_xor(relative, relative, dst=relative, mask=(~finite).view(np.uint8))
        across = _spacing(relative, finite, 1), _spacing(relative, finite, 0)
        if not max(across):
            raise CloudError('the points of the cloud lie at one place: give another cloud')
        if max(across) > _WIDEST_SPACING:
            raise CloudError(
                f'the points of the cloud lie {max(across):.2g} m apart, so that it seems to be '
                'in millimetres: give it in metres'
            )
        block = max(1, min(round(settings.smallest_width / CELLS / max(across)), *finite.shape))
        share = _means(finite.astype(np.float32), block)
        valid = share > 0.5
        # What is divided by infinity is 0.
        divisor = np.where(valid, share, np.float32(np.inf))
        means = cv2.divide(_means(relative, block), cv2.merge([divisor] * 3))
        spacing = block * across[0], block * across[1]
        return cls(
            np.asarray(means, np.float32),
            valid,
            _stated(sigma, finite, block),
            _stated(cloud.resolution, finite, block),
            block,
            spacing,
            origin,
            relative,
            finite,
        )

    def spread(
        self, coarse: NDArray, shape: tuple[int, ...], how: int = cv2.INTER_NEAREST
    ) -> NDArray:
        """Values of cells at the points of their blocks, of which there are `shape`."""
        if self.block == 1:
            return coarse
        rows, columns = coarse.shape
        plain = coarse.view(np.uint8) if coarse.dtype == bool else coarse
        size = columns * self.block, rows * self.block
        fine = cv2.resize(np.ascontiguousarray(plain), size, interpolation=how)
        if fine.shape != shape:
            # What fills no block has the nearest one's.
            over = shape[0] - size[1], shape[1] - size[0]
            fine = cv2.copyMakeBorder(fine, 0, over[0], 0, over[1], cv2.BORDER_REPLICATE)
        return np.asarray(fine).view(coarse.dtype)

    def windows(self, at: NDArray[np.bool_], fits: int) -> tuple[float, int]:
        """Standard deviation of the windows that cells come from by some fits, metres.

        Of a cloud that does not state its resolution, one fit in windows of some points.
        """
        if self.resolution is None:
            return TOGETHER * max(self.spacing) / self.block / halved(1), 1
        return median(self.resolution[at]) / halved(fits), fits

    def relative(self, points: NDArray) -> NDArray[np.float32]:
        """Points from the origin, shape (rows, columns, 3), metres."""
        return _moved(points, -self.origin)

    def cells(self, metres: float) -> tuple[float, float]:
        """A length in cells along x and y."""
        return metres / self.spacing[0], metres / self.spacing[1]


def _before_denoising(
    cloud: Cloud, viewpoint: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Points as the photograph alone has them, and their uncertainty, where the cloud has both.

    Denoising takes small dents off, so what it took off is put back. Where the noise is
    beyond the range of 95 % of the photograph, as near edges of light, only a part is put back.
    Points that have no place before denoising, as in gaps, are left out.
    """
    known = np.isfinite(cloud.raw) & np.isfinite(cloud.noise)
    if not known.any():
        return cloud.points, cloud.sigma
    rays = _moved(cloud.points, -viewpoint)
    # OpenCV's magnitude depends on where in memory the arrays are.
    distance = np.maximum(np.sqrt(sum(map(np.square, cv2.split(rays)))), np.finfo(np.float32).tiny)
    # Edges make it noisier only: what is usual ends as far above the median as below it.
    low, usual = np.quantile(cloud.noise[known], (0.025, 0.5))
    much = np.float32(usual * usual / low)
    share = np.square(much / np.fmax(cloud.noise, much))
    shift = share * cloud.raw / distance
    moved = cv2.multiply(rays, cv2.merge([shift] * 3)) + cloud.points
    return np.float32(moved), cloud.noise


def _stated(values: NDArray, finite: NDArray[np.bool_], block: int) -> NDArray[np.float32] | None:
    """Means of what the cloud states of its points; None if it states nothing."""
    known = finite & np.isfinite(values) & (values > 0)
    if not known.any():
        return None
    weight = _means(known.astype(np.float32), block)
    total = _means(np.where(known, values, 0).astype(np.float32, copy=False), block)
    means = total / np.maximum(weight, np.float32(1e-6))
    usual = np.float32(median(means[weight > 0]))
    return np.where(weight > 0, means, usual)


def _checked(cloud: Cloud) -> NDArray[np.float64]:
    """Median of the points, after checks of their number and order."""
    rows, columns = cloud.points.shape[:2]
    if not rows * columns:
        raise CloudError('the cloud is empty: give one with points')
    if min(rows, columns) == 1 and rows * columns > 2:
        raise CloudError(
            f'the cloud is not organised (its grid is {rows} x {columns}): give it as the '
            'reconstruction writes it, on the grid of the camera'
        )
    finite = np.isfinite(cloud.points[..., 2])
    count = int(finite.sum())
    if not count:
        raise CloudError('no point of the cloud is measured (all are NaN): give another cloud')
    if count < FEW:
        raise CloudError(
            f'only {count} points of the cloud are measured, too few to know the skin: '
            f'give a cloud of {FEW} or more'
        )
    step = max(1, int(np.sqrt(count / ENOUGH)))
    some = cloud.points[::step, ::step][finite[::step, ::step]]
    some = some if len(some) else cloud.points[finite]
    axes = some.astype(float).T
    return np.array([median(axis[np.isfinite(axis)]) for axis in axes])


def _moved(points: NDArray, by: NDArray[np.float64]) -> NDArray[np.float32]:
    moved = cv2.transform(points, np.hstack([np.eye(3), by[:, None]]))
    return np.asarray(moved).astype(np.float32, copy=False)


def _spacing(points: NDArray, finite: NDArray[np.bool_], axis: int) -> float:
    """Median distance of neighbours along an axis."""
    here = slice(None, -1), slice(None, -1)
    there = (slice(1, None), here[1]) if axis == 0 else (here[0], slice(1, None))
    pairs = np.flatnonzero(finite[here] & finite[there])
    if not len(pairs):
        raise CloudError('the points of the cloud have no neighbours: give a dense cloud')
    row, column = np.unravel_index(pairs[:: 1 + len(pairs) // ENOUGH], finite[here].shape)
    width = finite.shape[1]
    one = width * row + column
    flat = points.reshape(-1, 3)
    apart = flat[one + (width if axis == 0 else 1)] - flat[one]
    return median(np.linalg.norm(apart, axis=1))


def _means(values: NDArray[np.float32], block: int) -> NDArray[np.float32]:
    """Means of square blocks; what does not fill one is left out."""
    if block == 1:
        return values.copy()
    rows, columns = values.shape[0] // block, values.shape[1] // block
    whole = np.ascontiguousarray(values[: rows * block, : columns * block])
    means = cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA)
    return np.asarray(means, np.float32)
