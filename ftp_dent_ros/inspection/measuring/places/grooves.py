"""The groove that the points along a narrow mark show: one depth is fitted to them all."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.inspection.measuring.places.narrow_marks import NarrowMark
from ftp_dent_ros.inspection.measuring.skin.contour import Contour
from ftp_dent_ros.inspection.measuring.skin.lattice import Lattice
from ftp_dent_ros.inspection.measuring.skin.smoothing import shown
from ftp_dent_ros.robust import median

# Part of the length that is asked, for a groove runs out; and how far to both sides the skin is,
# in resolutions.
_ALONG, _BESIDE = 0.8, 0.9
# Points that tell a groove, at least; and places of a profile.
_FEWEST, _BINS = 40, 41
# Where else a groove is tried, across its mark.
_PLACES = 17

Vector = NDArray[np.float64]
# Distances from a groove's middle, and what a cloud shows there of one that is 1 deep.
Image = tuple[Vector, Vector]


@dataclass(frozen=True, eq=False)
class Strip:
    """The skin along a mark and to both sides of it.

    Attributes
    ----------
    length, width : float
        Of the mark, metres.
    middle : ndarray, shape (2,)
        Of the mark, on the contour's axes, metres.
    angle : float
        Of the mark from the contour's x axis, radians.
    along, across, depth : ndarray, shape (n,)
        Of the points: from the middle, and below the contour, metres.
    resolution, doubt : float
        Of the cloud, and its standard uncertainty, inside the mark: medians, metres.
    """

    length: float
    width: float
    middle: Vector
    angle: float
    along: Vector
    across: Vector
    depth: Vector
    resolution: float
    doubt: float

    @classmethod
    def under(
        cls,
        mark: NarrowMark,
        cloud: Cloud,
        deviation: NDArray[np.float32],
        lattice: Lattice,
        contour: Contour,
    ) -> Strip | None:
        """The strip under a mark, None where the cloud shows too little of it.

        Parameters
        ----------
        mark : NarrowMark
        cloud : Cloud
        deviation : ndarray, shape (rows of the cloud, columns of the cloud), float32
            Depths below the contour, metres.
        lattice : Lattice
        contour : Contour
            Of the mark's panel.
        """
        sigma, resolution = cloud.sigma, cloud.resolution
        x, y, _ = contour.deviation(lattice.all_points[mark.rows, mark.columns].astype(float))
        middle = np.array([x.mean(), y.mean()])
        _, axes = np.linalg.eigh(np.cov(np.stack([x, y])))
        angle = math.atan2(axes[1, 1], axes[0, 1])
        reach = mark.length / 2 + _BESIDE * float(np.nanmedian(resolution)) + mark.width
        window = _window(mark, round(reach * lattice.block / min(lattice.spacing)) + 1)
        near = np.isfinite(deviation[window]) & np.isfinite(sigma[window])
        x, y, _ = contour.deviation(lattice.all_points[window][near].astype(float))
        along = (x - middle[0]) * math.cos(angle) + (y - middle[1]) * math.sin(angle)
        across = (y - middle[1]) * math.cos(angle) - (x - middle[0]) * math.sin(angle)
        depth = deviation[window][near].astype(float)
        inside = (np.abs(along) < mark.length / 2) & (np.abs(across) < mark.width / 2)
        finest, doubt = (
            median(each[window][near][inside].astype(float)) for each in (resolution, sigma)
        )
        strip = cls(mark.length, mark.width, middle, angle, along, across, depth, finest, doubt)
        return strip if math.isfinite(finest) and strip._asked.sum() >= _FEWEST else None

    @cached_property
    def _asked(self) -> NDArray[np.bool_]:
        asked = np.abs(self.along) < _ALONG / 2 * self.length
        return asked & (np.abs(self.across) < _BESIDE * self.resolution + self.width)

    @cached_property
    def groove(self) -> Groove:
        """The groove that fits best, along the mark's middle."""
        along, across = self.along[self._asked], self.across[self._asked]
        image = _image(round(self.width, 5), round(self.resolution, 5))
        bent = _bent(along, across)
        return Groove(self.width, image, across, bent, self.depth[self._asked])

    def profiles(self) -> tuple[Vector, Vector]:
        """Mean depths along the length and along the width, each of shape (n, 2)."""
        inside, amid = np.abs(self.across) < self.width / 2, np.abs(self.along) < self.length / 4
        return (
            _profile(self.along, self.depth, inside, self.length),
            _profile(self.across, self.depth, amid, self.width),
        )


@dataclass(frozen=True, eq=False)
class Groove:
    """A groove with straight flanks, fitted to points along it.

    Attributes
    ----------
    width : float
        Metres.
    image : tuple of ndarray
        What the cloud shows of it, if it were 1 deep, by the distance from its middle, metres.
    across, depth : ndarray, shape (n,)
        Of the points, from the middle of the mark, and below the contour, metres.
    bent : ndarray, shape (n, 6)
        What a bent skin adds to the depths.
    """

    width: float
    image: Image
    across: Vector
    bent: Vector
    depth: Vector

    @cached_property
    def deepest_and_strays(self) -> tuple[float, float]:
        """Depth, and how far the points stray from the fit, root mean square; metres."""
        return self._fitted(0.0)

    @property
    def shown(self) -> float:
        """Part of its depth that the cloud shows."""
        return float(self.image[1].max())

    def is_in_mark(self) -> bool:
        """Whether its bottom lies in its mark: one flank of a crease may gleam beside it."""
        places = self.width * np.linspace(-1, 1, _PLACES)
        left = [self._fitted(place)[1] for place in places]
        return abs(places[int(np.argmin(left))]) < self.width / 2

    def _fitted(self, place: float) -> tuple[float, float]:
        """Depth and strays of one that lies so far beside the middle of the mark."""
        columns = np.column_stack([np.interp(np.abs(self.across - place), *self.image), self.bent])
        solution = np.linalg.lstsq(columns, self.depth, rcond=None)[0]
        left = self.depth - columns @ solution
        return float(solution[0]), math.sqrt(float(np.square(left).mean()))


def _window(mark: NarrowMark, reach: int) -> tuple[slice, slice]:
    row, column = round(mark.rows.mean()), round(mark.columns.mean())
    return slice(max(row - reach, 0), row + reach + 1), slice(
        max(column - reach, 0), column + reach + 1
    )


def _bent(along: Vector, across: Vector) -> Vector:
    """Columns of a skin that is bent as a dent's is around the groove, shape (n, 6)."""
    u, v = along / np.abs(along).max(), across / np.abs(across).max()
    return np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=1)


@lru_cache(maxsize=256)
def _image(width: float, resolution: float) -> Image:
    """Image of a groove with straight flanks, from its middle outward."""
    step = min(width, resolution) / 40
    count = math.ceil((3 * resolution + width) / step)
    at = step * np.arange(-count, count + 1, dtype=float)
    # Its width is told at a tenth of its depth.
    groove = np.clip(1 - 0.9 * np.abs(at) / (width / 2), 0, None)
    return at[count:], shown(groove, step, resolution)[count:]


def _profile(place: Vector, depth: Vector, on: NDArray[np.bool_], size: float) -> Vector:
    """Mean depths along a line, shape (n, 2), a third of the size beyond both ends."""
    edges = np.linspace(-0.83 * size, 0.83 * size, _BINS + 1)
    count, _ = np.histogram(place[on], edges)
    total, _ = np.histogram(place[on], edges, weights=depth[on])
    with np.errstate(invalid='ignore'):
        return np.stack([(edges[1:] + edges[:-1]) / 2, total / np.where(count, count, 0)], axis=1)
