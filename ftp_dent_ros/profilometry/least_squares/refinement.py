"""The second fit: about the surface itself, where only dents and noise are left to measure.

What the first fit found is a model of the photograph; what differs from it, demodulated through
flat-top windows, corrects it. Beyond the surface's rim the photograph is taken to be as the
model says, which is how windows end there without leakage.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.profilometry.least_squares.camera_effects import lag_of_bins, take_harmonics
from ftp_dent_ros.profilometry.least_squares.continuation import Continuation
from ftp_dent_ros.profilometry.least_squares.first_fit import magnitude
from ftp_dent_ros.profilometry.least_squares.grid import Grid
from ftp_dent_ros.profilometry.least_squares.light import Light
from ftp_dent_ros.profilometry.least_squares.median import median
from ftp_dent_ros.profilometry.least_squares.shrinkage import Shrunk, noise_through, shrink
from ftp_dent_ros.profilometry.least_squares.windows import Windows

# Misfit of a bin, in fringe amplitudes and in those of all, beyond which it tells of something
# else than fringes; at the rim, where it may lie half beside the surface, less is allowed.
_MISFIT, _MISFIT_NOISE = 0.25, 4.0
_RIM_MISFIT, _RIM_NOISE = 0.08, 4.0
# Share of a window that must be on the surface for a fit of its own, and of what is left of a
# fringe's variation then.
_LEAST_SHARE, _LEAST_VARIATION = 0.7, 0.05
# Of the normal equations by missing bins, beyond which their lack is not made up for.
_LEAST_SUPPORT = 0.5
# Fringes along u, and bins along v, by which the first mask's rim is uncertain.
_RIM_U, _RIM_V = 0.6, 1
_MAD = 1.4826
# Row and column that the noise is measured in.
_EVERY, _EVERY_COLUMN = 6, 3
# Gaussian windows that the noise has come through, one correcting the other; a flat-top is two.
_FITS = 4


def roughness(misfit: NDArray[np.float32], windows: Windows, grid: Grid) -> NDArray[np.float32]:
    """Root mean square misfit of the bins, in amplitudes, in the window of each node."""
    return np.sqrt(windows.gaussian(grid.at_nodes(np.square(np.clip(misfit, -1, 1)))))


@dataclass(frozen=True, eq=False)
class Refined:
    """A surface's fringes at the nodes and bins.

    Attributes
    ----------
    shift : Shrunk
        Phase less the reference's, radians, and its variance.
    modulation : ndarray, shape (rows, columns), float32
        Amplitude of the fringes, grey levels.
    measured : ndarray, shape (rows, columns), bool
        Bins that are on the surface.
    covered : ndarray, shape (rows, columns), float32
        Share of each bin that the surface covers, as far as the fringes' amplitude tells.
    roughness : ndarray, shape (rows, columns), float32
        Root mean square misfit of the bins around each node, in amplitudes.
    """

    shift: Shrunk
    modulation: NDArray[np.float32]
    measured: NDArray[np.bool_]
    covered: NDArray[np.float32]
    roughness: NDArray[np.float32]


class Refinement:
    """Fits about a surface.

    Parameters
    ----------
    grid : Grid
    windows : Windows
    period : float
        Of the fringes, pixels.
    fast : bool
        Leave out the correction through flat-top windows.
    """

    def __init__(self, grid: Grid, windows: Windows, period: float, fast: bool) -> None:
        self.grid, self.windows, self.fast = grid, windows, fast
        self.period = period / grid.step
        rows, columns = grid.bin_shape
        strip = grid.strips()[0].stop
        self._products = np.empty((8, strip, columns), np.float32)
        self._turns = np.empty((2, strip, columns), np.float32)
        self._sums = np.empty((8, *grid.shape), np.float32)
        self._work = np.empty((4, rows, columns), np.float32)
        self._noise = noise_through(grid, windows, _FITS - 2 * fast, self.period)

    def refine(
        self,
        light: Light,
        base: NDArray[np.float32],
        reference: NDArray[np.float32],
        shift: NDArray[np.float32],
        region: NDArray[np.bool_],
    ) -> Refined:
        """Refine the phase shift of one surface.

        Parameters
        ----------
        light : Light
        base : ndarray, shape (rows, columns), float32
            Absolute phase at the bins of a plane.
        reference : ndarray, shape (rows, columns), float32
            Phase of a smooth surface near the true one, less the plane's, at the nodes.
        shift : ndarray, shape (rows, columns), float32
            Phase less the reference's at the nodes, continued beyond the region.
        region : ndarray, shape (rows, columns), bool
            Nodes of the surface, to a node or so.
        """
        inside = self.grid.to_bins(region).view(np.uint8)
        phase = base + self.grid.at_bins(reference + shift)
        clipped = light.clipped
        levels = light.filled(phase, inside > 0, self.period)
        rim = math.ceil(self.grid.bins / 2 + _RIM_U * self.period)
        core = cv2.erode(inside, np.ones((2 * _RIM_V + 1, 2 * rim + 1)), borderValue=0)
        mask = (core > 0) & ~clipped
        allowed = (cv2.dilate(inside, np.ones((3, 5))) > 0) & ~clipped
        level, modulation, step = self._masked_fit(levels, phase, mask)
        shift = shift + step
        phase = np.add(base, self.grid.at_bins(reference + shift), out=phase)
        cosine, sine = (np.cos(phase, out=self._work[0]), np.sin(phase, out=self._work[1]))
        amplitude = self.grid.at_bins(modulation)
        rest = np.subtract(levels, self.grid.at_bins(level), out=self._work[2])
        misfit = self._work[3]
        rest -= np.multiply(amplitude, cosine, out=misfit)
        take_harmonics(rest, amplitude, cosine, mask, self.grid, self._turns[0])
        np.divide(rest, np.maximum(amplitude, 1, out=misfit), out=misfit)
        mask, body = self._on_surface(misfit, mask, allowed, clipped)
        step, variance, supported = self._correction(rest, cosine, sine, modulation, mask)
        if not self.fast:
            shift = shift + step
        beyond = Continuation(supported, self.windows)
        shrunk = shrink(
            beyond.by_slope(shift),
            beyond.by_mean(variance),
            supported,
            self.windows,
            self._noise,
        )
        if self.grid.bin_variance:
            lag = lag_of_bins(modulation, phase, self.grid, self.windows)
            shrunk = Shrunk(shrunk.values - lag, shrunk.variance)
        covered = self._covered(levels, amplitude, cosine, body, allowed)
        rough = roughness(misfit, self.windows, self.grid)
        return Refined(shrunk, modulation, body, covered, rough)

    def _masked_fit(self, levels, phase, mask):
        """Level, amplitude and phase step in Gaussian windows, continued to where none is."""
        nodes = self._sums
        for rows in self.grid.strips():
            products = self._products[:, : rows.stop - rows.start]
            weight, seen, in_phase, across, *rest = products
            cosine, sine = self._turns[:, : rows.stop - rows.start]
            np.cos(phase[rows], out=cosine)
            np.sin(phase[rows], out=sine)
            np.copyto(weight, mask[rows])
            np.multiply(weight, levels[rows], out=seen)
            np.multiply(weight, cosine, out=in_phase)
            np.multiply(weight, sine, out=across)
            for out, one, other in zip(
                rest, (in_phase, in_phase, seen, seen), (cosine, sine, cosine, sine), strict=True
            ):
                np.multiply(one, other, out=out)
            nodes[:, rows] = self.grid.at_nodes(products)
        share, *sums = (self.windows.gaussian(total) for total in nodes)
        known = share > _LEAST_SHARE
        scale = 1 / np.maximum(share, np.float32(_LEAST_SHARE))
        mean, c, s, cc, cs, p, q = (total * scale for total in sums)
        ss = 1 - cc - s * s
        cs -= c * s
        cc -= c * c
        p -= mean * c
        q -= mean * s
        determinant = cc * ss - cs * cs
        known &= determinant > _LEAST_VARIATION
        inverse = 1 / np.maximum(determinant, np.float32(_LEAST_VARIATION))
        x = (ss * p - cs * q) * inverse
        y = (cc * q - cs * p) * inverse
        beyond = Continuation(known, self.windows)
        level = beyond.by_slope(mean - x * c - y * s)
        modulation = beyond.by_mean(magnitude(x, y))
        return level, modulation, beyond.by_mean(np.arctan2(-y, x))

    def _on_surface(self, misfit, mask, allowed, clipped):
        """Bins that the fit may use, and those that lie on the surface."""
        size = np.abs(misfit)
        sample = size[::_EVERY, ::_EVERY_COLUMN][mask[::_EVERY, ::_EVERY_COLUMN]]
        noise = _MAD * median(sample) if len(sample) else 0.0
        good = (size < max(_MISFIT, _MISFIT_NOISE * noise)) & allowed
        across = 2 * math.ceil(0.6 * self.period) + 1
        closing = np.ones((5, across), np.uint8)
        body = (good | (clipped & allowed)).view(np.uint8)
        body = cv2.morphologyEx(body, cv2.MORPH_CLOSE, closing)
        core = cv2.erode(body, np.ones((3, int(2 * self.period) + 1), np.uint8), borderValue=0) > 0
        good &= core | (size < max(_RIM_MISFIT, _RIM_NOISE * noise))
        body = (good | (clipped & core)).view(np.uint8)
        body = cv2.morphologyEx(body, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
        return good, cv2.morphologyEx(body, cv2.MORPH_CLOSE, closing) > 0

    def _covered(self, levels, amplitude, cosine, body, allowed):
        """Amplitude of the fringes in a row of bins as a share of the model's, at the rim."""
        covered = np.zeros(body.shape, np.float32)
        change = (body[1:] != body[:-1]).any(axis=1)
        rows = np.flatnonzero(np.append(change, False) | np.append(False, change))
        size = 2 * math.ceil(self.period / 2) + 1, 1
        model = amplitude[rows] * cosine[rows]
        model -= cv2.blur(model, size)
        seen = levels[rows]
        seen -= cv2.blur(seen, size)  # light that is not fringes
        seen = cv2.blur(seen * model, size)
        share = seen / np.maximum(cv2.blur(model * model, size), 1e-3)
        covered[rows] = share * allowed[rows]
        return covered

    def _correction(self, rest, cosine, sine, modulation, mask):
        """Phase step by what is left of the photograph, and its predicted variance."""
        grid, windows = self.grid, self.windows
        count = 4 - 2 * self.fast
        nodes = self._sums[:count]
        for rows in grid.strips():
            products = self._products[:count, : rows.stop - rows.start]
            seen, weight = self._turns[:, : rows.stop - rows.start]
            np.copyto(weight, mask[rows])
            np.multiply(rest[rows], weight, out=seen)
            np.multiply(weight, sine[rows], out=products[0])
            products[0] *= sine[rows]
            products[0] *= 2
            np.multiply(seen, seen, out=products[1])
            if not self.fast:
                np.multiply(seen, cosine[rows], out=products[2])
                np.multiply(seen, sine[rows], out=products[3])
            nodes[:, rows] = grid.at_nodes(products)
        support, spread, *both = nodes
        support = windows.flat_top(support)
        enough = np.maximum(support, np.float32(_LEAST_SUPPORT))
        step = np.float32(0)
        if not self.fast:
            in_phase, across = (windows.flat_top(nodes) for nodes in both)
            step = np.arctan2(-2 * across / enough, modulation + 2 * in_phase)
        spread = windows.gaussian(spread, 2) / enough
        variance = spread / np.square(np.maximum(modulation, 1))
        return step, np.maximum(variance, np.float32(1e-8)), support > _LEAST_SHARE
