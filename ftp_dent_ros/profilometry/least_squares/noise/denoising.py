"""The pixels' noise and the skin's texture taken off the phase, and put back what windows took.

The phase is split into bands from fine to coarse. A band is held back where its energy is no more
than the noise of the pixels explains (Wiener's gain); that noise is known by what it is (shot and
read noise, as the photograph's own pixels show it), not by what the fit leaves, so that neither a
dent nor the skin's texture is taken for it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.median import median
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows, coarsened, interpolated
from ftp_dent_ros.profilometry.least_squares.noise.albedo import Feigned, without_trend
from ftp_dent_ros.profilometry.least_squares.noise.bands import ALONG, SCALES, split
from ftp_dent_ros.profilometry.least_squares.noise.noise_gain import NoiseGain
from ftp_dent_ros.profilometry.least_squares.noise.response import Response

# Energy is a mean over so many times the width of a band's coarser edge.
_NEIGHBOURHOOD = 0.75
# Energy over that of noise from which on it is signal, and the signal that stays hidden in noise:
# two standard errors, and one, of the energy of as many independent values as a neighbourhood has.
NOISE, _HIDDEN = 1.5, 0.25
# Square of a single value over the noise's variance from which on it is signal: 3 deviations.
_SURELY = 9.0
_MEDIAN_OF_SQUARE = 0.4549  # of normal values
# Energy beyond the windows' resolution, over that of the finest band, at equal energies of the
# two finest bands; the power of their ratio that it goes with, and the
# largest ratio: from the responses of windows and bands to Gaussian dents of 0.8 to 3.5 fringes'
# width, within a quarter.
_BEYOND, _POWER, _STEEPEST = 0.17, 1.75, 4.0
# Energy that the light on slopes feigns, over the finest band's, at equal energies of the two
# finest; it goes with the root of their ratio. By Lambert's law the light on a wave of L fringes
# passes for one of L / (L - 1) fringes, 1 / L as high, as windows and bands let both through.
_LIGHT = 0.25
_LEAST = 1e-12
_EVERY = 2  # nodes along u and v that gains are estimated for together


@dataclass(frozen=True)
class Denoised:
    """A field less its noise.

    Attributes
    ----------
    values : ndarray, shape (rows, columns), float32
    variance : ndarray, shape (rows, columns), float32
        Of what is left of the noise, and of what may have been taken off with it.
    put_back : ndarray, shape (rows, columns), float32
        Share of what the windows leave out of this very surface that was put back.
    """

    values: NDArray[np.float32]
    variance: NDArray[np.float32]
    put_back: NDArray[np.float32]


def denoise(
    values: NDArray[np.float32],
    texture: NDArray[np.float32],
    contrast_slope: NDArray[np.float32],
    pixels: NDArray[np.float32],
    variance: NDArray[np.float32],
    inside: NDArray[np.bool_],
    windows: Windows,
    response: Response,
    gain: NoiseGain,
    systematic: float,
    restoring: bool = True,
) -> Denoised:
    """Take texture and the pixels' noise off a field.

    Parameters
    ----------
    values, texture : ndarray, shape (rows, columns), float32
        Phase, and the sine of twice the fringes' phase in the light; continued beyond the region.
    contrast_slope : ndarray, shape (rows, columns), float32
        Of the logarithm of the fringes' contrast along u, over that of their phase.
    pixels : ndarray, shape (3, rows, columns), float32
        Variance of the bins by the pixels' noise, in amplitudes, as the means of
        `PixelNoise.of_fringes` tell it: on the phase and, with one and two cosines, on texture.
    variance : ndarray, shape (rows, columns), float32
        Of the bins, by all there is.
    inside : ndarray, shape (rows, columns), bool
        The region.
    windows : Windows
    response : Response
        Of the fits that the field has come through.
    gain : NoiseGain
        Of the windows that the field has come through.
    systematic : float
        Variance that no average lessens, radians^2.
    restoring : bool
        Whether the surface is smooth but for some places: what the fits leave out is put back
        where it stands out, and what goes along the fringes everywhere is noise.
    """
    coarse = Windows(windows.sigma_u / _EVERY, windows.sigma_v / _EVERY)
    together = (_EVERY, _EVERY)
    slope = without_trend(contrast_slope, windows)
    feigned = Feigned.of(values, texture, slope, windows, _EVERY)
    by_albedo = interpolated(feigned.on_texture, values.shape) * texture
    by_albedo -= interpolated(feigned.on_slope, values.shape) * slope
    bands, base = split(values + by_albedo, windows)
    feigned_bands, feigned_base = split(by_albedo, windows)
    missed = np.float32(_missed(bands[0], feigned_bands[0], inside))
    *shares, rest = gain.shares
    *lines, line_rest = gain.lines
    known, with_texture, of_texture = (coarsened(each, together) for each in pixels)
    total = np.maximum(coarsened(variance, together), known)
    # What texture explained is no noise any more.
    total *= 1 - feigned.explained
    # What is added of the texture and the contrast has such noise too, in part the same.
    by_slope = np.square(feigned.on_slope) * known
    known += 4 * feigned.on_texture * (feigned.on_texture * of_texture - with_texture)
    np.maximum(known, np.float32(_LEAST), out=known)
    np.maximum(total, known, out=total)
    along = 0.0
    if restoring:
        along = _along_fringes_beyond_white(bands, total, inside, windows, gain)
    total *= np.float32(_beyond_white(bands[0], shares[0] * total, inside))
    left = np.float32(rest + along * line_rest) * total
    left += missed * _energy(feigned_base, coarse, SCALES[-1])
    hidden = np.float32(np.inf)
    coarser = beyond_noise = np.float32(np.inf)
    of_all = (share + along * line for share, line in zip(shares, lines, strict=True))
    of_bands = list(zip(bands, feigned_bands, shares, of_all, gain.slopes, SCALES, strict=True))
    for band, taken, share, by_all, slope_share, scale in reversed(of_bands):
        energy = _energy(band, coarse, scale)
        noise = np.float32(share) * known + np.float32(slope_share) * by_slope
        signal = np.maximum(energy - np.float32(NOISE) * noise, 0)
        coarser = beyond_noise
        beyond_noise = np.maximum(energy - np.float32(NOISE * by_all) * total, 0)
        # A surface's spectrum falls: no more is hidden in a band than may be in the coarser one.
        hidden = signal + np.minimum(np.float32(_HIDDEN) * noise, hidden)
        weight = signal / (signal + noise)
        left += np.square(weight) * np.float32(by_all) * total + np.square(1 - weight) * hidden
        if band is not bands[0]:
            # What is missed of the finest band, that band itself shows.
            left += np.square(weight) * missed * _energy(taken, coarse, scale)
        base += band * interpolated(weight, values.shape)
    falling = np.minimum(beyond_noise / np.maximum(coarser, _LEAST), np.float32(_STEEPEST))
    at_peaks = coarsened(np.square(bands[0]), together)
    at_peaks -= np.float32(_SURELY * shares[0]) * total
    amiss = np.float32(_BEYOND) * falling**_POWER + np.float32(_LIGHT) * np.sqrt(falling)
    left += amiss * np.maximum(at_peaks, beyond_noise)
    left += np.float32(systematic)
    lack = response.left_out(base)
    noise = np.float32(gain.left_out) * total
    put_back = np.float32(restoring) * _share_of_signal(lack, noise, coarse)
    # Its noise and that of the finest band may agree.
    left += put_back * (put_back + np.float32(2 * math.sqrt(shares[0] / gain.left_out))) * noise
    for missing, part in ((lack, 1 - put_back), (response.left_out(lack), put_back)):
        left += np.square(part) * coarsened(np.square(missing), together)
    put_back = interpolated(put_back, values.shape)
    base += put_back * lack
    return Denoised(base, interpolated(left, values.shape), put_back)


def _energy(band, coarse, scale):
    """Mean square of a band around, at coarse nodes."""
    return coarse.wide(coarsened(band * band, (_EVERY, _EVERY)), _NEIGHBOURHOOD * scale)


def _missed(finest, feigned, inside):
    """What of an albedo's energy the correction misses, over what it takes, in the finest band."""
    some = (slice(None, None, _EVERY), slice(None, None, _EVERY))
    sample = inside[some]
    if not sample.any():
        return 0.0
    left, before = (median(np.square(each[some][sample])) for each in (finest, finest - feigned))
    return min(left / max(before - left, _LEAST), 1.0)


def _share_of_signal(field, noise, coarse):
    """Wiener's gain on fine detail, at coarse nodes."""
    energy = _energy(field, coarse, SCALES[0])
    signal = np.maximum(energy - np.float32(NOISE) * noise, 0)
    return signal / (signal + noise + np.float32(_LEAST))


def _along_fringes_beyond_white(bands, variance, inside, windows, gain):
    """Variance of noise that goes all along the fringes, over that of what is white.

    A mean along the fringes lessens white noise by what is known, and such noise not at all. It
    shows in both of the finest bands; ripples of the fringes' own period show in one.
    """
    some = (slice(None, None, _EVERY), slice(None, None, _EVERY))
    sample = inside[some]
    if not sample.any():
        return 0.0
    told = []
    for band, averaged, line in zip(bands, gain.averaged, gain.lines, strict=False):
        mean = windows.along_v(band[:, some[1]], ALONG)[some[0]]
        energy = median(np.square(mean[sample]) / variance[sample]) / _MEDIAN_OF_SQUARE
        told.append(max(energy - averaged, 0.0) / line)
    return min(told)


def _beyond_white(band, variance, inside):
    """Factor on the variance by noise that is correlated from pixel to pixel."""
    some = (slice(None, None, _EVERY), slice(None, None, _EVERY))
    sample = inside[some]
    if not sample.any():
        return 1.0
    return max(1.0, median(np.square(band[some])[sample] / variance[sample]) / _MEDIAN_OF_SQUARE)
