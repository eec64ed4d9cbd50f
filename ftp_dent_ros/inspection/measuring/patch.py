"""The deviation around one place, on a grid as fine as its size asks for."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
import scipy.fft
from numpy.typing import NDArray

from ftp_dent_ros.cloud.response import OF_WAVES, halved, left_out
from ftp_dent_ros.inspection.measuring.detection import Place
from ftp_dent_ros.inspection.measuring.lattice import CELLS, Lattice
from ftp_dent_ros.inspection.measuring.noise import SURE, Noise, median_of, smoother
from ftp_dent_ros.inspection.measuring.skin import Skin

# Cells of a patch across a place at most, and a third of those across its window.
_ACROSS = 48
# Smoothing of what noise may make as deep, as a part of its width; of what is deeper less.
_WIDEST = 0.15

Map = NDArray[np.floating]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Patch:
    """Depths around a place; maps of shape (rows, columns).

    Attributes
    ----------
    x, y : ndarray
        Feet of the cells on the contour, metres.
    depth : ndarray
        In the direction of the place, smoothed, metres.
    doubts : ndarray, shape (n, rows, columns)
        Of what was put back or filled: as one standard deviation of each doubt moves the depths,
        metres.
    strays : ndarray
        Standard deviation of the depths by noise, metres.
    unsure : ndarray
        Standard uncertainty of the depths, by noise and all doubts, metres.
    passed : ndarray
        Of each frequency of white noise (fft2), as it is correlated, smoothed, and raised again
        by what was put back, over the root mean square of all.
    known, over : ndarray of bool
        Where there are depths, and where they are filled.
    own : ndarray of bool
        Cells of the place.
    usual : float
        What the cloud states of its points beside the place, metres.
    step : tuple of 2 floats
        Between columns and between rows, metres.
    resolution : float
        Wavelength of which half is left, metres; NaN if it is not known.
    """

    x: Map
    y: Map
    depth: Map
    doubts: Map
    strays: Map
    unsure: Map
    passed: Map
    known: Mask
    over: Mask
    own: Mask
    usual: float
    step: tuple[float, float]
    resolution: float

    def at(self, values: NDArray, columns: Map, rows: Map, how: int = cv2.INTER_CUBIC) -> NDArray:
        """Values at fractions of cells, 0 beyond the frame; of up to 2 dimensions."""
        x, y = np.atleast_2d(np.float32(columns)), np.atleast_2d(np.float32(rows))
        found = cv2.remap(values, x, y, how, borderMode=cv2.BORDER_CONSTANT)
        return np.asarray(found).reshape(np.shape(columns))

    def along(self, x: float, y: float, angle: float, distances: Map) -> tuple[Map, Mask]:
        """Depths at distances from a place, at an angle from x; and where they are measured."""
        out_x, out_y = x + distances * math.cos(angle), y + distances * math.sin(angle)
        at = np.stack([np.ones_like(distances), out_x, out_y], axis=1)
        columns, rows = (at @ self._to_cells).T
        shown = self.at(np.uint8(self.known & ~self.over), columns, rows, cv2.INTER_NEAREST)
        return self.at(self.depth, columns, rows), shown > 0

    @cached_property
    def _to_cells(self) -> Map:
        """From 1, x and y to columns and rows, shape (3, 2)."""
        rows, columns = np.indices(self.x.shape, float).reshape(2, -1)
        terms = np.stack([np.ones(self.x.size), self.x.ravel(), self.y.ravel()])
        return np.linalg.solve(terms @ terms.T, terms @ np.stack([columns, rows], axis=1))

    def varied(self, fields: int, unsure: float) -> Iterator[Patch]:
        """The patch as it may have been measured as well, in pairs that differ by one thing.

        First by noise, drawn an even number of times; then by each doubt. The last doubt grows
        by the skin's uncertainty, `unsure`, metres.
        """
        rng = np.random.default_rng(0)
        # White noise has a white spectrum; the two parts of a complex field are independent.
        white = rng.standard_normal((fields // 2, *self.depth.shape, 2), np.float32)
        drawn = scipy.fft.ifft2(self.passed * white.view(np.complex64)[..., 0], norm='ortho')
        strays = self.strays * np.concatenate([drawn.real, drawn.imag])
        *doubts, last = self.doubts
        for off in (*strays, *doubts, np.hypot(last, np.float32(unsure))):
            yield replace(self, depth=self.depth + off / 2)
            yield replace(self, depth=self.depth - off / 2)


def ellipse_of(mask: Mask) -> tuple[Map, Map]:
    """The ellipse with the same second moments as the cells of a mask, which has some.

    Returns
    -------
    centre : ndarray, shape (2, 1)
        Column and row.
    stretch : ndarray, shape (2, 2)
        From the unit circle to the ellipse about its centre, cells.
    """
    sums = cv2.moments(mask.view(np.uint8))
    centre = np.array([[sums['m10']], [sums['m01']]]) / sums['m00']
    xx, xy, yy = (sums[name] / sums['m00'] for name in ('mu20', 'mu11', 'mu02'))
    # A twelfth of a square is the variance of a place in it; Cholesky's factor.
    first = math.sqrt(xx + 1 / 12)
    return centre, 2 * np.array(
        [[first, 0], [xy / first, math.sqrt(yy + 1 / 12 - (xy / first) ** 2)]]
    )


def patch_of(place: Place, skin: Skin, lattice: Lattice) -> Patch:
    """Depths around a place, smoothed as its noise demands and its size allows.

    Parameters
    ----------
    place : Place
    skin : Skin
    lattice : Lattice
    """
    block, spacing = lattice.block, max(lattice.spacing) / lattice.block
    margin = max(place.mask.shape) // 2 + CELLS
    cells = tuple(slice(max(s.start - margin, 0), s.stop + margin) for s in place.window)
    pixels = tuple(slice(s.start * block, s.stop * block) for s in cells)
    points, measured = lattice.all_points[pixels], lattice.measured[pixels]

    def spread(values: NDArray, how: int = cv2.INTER_NEAREST) -> NDArray:
        return lattice.spread(values[cells], measured.shape, how)

    own = np.zeros(skin.usable.shape, bool)
    own[place.window] = place.mask
    stretch = ellipse_of(place.mask)[1] * np.array(lattice.spacing)[:, None]
    width = 2 * float(np.linalg.norm(stretch, -2))
    known = measured & spread(skin.usable)
    x, y, depth = skin.contour.deviation(points)
    if skin.relief is not None:
        depth = depth - spread(skin.relief.heights, cv2.INTER_LINEAR)
    zoom = min(1.0, _ACROSS * spacing / width, 3 * _ACROSS / math.sqrt(known.size))
    maps = cv2.merge([x, y, place.sign * depth, spread(skin.noise.stated)])
    (x, y, depth, stated), known = _resized(maps, known, zoom)
    owned = (
        np.asarray(
            cv2.resize(
                spread(own).view(np.uint8), known.shape[::-1], interpolation=cv2.INTER_NEAREST
            )
        )
        > 0
    )
    step = lattice.spacing[0] / lattice.block / zoom, lattice.spacing[1] / lattice.block / zoom
    scale = _smoothing(skin, depth, stated, known, 0.7 * max(spacing, *step), width)
    mean = smoother(known, (scale / step[0], scale / step[1]), 3, 0)
    depth = depth - _taken(depth, known, mean, 2)
    window, fits = lattice.windows(own, OF_WAVES)
    is_stated = lattice.resolution is not None
    depth, taken, anywhere = _restored(
        depth, known, (window / step[0], window / step[1]), fits, is_stated
    )
    bridged, unsure, gaps = (
        np.asarray(cv2.resize(spread(np.float32(each), cv2.INTER_LINEAR), known.shape[::-1]))
        for each in skin.bridged
    )
    over = (gaps > 0) & ~known
    # What the cloud doubts beyond the noise beside the place is alike all over it.
    around = stated[known & ~owned]
    usual = median_of(around if len(around) else stated.ravel())
    beyond = np.maximum(stated * stated - usual * usual, 0)
    gap_doubt = np.sqrt(np.where(over, unsure, np.float32(0)) ** 2 + beyond)
    doubts = np.array([taken, np.hypot(anywhere, gap_doubt)], np.float32)
    passed = _passed(known.shape, step, skin.noise, usual, scale, (window, fits * is_stated))
    level = math.sqrt(np.square(passed).mean())
    share = skin.noise.after(scale, np.minimum(stated, usual)) / skin.noise.after(scale, usual)
    strays = np.float32(share * level)
    return Patch(
        x,
        y,
        np.where(over, place.sign * bridged, np.where(known, depth, np.float32(0))),
        doubts,
        strays,
        np.linalg.norm([strays, *doubts], axis=0),
        passed / level,
        known | over,
        over,
        owned,
        usual,
        step,
        window * halved(fits) if is_stated else math.nan,
    )


def _smoothing(
    skin: Skin, depth: Map, stated: Map, known: Mask, finest: float, width: float
) -> float:
    """Standard deviation of the smoothing that noise asks for and the width allows, metres."""
    usual = median_of(stated[known]) if known.any() else 0.0
    high = float(np.max(depth, initial=0.0, where=known))
    drowned = SURE * float(skin.noise.after(finest, usual)) / max(high, 1e-9)
    return max(finest, _WIDEST * width * min(drowned, 1.0))


def _resized(maps: NDArray, known: Mask, zoom: float) -> tuple[list[NDArray[np.float32]], Mask]:
    """Means of maps, shape (rows, columns, n), on a coarser grid, and where they are known.

    The first two, places, go on where they are not known.
    """
    rows, columns = known.shape
    size = max(2, round(zoom * columns)), max(2, round(zoom * rows))
    weight = known.astype(np.float32)
    share = np.asarray(cv2.resize(weight, size, interpolation=cv2.INTER_AREA))
    total = cv2.resize(maps * weight[..., None], size, interpolation=cv2.INTER_AREA)
    means = cv2.split(total / np.maximum(share, np.float32(1e-6))[..., None])
    found = [np.asarray(each, np.float32) for each in means]
    known = share > 0.5
    if not known.all():
        v, u = np.mgrid[: size[1], : size[0]] / max(size)
        terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1)
        for places in found[:2]:
            fit = np.linalg.lstsq(terms[known], places[known], rcond=None)[0]
            places[~known] = terms[~known] @ fit
    return found, known


def _taken(values: Map, known: Mask, mean: Callable[[Map], Map], fits: int) -> Map:
    """What some fits in Gaussian windows, each of which corrects the ones before, leave out."""
    for _ in range(fits):
        values = values - mean(values)
    return np.where(known, values, np.float32(0))


def _restored(
    depth: Map, known: Mask, sigma: tuple[float, float], fits: int, is_stated: bool
) -> tuple[Map, Map, Map]:
    """Depths with what the reconstruction smoothed away, and what of that is in doubt.

    What the windows leave out of the surface as it is was left out of it before, but for what is
    finer; the same of that again is the next order (the Neumann series of the inverse; van
    Cittert, Z. Phys. 69, 298, 1931). All of that is in doubt: as it is put back, and wherever
    else in a window, for light and shade bend the response. Of a resolution that is not known
    nothing is put back, but what one Gaussian would ask for is in doubt.
    """
    mean = smoother(known, sigma, 3, 0)
    first = _taken(depth, known, mean, fits)
    taken = first + _taken(first, known, mean, fits)
    anywhere = np.where(known, np.sqrt(mean(taken * taken)), np.float32(0))
    return depth + is_stated * taken, taken, anywhere


def _passed(
    shape: tuple[int, ...],
    step: tuple[float, float],
    noise: Noise,
    stated: float,
    scale: float,
    restored: tuple[float, int],
) -> Map:
    """Of each frequency of white noise what passes: correlated, smoothed, and raised again."""
    down = 2 * math.pi * scipy.fft.fftfreq(shape[0], step[1])[:, None]
    across = 2 * math.pi * scipy.fft.fftfreq(shape[1], step[0])
    square = (down * down + across * across) / 2
    taken = left_out(square * restored[0] ** 2, restored[1]) if restored[1] else 0.0
    raised = 1 + taken + taken * taken
    smooth = 1 - left_out(square * scale**2, 2)
    return np.float32(noise.spectrum(square, math.prod(step), stated) * smooth * raised)
