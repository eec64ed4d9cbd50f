"""The points of a cloud around one candidate."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.inspection.measuring.places.bare_skin import BareSkin
from ftp_dent_ros.inspection.measuring.places.detection import Candidate
from ftp_dent_ros.inspection.measuring.skin.contour import Contour
from ftp_dent_ros.inspection.measuring.skin.lattice import Lattice
from ftp_dent_ros.robust import median

# Of a candidate's window, as a part of its size.
_MARGIN = 0.45
# Points along the longer side of a candidate's window, about.
_WINDOW = 110
# And across it, at least.
_ACROSS = 14
_FEWEST = 30
# Cells beside a gap that tell how the grid goes on.
_NEAR = 3

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Points around one candidate, on their panel.

    Attributes
    ----------
    x, y, depth : ndarray, shape (n,)
        Feet on the contour and depths below the skin, metres.
    light : ndarray, shape (n,)
        Modulation of the fringes, grey levels.
    stated : ndarray, shape (n,)
        Noise beyond the common one of each point, metres.
    cells : ndarray, shape (2, cells)
        x, y of the candidate's own cells, metres.
    cell : float
        Their size, metres.
    spacing : float
        Between points, metres.
    bounds : tuple of 4 floats
        x_min, x_max, y_min, y_max.
    extra : float
        Noise beyond the common one here, the median of the candidate's cells, metres.
    resolution : float
        Wavelength of which half is left here, metres; NaN if it is not known.
    """

    x: Vector
    y: Vector
    depth: Vector
    light: Vector
    stated: Vector
    cells: Vector
    cell: float
    spacing: float
    bounds: tuple[float, float, float, float]
    extra: float
    resolution: float


def surroundings_of(
    candidate: Candidate,
    at: NDArray[np.bool_],
    lattice: Lattice,
    skin: BareSkin,
    relief: NDArray[np.float32] | None,
    seams: NDArray[np.bool_],
) -> Surroundings | None:
    """Points around a candidate; none if it is smaller than anything to report.

    Parameters
    ----------
    candidate : Candidate
    at : ndarray, shape (rows of the cloud, columns of the cloud), bool
        Points of its panel.
    lattice : Lattice
    skin : BareSkin
    relief : ndarray, shape (rows of the cloud, columns of the cloud), float32, optional
        The skin's, at the points, metres.
    seams : ndarray, shape (rows, columns), bool
        Cells at panels' borders.
    """
    rows, columns = np.concatenate([[candidate.rows, candidate.columns], candidate.gap], axis=1)
    (top, bottom), (left, right) = _range(rows), _range(columns)
    size = max(bottom - top, right - left)
    if size < 1:
        return None
    margin = int(_MARGIN * size) + 5
    block = lattice.block
    top, left = max(top - margin, 0), max(left - margin, 0)
    bottom, right = bottom + margin + 1, right + margin + 1
    window = slice(top * block, bottom * block), slice(left * block, right * block)
    usable = at[window]
    if seams.any():
        usable = usable & ~lattice.spread(seams, at.shape)[window]
    stated = lattice.spread(skin.noise.extra[top:bottom, left:right], usable.shape)
    images: list[NDArray] = [lattice.all_points[window], lattice.light[window], stated]
    images += [] if relief is None else [relief[window]]
    spacing = max(lattice.spacing) / block
    every = max(1, min(max(usable.shape) // _WINDOW, int(candidate.width / spacing / _ACROSS)))
    if every > 1:
        fewer = usable.shape[1] // every, usable.shape[0] // every
        mask = usable.astype(np.uint8)
        images = [
            cv2.resize(cv2.copyTo(values, mask), fewer, interpolation=cv2.INTER_AREA)
            for values in images
        ]
        share = cv2.resize(usable.astype(np.float32), fewer, interpolation=cv2.INTER_AREA)
        usable = share > 0.5
        share = share[usable]
        values, *rest = (_of(image, usable) for image in images)
        values, rest = values / share[:, None], [each / share for each in rest]
    else:
        values, *rest = (_of(image, usable) for image in images)
    if len(values) < _FEWEST:
        return None
    contour = skin.contour
    x, y, depth = (axis.astype(float) for axis in contour.deviation(values))
    if relief is not None:
        depth = depth - rest[2]
    around_x, around_y = places(candidate, lattice, contour)
    (x_min, x_max), (y_min, y_max) = _range(around_x), _range(around_y)
    pad = 0.35 * max(x_max - x_min, y_max - y_min) + 4 * max(lattice.spacing)
    bounds = float(x_min - pad), float(x_max + pad), float(y_min - pad), float(y_max + pad)
    resolution = np.nan
    if lattice.resolution is not None:
        resolution = median(lattice.resolution[candidate.rows, candidate.columns])
    return Surroundings(
        x=x,
        y=y,
        depth=depth,
        light=rest[0].astype(float),
        stated=rest[1].astype(float),
        cells=np.stack([around_x, around_y]).astype(float),
        cell=max(lattice.spacing),
        spacing=every * spacing,
        bounds=bounds,
        extra=median(skin.noise.extra[candidate.rows, candidate.columns]),
        resolution=resolution,
    )


def _of(image: NDArray, mask: NDArray[np.bool_]) -> NDArray:
    """Values at the places of a mask, shape (n, ...)."""
    return image.reshape(mask.size, *image.shape[2:]) if mask.all() else image[mask]


def _range(values: NDArray) -> tuple:
    return values.min(), values.max()


def places(candidate: Candidate, lattice: Lattice, contour: Contour) -> tuple[Vector, Vector]:
    """Feet of a candidate's cells; those without points where the grid goes on."""
    points = lattice.points[candidate.rows, candidate.columns].astype(float)
    x, y, _ = (axis.astype(float) for axis in contour.local(points))
    if not candidate.gap.size:
        return x, y
    rows, columns = candidate.gap
    near = tuple(
        slice(max(each.min() - _NEAR, 0), each.max() + _NEAR + 1) for each in (rows, columns)
    )
    row, column = np.nonzero(lattice.valid[near])
    grid = np.stack([np.ones(len(row)), row + near[0].start, column + near[1].start], axis=1)
    local = np.stack(contour.local(lattice.points[near][row, column].astype(float))[:2], axis=1)
    solution = np.linalg.lstsq(grid, local, rcond=None)[0]
    more = np.stack([np.ones(len(rows)), rows, columns], axis=1) @ solution
    return np.concatenate([x, more[:, 0]]), np.concatenate([y, more[:, 1]])
