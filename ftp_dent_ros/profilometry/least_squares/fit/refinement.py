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

from ftp_dent_ros.profilometry.least_squares.bins.extrapolation import Extrapolation
from ftp_dent_ros.profilometry.least_squares.bins.grid import Grid
from ftp_dent_ros.profilometry.least_squares.bins.intensity_bins import IntensityBins
from ftp_dent_ros.profilometry.least_squares.bins.limits import at_least
from ftp_dent_ros.profilometry.least_squares.bins.red_stripe import without_stripe
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows
from ftp_dent_ros.profilometry.least_squares.code.contrast_model import Envelope
from ftp_dent_ros.profilometry.least_squares.fit.camera_effects import lag_of_blur, take_harmonics
from ftp_dent_ros.profilometry.least_squares.fit.correction import Correction
from ftp_dent_ros.profilometry.least_squares.fit.even_light import brightness, evened
from ftp_dent_ros.profilometry.least_squares.fit.masked_fit import (
    LEAST_SEEN,
    MaskedFit,
    enough,
    fringes_at,
)
from ftp_dent_ros.profilometry.least_squares.fit.refined import Refined
from ftp_dent_ros.profilometry.least_squares.fit.shadow_fit import ShadowFit
from ftp_dent_ros.profilometry.least_squares.fit.surface_mask import (
    astray,
    on_surface,
    rim_cover,
    roughness,
)
from ftp_dent_ros.profilometry.least_squares.fit.two_sided_fit import OneLight, TwoSidedFit
from ftp_dent_ros.profilometry.least_squares.noise.between_crests import doubt_in_dark
from ftp_dent_ros.profilometry.least_squares.noise.denoising import denoise
from ftp_dent_ros.profilometry.least_squares.noise.noise_gain import (
    noise_through,
    rounding_through,
)
from ftp_dent_ros.profilometry.least_squares.noise.other_light import OtherLight
from ftp_dent_ros.profilometry.least_squares.noise.response import Response, over_rows
from ftp_dent_ros.robust import median

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


class Refinement:
    """Fits about a surface.

    Parameters
    ----------
    grid : Grid
    windows : Windows
    period : float
        Of the fringes, pixels.
    rounding : ndarray, shape (2, rows, fringes), float32
        Shifts of the fringes' phase by the projector's rounding, radians.
    """

    def __init__(
        self, grid: Grid, windows: Windows, period: float, rounding: NDArray[np.float32]
    ) -> None:
        self._rounding = rounding_through(rounding, grid, windows, period)
        self.grid, self.windows = grid, windows
        self.period = period / grid.step
        self._masked = masked = MaskedFit(grid, windows)
        sides = TwoSidedFit(grid, windows, masked, self.period)
        self._edges = ShadowFit(grid, windows, masked, sides)
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
        usual_blur: NDArray[np.float32],
        blur: NDArray[np.float32] | None = None,
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
        usual_blur, blur : ndarray, shape (rows, columns), float32
            Variance of the blur of bins and usual lenses, and of all that a code shows, radians^2.
        envelope : Envelope, optional
            Of coded fringes.
        relief : bool
            Whether the surface is no skin: at its edges nothing that windows took is put back.
        """
        inside = self.grid.to_bins(region).view(np.uint8)
        phase = base + self._of_model(reference + shift)
        clipped = light.clipped
        striped = without_stripe(light, phase, inside > 0, self.period)
        levels = striped.levels
        rim = math.ceil(self.grid.bins / 2 + _RIM_U * self.period)
        core = cv2.erode(inside, np.ones((2 * _RIM_V + 1, 2 * rim + 1)), borderValue=0)
        mask = (core > 0) & ~clipped
        allowed = (cv2.dilate(inside, np.ones((3, 5))) > 0) & ~clipped
        lost = self._masked.share_of(clipped & (core > 0)) if clipped.any() else None
        for _ in range(_ROUNDS):
            equations = self._masked.equations(phase, mask, lost, envelope)
            level, modulation, step = equations.solved(levels)
            shift = shift + step
            phase = np.add(base, self._of_model(reference + shift), out=phase)
            cosine = np.cos(phase) if envelope is None else fringes_at(phase, envelope)[0]
            rest, amplitude, fringes = self._rest(levels, level, modulation, cosine)
            take_harmonics(rest, amplitude, cosine, mask)
            misfit = rest / at_least(amplitude, 1)
            mask, body, lit = on_surface(misfit, mask, allowed, clipped, cosine, self.period)
            if np.count_nonzero(mask) > _EXPLAINED * np.count_nonzero(allowed):
                break
        bright = brightness(level, region & equations.told)
        even = evened(levels, bright, self.grid)
        ordinary = level, modulation
        level, modulation, again = equations.solved(even)
        shift = shift + (again - step)

        def fringes_of(shift):
            phase = base + self._of_model(reference + shift)
            return phase, *fringes_at(phase, envelope)

        phase, cosine, sine = fringes_of(shift)
        one = OneLight(*(levels, even, *ordinary, bright, shift, cosine, mask, core > 0, clipped))
        # What is no skin has edges of its own everywhere.
        sides = None if relief else self._edges.fitted(one, fringes_of, envelope, lost)
        if sides is not None:
            shift, level, modulation = sides.shift, sides.level, sides.modulation
            even, mask, clipped = sides.even, sides.mask, clipped | sides.crossed
            lost = self._masked.share_of(clipped & (core > 0))
            phase, cosine, sine = fringes_of(shift)
        rest, amplitude, _ = self._rest(even, level, modulation, cosine)
        second = take_harmonics(rest, amplitude, cosine, mask)
        if sides is not None:
            np.divide(rest, at_least(amplitude, 1), out=misfit, where=sides.beside)
            mask, body, lit = on_surface(misfit, mask, allowed, clipped, cosine, self.period)
        seen = self._masked.share_of(mask)
        told = seen > np.float32(_LEAST_TOLD) * self._masked.share_of(body & ~clipped)
        if lost is not None:
            # What is clipped is taken to be as the model says, so that windows stay whole.
            filled = clipped & body
            rest[filled] = misfit[clipped] = 0
            mask = mask | filled
        found = Correction.of(
            *(rest, misfit, (cosine, sine), modulation, mask, second, envelope is not None),
            *(self.grid, self.windows, self._density),
        )
        variance = found.variance
        if lost is not None:
            # Less is seen, and flanks alone tell phase from level less well.
            variance = variance / np.square(at_least(1 - lost, LEAST_SEEN))
        if sides is not None:
            variance = variance + sides.variance
        supported = enough(found.support, lost)
        body &= self.grid.to_bins(told & (seen > LEAST_SEEN))
        level *= bright
        modulation = modulation * bright
        noise = light.noise.of_fringes(level, modulation) * self._of_pixels
        pixels = noise / (np.square(at_least(modulation, 1)) * found.power)
        contrast = modulation * np.sqrt(found.power) / at_least(level, 1)
        doubt = doubt_in_dark(found.in_dark, found.variance, pixels[0], contrast, supported)
        amplitude = modulation
        if sides is not None and sides.known is not None:
            # What its light leaves between crests is no other surface's.
            doubt, amplitude = doubt * (1 - sides.known), sides.amplitude
        beyond = Extrapolation(supported, self.windows)
        denoised = denoise(
            beyond.by_slope(shift + found.step),
            beyond.by_mean(found.texture),
            _contrast(level, beyond.by_mean(found.along) * bright),
            pixels,
            beyond.by_mean(variance),
            doubt,
            supported,
            self.windows,
            self._response,
            self._noise,
            self._rounding,
            not relief,
            envelope is None,
        )
        if envelope is None:
            # The code is in the contrast.
            other = self._other_light.variance(level, amplitude, pixels[0], supported)
            denoised = replace(denoised, variance=denoised.variance + other)
        of_stripe = striped.blur * self.grid.step**2
        if self.grid.bin_variance or of_stripe or blur is not None:
            place = phase, self.grid, self.windows, usual_blur, of_stripe, blur
            lag, either = lag_of_blur(modulation, equations.told, *place)
            denoised = replace(
                denoised, values=denoised.values - lag, variance=denoised.variance + either
            )
        covered = rim_cover(levels, fringes, body, allowed, self.period, alone=relief)
        rough = roughness(misfit, self.windows, self.grid)
        noisy = _RELIEF_NOISE * median(np.sqrt(pixels[0][supported])) if supported.any() else 0.0
        is_relief = bool(supported.any() and median(rough[supported]) > max(_RELIEF, noisy))
        wavelength = self._response.wavelength(denoised.put_back)
        return Refined(
            *(denoised, level, modulation, body, lit, covered, rough, wavelength),
            *(astray(misfit, mask, body, self.period), is_relief),
        )

    def _rest(self, levels, level, modulation, cosine):
        """What fringes leave of levels, their amplitude, and their light."""
        amplitude = self.grid.at_bins(modulation)
        rest = levels - self.grid.at_bins(level)
        fringes = amplitude * cosine
        rest -= fringes
        return rest, amplitude, fringes

    def _of_model(self, phase):
        """Phase at the nodes to the bins, as the photograph has it."""
        return self.grid.at_bins(over_rows(phase, self.grid.rows))


def _contrast(level, modulation):
    """Logarithm of the fringes' contrast."""
    return np.log(at_least(modulation, 1) / at_least(level, 1))
