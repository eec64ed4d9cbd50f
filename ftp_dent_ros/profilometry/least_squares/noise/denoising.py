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

from ftp_dent_ros.profilometry.least_squares.bins.limits import at_least
from ftp_dent_ros.profilometry.least_squares.bins.windows import Windows, coarsened, interpolated
from ftp_dent_ros.profilometry.least_squares.noise.albedo import (
    Feigned,
    slope_along_u,
    without_trend,
)
from ftp_dent_ros.profilometry.least_squares.noise.bands import OF_SKIN, SCALES, split
from ftp_dent_ros.profilometry.least_squares.noise.correlated import (
    along_fringes,
    from_pixel_to_pixel,
)
from ftp_dent_ros.profilometry.least_squares.noise.noise_gain import OF_CONTRAST, NoiseGain
from ftp_dent_ros.profilometry.least_squares.noise.response import Response
from ftp_dent_ros.robust import median

# Energy is a mean over so many times the width of a band's coarser edge.
_NEIGHBOURHOOD = 0.75
# Energy over that of noise from which on it is signal, and the signal that stays hidden in noise:
# two standard errors, and one, of the energy of as many independent values as a neighbourhood has.
NOISE, _HIDDEN = 1.5, 0.25
# Square of a single value over the noise's variance from which on it is signal: 3 deviations.
_SURELY = 9.0
# Energy beyond the windows' resolution, over that of the finest band, at equal energies of the
# two finest bands; the power of their ratio that it goes with, and the
# largest ratio: from the responses of windows and bands to Gaussian dents of 0.8 to 3.5 fringes'
# width, within a quarter.
_BEYOND, _POWER, _STEEPEST = 0.17, 1.75, 4.0
# Energy that the light on slopes feigns, over the finest band's, at equal energies of the two
# finest; it goes with the root of their ratio. By Lambert's law the light on a wave of L fringes
# passes for one of L / (L - 1) fringes, 1 / L as high, as windows and bands let both through.
_LIGHT = 0.25
# Scale up to which what may not be the skin's is in doubt.
_DETAIL = SCALES[2]
_LEAST = 1e-12
# Share of the finest band that albedo explains by chance, half of that from which on it is the
# cause: three standard errors of a correlation over the hundred nodes of a neighbourhood.
_SURE = 0.1
_EVERY = 2  # nodes along u and v that gains are estimated for together


@dataclass(frozen=True)
class Denoised:
    """A field less its noise.

    Attributes
    ----------
    values : ndarray, shape (rows, columns), float32
    variance : ndarray, shape (rows, columns), float32
        Of what is left of the noise, and of what may have been taken off with it.
    foreign : ndarray, shape (rows, columns), float32
        Variance by detail that may not be this surface's: that it is of this fringe is sure.
    put_back : ndarray, shape (rows, columns), float32
        Share of what the windows leave out of this very surface that was put back.
    """

    values: NDArray[np.float32]
    variance: NDArray[np.float32]
    foreign: NDArray[np.float32]
    put_back: NDArray[np.float32]


def denoise(
    values: NDArray[np.float32],
    texture: NDArray[np.float32],
    contrast: NDArray[np.float32],
    pixels: NDArray[np.float32],
    variance: NDArray[np.float32],
    doubt: NDArray[np.float32],
    inside: NDArray[np.bool_],
    windows: Windows,
    response: Response,
    gain: NoiseGain,
    rounding: tuple[float, ...],
    restoring: bool = True,
    even_contrast: bool = True,
) -> Denoised:
    """Take texture and the pixels' noise off a field.

    Parameters
    ----------
    values, texture : ndarray, shape (rows, columns), float32
        Phase, and the sine of twice the fringes' phase in the light; continued beyond the region.
    contrast : ndarray, shape (rows, columns), float32
        Logarithm of the fringes' contrast.
    pixels : ndarray, shape (3, rows, columns), float32
        Variance of the bins by the pixels' noise, in amplitudes, as the means of
        `PixelNoise.of_fringes` tell it: on the phase and, with one and two cosines, on texture.
    variance : ndarray, shape (rows, columns), float32
        Of the bins, by all there is.
    doubt : ndarray, shape (rows, columns), float32
        Of what fine detail is (`doubt_in_dark`), 0 to 1.
    inside : ndarray, shape (rows, columns), bool
        The region.
    windows : Windows
    response : Response
        Of the fits that the field has come through.
    gain : NoiseGain
        Of the windows that the field has come through.
    rounding : tuple of float
        Variance by the projector's rounding, in the bands and below them all, radians^2.
    restoring : bool
        Whether the surface is smooth but for some places: what the fits leave out is put back
        where it stands out, and what goes along the fringes everywhere is noise.
    even_contrast : bool
        Whether what varies in the contrast as fast as marks do is none of the pattern's.
    """
    coarse = Windows(windows.sigma_u / _EVERY, windows.sigma_v / _EVERY)
    together = (_EVERY, _EVERY)
    uneven = without_trend(contrast, windows)
    slope = slope_along_u(uneven)
    feigned = Feigned.of(values, texture, slope, contrast, windows, _EVERY)
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
    by_texture = 4 * np.square(feigned.on_texture) * of_texture
    albedo = [np.float32(0)] * (len(SCALES) + 1)
    if even_contrast:
        albedo = _albedo_by_contrast(uneven, feigned.explained, known, gain, coarse, windows)
    known += 4 * feigned.on_texture * (feigned.on_texture * of_texture - with_texture)
    at_least(known, _LEAST, out=known)
    np.maximum(total, known, out=total)
    along = 0.0
    if restoring:
        along = along_fringes(bands, total, inside, windows, gain, _EVERY)
    total *= np.float32(from_pixel_to_pixel(bands[0], shares[0] * total, inside, _EVERY))
    *rounded, below = rounding
    left = np.float32(rest + along * line_rest) * total + np.float32(below)
    left += np.maximum(missed * _energy(feigned_base, coarse, SCALES[-1]), albedo.pop())
    hidden = np.float32(np.inf)
    coarser = beyond_noise = np.float32(np.inf)
    of_all = (
        np.float32(share + along * line) * total + np.float32(each)
        for share, line, each in zip(shares, lines, rounded, strict=True)
    )
    per_band = shares, of_all, gain.slopes, SCALES, albedo
    of_bands = list(zip(bands, feigned_bands, *per_band, strict=True))
    for band, taken, share, of_noise, slope_share, scale, shown in reversed(of_bands):
        energy = _energy(band, coarse, scale)
        noise = np.float32(share) * known + np.float32(slope_share) * by_slope
        removed = _energy(taken, coarse, scale)
        removed -= np.float32(share) * by_texture + np.float32(slope_share) * by_slope
        at_least(removed, 0, out=removed)
        # Of an albedo, what is not taken off stays, as far as the band itself shows so much.
        remains = np.minimum(np.maximum(shown - removed, missed * removed), energy)
        signal = at_least(energy - np.float32(NOISE) * noise, 0)
        coarser = beyond_noise
        beyond_noise = at_least(energy - np.float32(NOISE) * of_noise, 0)
        # A surface's spectrum falls: no more is hidden in a band than may be in the coarser one.
        hidden = signal + np.minimum(np.float32(_HIDDEN) * noise, hidden)
        weight = signal / (signal + noise)
        left += np.square(weight) * of_noise + np.square(1 - weight) * hidden
        if band is not bands[0]:
            # What is missed of the finest band, that band itself shows.
            left += np.square(weight) * remains
        base += band * interpolated(weight, values.shape)
    falling = np.minimum(beyond_noise / np.maximum(coarser, _LEAST), np.float32(_STEEPEST))
    at_peaks = coarsened(np.square(bands[0]), together)
    at_peaks -= np.float32(_SURELY * shares[0]) * total
    amiss = np.float32(_BEYOND) * falling**_POWER + np.float32(_LIGHT) * np.sqrt(falling)
    left += amiss * np.maximum(at_peaks, beyond_noise)
    lack = response.left_out(base)
    noise = np.float32(gain.left_out) * total
    put_back = np.float32(restoring) * _share_of_signal(lack, noise, coarse)
    # Its noise and that of the finest band may agree.
    left += put_back * (put_back + np.float32(2 * math.sqrt(shares[0] / gain.left_out))) * noise
    for missing, part in ((lack, 1 - put_back), (response.left_out(lack), put_back)):
        left += np.square(part) * coarsened(np.square(missing), together)
    put_back = interpolated(put_back, values.shape)
    base += put_back * lack
    detail = base - windows.wide_flat_top(base, _DETAIL)
    foreign = interpolated(coarsened(doubt * np.square(detail), together), values.shape)
    return Denoised(base, interpolated(left, values.shape), foreign, put_back)


def _energy(band, coarse, scale):
    """Mean square of a band around, at coarse nodes."""
    return coarse.wide(coarsened(band * band, (_EVERY, _EVERY)), _NEIGHBOURHOOD * scale)


def _missed(finest, feigned, inside):
    """What of an albedo's energy the correction misses, over what it takes, in the finest band."""
    sample = inside[::_EVERY, ::_EVERY]
    if not sample.any():
        return 0.0
    finest, feigned = (each[::_EVERY, ::_EVERY][sample] for each in (finest, feigned))
    left, before = (median(np.square(each)) for each in (finest, finest - feigned))
    return min(left / max(before - left, _LEAST), 1.0)


def _albedo_by_contrast(contrast, explained, noise, gain, coarse, windows):
    """Energy of an albedo in the phase's bands and below, as the contrast tells, at coarse nodes.

    Light about the fringes' frequency that is at no certain phase to them does to their amplitude
    what it does to their phase. Of longer waves, of which light and lens have their own, there
    is as much as if it were white.
    """
    sure = np.clip(explained / np.float32(_SURE) - 1, 0, 1)
    energies = []
    finer = zip(
        split(contrast, windows, OF_SKIN)[0], OF_SKIN, gain.amplitudes, gain.shares, strict=False
    )
    for band, scale, amplitude, share in finer:
        energy = _energy(band, coarse, scale)
        energy -= np.float32(NOISE * OF_CONTRAST * amplitude) * noise
        energies.append(np.float32(share / amplitude) * sure * at_least(energy, 0))
    coarser = gain.shares[len(energies) :]
    white = energies[-1] / np.float32(gain.shares[len(energies) - 1])
    return [*energies, *(np.float32(share) * white for share in coarser)]


def _share_of_signal(field, noise, coarse):
    """Wiener's gain on fine detail, at coarse nodes."""
    energy = _energy(field, coarse, SCALES[0])
    signal = at_least(energy - np.float32(NOISE) * noise, 0)
    return signal / (signal + noise + np.float32(_LEAST))
