"""One patch laid on another: least squares on heights along the normal and paint along the skin.

The point-to-plane distance uses the clouds' own slopes (Chen and Medioni, 1992), the paint its
gradients (Lucas and Kanade, 1981). Noise has slopes too: counted as if they were the skin's, they
would make every smooth panel seem to tell its place. So what is known of a direction is summed
from products of one patch's slopes with the other's, in which noise cancels and only what both
show remains.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.pose import Pose
from ftp_dent_ros.robust import cauchy, deviation
from ftp_dent_ros.survey.patch import SkinPatch

# Distances between the points whose heights, and of the squares of which one cell's paint each,
# are compared, metres: at about this distance errors are independent.
_HEIGHTS, _PAINT = 0.006, 0.004
_MOST_HEIGHTS, _MOST_PAINT = 3000, 4000
# No two clouds fit each other better: a height's and a paint's standard deviation.
_LEAST_HEIGHT, _LEAST_PAINT = 2e-6, 1e-3


@dataclass(frozen=True, eq=False)
class Samples:
    """Points of a patch that are looked up in another.

    Attributes
    ----------
    heights, paint : ndarray, shape (n, 3)
        Metres, in the patch's frame.
    height_values : ndarray, shape (n, 4)
    paint_values, coarse_values : ndarray, shape (n, 4)
        As the layers of `SkinPatch`.
    """

    heights: NDArray[np.float64]
    height_values: NDArray[np.float32]
    paint: NDArray[np.float64]
    paint_values: NDArray[np.float32]
    coarse_values: NDArray[np.float32]

    @cached_property
    def few(self) -> Samples:
        """Every fourth of them: enough to find the way."""
        # Of these, every so many-th finds the way; the last steps are by all.
        some = slice(None, None, 4)
        return Samples(
            self.heights[some],
            self.height_values[some],
            self.paint[some],
            self.paint_values[some],
            self.coarse_values[some],
        )


def samples_of(patch: SkinPatch) -> Samples:
    """Heights on a regular grid; of the paint, in every square, the cell that changes most."""
    step = max(1, round(_HEIGHTS / patch.pitch))
    row, column = np.nonzero(patch.known[::step, ::step])
    keep = slice(None, None, max(1, -(-len(row) // _MOST_HEIGHTS)))
    row, column = row[keep] * step, column[keep] * step
    at_row, at_column = _strongest(patch)
    return Samples(
        patch.points(row, column),
        patch.surface[row, column],
        patch.points(at_row, at_column),
        patch.paint[at_row, at_column],
        patch.coarse[at_row, at_column],
    )


def _strongest(patch: SkinPatch) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of the cells, one a square, whose paint changes most."""
    side = max(1, round(_PAINT / patch.pitch))
    rows, columns = (size // side for size in patch.paint.shape[:2])
    along_x, along_y = patch.paint[..., 1], patch.paint[..., 2]
    change = (along_x * along_x + along_y * along_y) * patch.known
    squares = change[: rows * side, : columns * side].reshape(rows, side, columns, side)
    squares = squares.transpose(0, 2, 1, 3).reshape(rows * columns, side * side)
    inside = squares.argmax(axis=1)
    best = np.take_along_axis(squares, inside[:, None], axis=1)[:, 0]
    chosen = np.flatnonzero(best > 0)
    if len(chosen) > _MOST_PAINT:
        chosen = chosen[np.argpartition(best[chosen], -_MOST_PAINT)[-_MOST_PAINT:]]
        chosen.sort()
    row = chosen // columns * side + inside[chosen] // side
    column = chosen % columns * side + inside[chosen] % side
    return row, column


@dataclass(frozen=True, eq=False)
class PairEquations:
    """Linearised residuals at a pose, of the n points that lie on the other patch.

    Attributes
    ----------
    residual : ndarray, shape (n,)
        In standard deviations.
    own, other : ndarray, shape (n, 6)
        Change with the shift of the centre and the turn about it, by either patch's slopes, in
        standard deviations.
    weight : ndarray, shape (n,)
        Of Cauchy, 0 to 1: a half at 2.385 standard deviations.
    place : ndarray, shape (n, 3)
        On the first patch, metres.
    is_paint : ndarray, shape (n,), bool
    spread : tuple of 2 floats
        Standard deviation of heights by what the clouds state, and of the paint.
    """

    residual: NDArray[np.float64]
    own: NDArray[np.float64]
    other: NDArray[np.float64]
    weight: NDArray[np.float64]
    place: NDArray[np.float64]
    is_paint: NDArray[np.bool_]
    spread: tuple[float, float]

    @property
    def score(self) -> NDArray[np.float64]:
        """Each point's share of the gradient, shape (n, 6)."""
        return (self.own + self.other) / 2 * (self.weight * self.residual)[:, None]


def equations(
    first: SkinPatch,
    second: Samples,
    pose: Pose,
    centre: NDArray[np.float64],
    with_paint: bool = True,
) -> PairEquations:
    """Equations at a pose of the second patch in the first."""
    heights, height_spread = _of_heights(first, second, pose, centre)
    parts, paint_spread = [heights], 0.0
    if with_paint and len(second.paint):
        paint, paint_spread = of_paint(first, second, pose, centre)
        parts.append(paint)
    residual, own, other, weight, place = (
        np.concatenate([part[index] for part in parts]) for index in range(5)
    )
    is_paint = np.arange(len(residual)) >= len(heights[0])
    spread = height_spread, paint_spread
    return PairEquations(residual, own, other, weight, place, is_paint, spread)


def _of_heights(first, second, pose, centre):
    place = pose.apply(second.heights)
    here = first.looked_up(first.surface, place)
    met = np.isfinite(here[:, 0])
    place, here, there = place[met], here[met].astype(float), second.height_values[met]
    normals = _normals(here), _normals(there) @ pose.rotation.as_matrix().T
    lengths = [np.sqrt(np.square(each).sum(axis=1)) for each in normals]
    sigma = np.maximum(np.hypot(here[:, 3], there[:, 3]), _LEAST_HEIGHT)
    residual = (place[:, 2] - here[:, 0]) / lengths[0] / sigma
    # Clouds may be surer of themselves than they fit.
    spread = max(1.0, deviation(residual) if len(residual) else 1.0)
    residual /= spread
    rows = [
        _moved(each / (length * sigma * spread)[:, None], place - centre)
        for each, length in zip(normals, lengths, strict=True)
    ]
    return (residual, *rows, cauchy(residual, 2.385), place), spread


def of_paint(
    first: SkinPatch,
    second: Samples,
    pose: Pose,
    centre: NDArray[np.float64],
    coarse: bool = False,
) -> tuple[tuple[NDArray[np.float64], ...], float]:
    """Residuals, both slopes, weights and places of the paint, as `PairEquations` has; spread."""
    layer, values = (
        (first.coarse, second.coarse_values) if coarse else (first.paint, second.paint_values)
    )
    place = pose.apply(second.paint)
    here = first.looked_up(layer, place)
    met = (here[:, 3] > 0.99) & (values[:, 3] > 0)
    place, here, there = place[met], here[met].astype(float), values[met].astype(float)
    residual = here[:, 0] - there[:, 0]
    spread = max(deviation(residual) if len(residual) else 1.0, _LEAST_PAINT)
    residual = residual / spread
    slopes = here[:, 1:3] @ np.eye(2, 3), there[:, 1:3] @ pose.rotation.as_matrix()[:, :2].T
    rows = [_moved(each, place - centre) / spread for each in slopes]
    return (residual, *rows, cauchy(residual, 2.385), place), spread


def _normals(values):
    """Not of unit length, z = 1, shape (n, 3)."""
    normals = np.ones((len(values), 3))
    np.negative(values[:, 1:3], out=normals[:, :2])
    return normals


def _moved(direction, arm):
    """Change along directions with a shift and a turn of what lies at the end of arms."""
    x, y, z = arm.T
    a, b, c = direction.T
    return np.array([a, b, c, y * c - z * b, z * a - x * c, x * b - y * a]).T
