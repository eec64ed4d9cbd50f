"""The second fit: about the surface itself, where only dents and noise are left to measure.

What the first fit found is a model of the photograph; what differs from it, demodulated through
flat-top windows, corrects it. Beyond the surface's rim the photograph is taken to be as the
model says, which is how windows end there without leakage.
"""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.median import median
from ftp_dent_ros.profilometry.least_squares.bins.extrapolation import Extrapolation
from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.intensity_bins import IntensityBins
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows
from ftp_dent_ros.profilometry.least_squares.code.contrast_model import Envelope
from ftp_dent_ros.profilometry.least_squares.fit.camera_effects import lag_of_bins, take_harmonics
from ftp_dent_ros.profilometry.least_squares.fit.even_light import brightness, evened
from ftp_dent_ros.profilometry.least_squares.fit.masked_fit import LEAST_SEEN, MaskedFit, enough
from ftp_dent_ros.profilometry.least_squares.fit.polar import angle
from ftp_dent_ros.profilometry.least_squares.fit.refined import Refined
from ftp_dent_ros.profilometry.least_squares.fit.surface_mask import (
    on_surface,
    rim_cover,
    roughness,
)
from ftp_dent_ros.profilometry.least_squares.noise.albedo import slope_along_u
from ftp_dent_ros.profilometry.least_squares.noise.denoising import denoise
from ftp_dent_ros.profilometry.least_squares.noise.noise_gain import noise_through
from ftp_dent_ros.profilometry.least_squares.noise.other_light import OtherLight
from ftp_dent_ros.profilometry.least_squares.noise.response import Response, over_rows

# Of the normal equations by missing bins, beyond which their lack is not made up for.
_LEAST_SUPPORT = 0.5
# Fringes along u, and bins along v, by which the first mask's rim is uncertain.
_RIM_U, _RIM_V = 0.6, 1
# Misfit of most of a surface, in amplitudes, that is none of skin, and over that by noise.
_RELIEF, _RELIEF_NOISE = 0.08, 2.0
# Gaussian windows that the noise has come through, one correcting the other; a flat-top is two.
_FITS = 4
# Fits of a surface that is rough, each on what the last one explains, until it is so much.
_ROUNDS, _EXPLAINED = 2, 0.9
# Of what is lit in a window, that must be explained for a point: no edge is filled from around.
_LEAST_TOLD = 0.75
# Variance of noise over what a fit's residual shows of it.
_FITTED = 1.45
# Mean square of the lowest contrast, seen through noise.
_LEAST_POWER = 0.1
_SUMS = 6


class Refinement:
    """Fits about a surface.

    Parameters
    ----------
    grid : Grid
    windows : Windows
    period : float
        Of the fringes, pixels.
    """

    def __init__(self, grid: Grid, windows: Windows, period: float, systematic: float) -> None:
        self._systematic = systematic
        self.grid, self.windows = grid, windows
        self.period = period / grid.step
        rows, columns = grid.bin_shape
        strip = grid.strips()[0].stop
        self._masked = MaskedFit(grid, windows)
        self._products = np.empty((_SUMS, strip, columns), np.float32)
        self._turns = np.empty((2, strip, columns), np.float32)
        self._sums = np.empty((_SUMS, *grid.shape), np.float32)
        self._work = np.empty((4, rows, columns), np.float32)
        self._response = Response.of(period, grid, _FITS)
        self._noise = noise_through(grid, windows, self._response)
        self._other_light = OtherLight(windows, self._noise)
        pixel, self._density = grid.noise_at(self.period)
        # Texture is seen at twice the fringes' frequency, where averages leave less of all.
        double = math.sqrt(grid.noise_at(self.period / 2)[1] / self._density)
        gains = pixel * self._density * double ** np.arange(3)
        self._of_pixels = gains.astype(np.float32)[:, None, None]

    def refine(
        self,
        light: IntensityBins,
        base: NDArray[np.float32],
        reference: NDArray[np.float32],
        shift: NDArray[np.float32],
        region: NDArray[np.bool_],
        envelope: Envelope | None = None,
        relief: bool = False,
    ) -> Refined:
        """Refine the phase shift of one surface.

        Parameters
        ----------
        light : IntensityBins
        base : ndarray, shape (rows, columns), float32
            Absolute phase at the bins of a plane.
        reference : ndarray, shape (rows, columns), float32
            Phase of a smooth surface near the true one, less the plane's, at the nodes.
        shift : ndarray, shape (rows, columns), float32
            Phase less the reference's at the nodes, continued beyond the region.
        region : ndarray, shape (rows, columns), bool
            Nodes of the surface, to a node or so.
        envelope : Envelope, optional
            Of coded fringes.
        relief : bool
            Whether the surface is no skin: at its edges nothing that windows took is put back.
        """
        inside = self.grid.to_bins(region).view(np.uint8)
        phase = base + self._of_model(reference + shift)
        clipped = light.clipped
        levels = light.filled(phase, inside > 0, self.period)
        rim = math.ceil(self.grid.bins / 2 + _RIM_U * self.period)
        core = cv2.erode(inside, np.ones((2 * _RIM_V + 1, 2 * rim + 1)), borderValue=0)
        mask = (core > 0) & ~clipped
        allowed = (cv2.dilate(inside, np.ones((3, 5))) > 0) & ~clipped
        lost = self._share_of(clipped & (core > 0)) if clipped.any() else None
        for _ in range(_ROUNDS):
            equations = self._masked.equations(phase, mask, lost, envelope)
            level, modulation, step = equations.solved(levels)
            shift = shift + step
            phase = np.add(base, self._of_model(reference + shift), out=phase)
            cosine, sine = self._fringes(phase, envelope)
            rest, amplitude, fringes = self._rest(levels, level, modulation, cosine)
            misfit = self._work[3]
            take_harmonics(rest, amplitude, cosine, mask, self.grid, self._turns[0])
            np.divide(rest, np.maximum(amplitude, 1, out=misfit), out=misfit)
            mask, body, lit = on_surface(misfit, mask, allowed, clipped, cosine, self.period)
            if np.count_nonzero(mask) > _EXPLAINED * np.count_nonzero(allowed):
                break
        bright = brightness(level, region & equations.told)
        even = evened(levels, bright, self.grid)
        level, modulation, again = equations.solved(even)
        shift = shift + (again - step)
        phase = np.add(base, self._of_model(reference + shift), out=phase)
        cosine, sine = self._fringes(phase, envelope)
        rest, amplitude, _ = self._rest(even, level, modulation, cosine)
        second = take_harmonics(rest, amplitude, cosine, mask, self.grid, self._turns[0])
        seen = self._share_of(mask)
        told = seen > np.float32(_LEAST_TOLD) * self._share_of(body & ~clipped)
        if lost is not None:
            # What is clipped is taken to be as the model says, so that windows stay whole.
            filled = clipped & body
            rest[filled] = misfit[clipped] = 0
            mask = mask | filled
        step, along, texture, variance, support, power = self._correction(
            rest, misfit, cosine, sine, modulation, mask, second, envelope is not None
        )
        if lost is not None:
            # Less is seen, and flanks alone tell phase from level less well.
            variance /= np.square(np.maximum(1 - lost, np.float32(LEAST_SEEN)))
        supported = enough(support, lost)
        body &= self.grid.to_bins(told & (seen > LEAST_SEEN))
        level *= bright
        modulation = modulation * bright
        noise = light.noise.of_fringes(level, modulation) * self._of_pixels
        pixels = noise / (np.square(np.maximum(modulation, 1)) * power)
        beyond = Extrapolation(supported, self.windows)
        denoised = denoise(
            beyond.by_slope(shift + step),
            beyond.by_mean(texture),
            self._contrast_slope(level, beyond.by_mean(along) * bright),
            pixels,
            beyond.by_mean(variance),
            supported,
            self.windows,
            self._response,
            self._noise,
            self._systematic,
            not relief,
        )
        if envelope is None:
            # The code is in the contrast.
            other = self._other_light.variance(level, modulation, pixels[0], supported)
            denoised = replace(denoised, variance=denoised.variance + other)
        if self.grid.bin_variance:
            lag = lag_of_bins(modulation, phase, self.grid, self.windows)
            denoised = replace(denoised, values=denoised.values - lag)
        covered = rim_cover(levels, fringes, body, allowed, self.period)
        rough = roughness(misfit, self.windows, self.grid)
        explained = median(np.sqrt(pixels[0][supported])) if supported.any() else 0.0
        is_relief = supported.any() and median(rough[supported]) > max(
            _RELIEF, _RELIEF_NOISE * explained
        )
        wavelength = self._response.wavelength(denoised.put_back)
        return Refined(
            denoised, level, modulation, body, lit, covered, rough, wavelength, bool(is_relief)
        )

    def _fringes(self, phase, envelope):
        """Cosine and sine of a phase, as a code's envelope makes them, in the workspace."""
        cosine, sine = (np.cos(phase, out=self._work[0]), np.sin(phase, out=self._work[1]))
        if envelope is not None:
            for rows in self.grid.strips():
                envelope.turn(phase[rows], cosine[rows], sine[rows], rows)
        return cosine, sine

    def _rest(self, levels, level, modulation, cosine):
        """What fringes leave of levels, in the workspace, their amplitude, and their light."""
        amplitude = self.grid.at_bins(modulation)
        rest = np.subtract(levels, self.grid.at_bins(level), out=self._work[2])
        fringes = amplitude * cosine
        rest -= fringes
        return rest, amplitude, fringes

    def _contrast_slope(self, level, modulation):
        """Slope of the logarithm of the contrast along u, over that of the fringes' phase."""
        contrast = np.log(np.maximum(modulation, 1) / np.maximum(level, 1))
        return slope_along_u(contrast, self.period / self.grid.bins)

    def _of_model(self, phase):
        """Phase at the nodes to the bins, as the photograph has it."""
        return self.grid.at_bins(over_rows(phase, self.grid.rows))

    def _share_of(self, mask):
        """Share of each node's window that a mask has."""
        return self.windows.gaussian(self.grid.at_nodes(mask.astype(np.float32)))

    def _correction(self, rest, misfit, cosine, sine, modulation, mask, second, coded):
        """Phase step by what is left of the photograph, and its predicted variance.

        Beside them: texture, the share of each window that is seen, and the mean square of the
        contrast there.
        """
        grid, windows = self.grid, self.windows
        count = _SUMS - 1 + coded
        nodes = self._sums[:count]
        for rows in grid.strips():
            products = self._products[:count, : rows.stop - rows.start]
            seen, weight = self._turns[:, : rows.stop - rows.start]
            np.copyto(weight, mask[rows])
            np.multiply(rest[rows], weight, out=seen)
            np.multiply(weight, sine[rows], out=products[0])
            products[0] *= sine[rows]
            products[0] *= 2
            np.multiply(misfit[rows], weight, out=products[1])
            products[1] *= products[1]
            np.multiply(seen, sine[rows], out=weight)
            np.multiply(weight, cosine[rows], out=products[2])
            np.multiply(seen, cosine[rows], out=products[3])
            np.copyto(products[4], weight)
            if coded:
                np.copyto(products[5], mask[rows])
            nodes[:, rows] = grid.at_nodes(products)
        support, spread, double, in_phase, across, *share_of_nodes = nodes
        support, power = windows.flat_top(support), np.float32(1)
        if coded:
            share = windows.flat_top(*share_of_nodes)
            whole = np.maximum(share, np.float32(_LEAST_SUPPORT))
            power, support = np.maximum(support / whole, np.float32(_LEAST_POWER)), share
        whole = np.maximum(support, np.float32(_LEAST_SUPPORT)) * power
        size = np.maximum(modulation, 1)
        along = modulation + 2 * windows.flat_top(in_phase) / power
        step = angle(-2 * windows.flat_top(across) / whole, along)
        texture = 4 * windows.flat_top(double) / (whole * size)
        texture += np.float32(2 * second) * step
        # Evening the light takes a leap of the albedo off its misfit, but not off the phase.
        variance = windows.gaussian(spread, 2) / whole
        variance *= np.float32(_FITTED * self._density)
        return step, along, texture, variance, support, power
